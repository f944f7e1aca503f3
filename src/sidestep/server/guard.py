"""What stands before every request: limits, checks of who writes, security headers, metrics and the log."""

import asyncio
import hashlib
import hmac
import ipaddress
import logging
import time
from collections import OrderedDict
from functools import partial
from pathlib import Path
from traceback import extract_tb
from urllib.parse import urlsplit

from prometheus_client import Counter, Histogram
from starlette.requests import ClientDisconnect, Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from sidestep.server.desk import CLIENT
from sidestep.server.problems import ProblemError, refused
from sidestep.server.settings import LOOPBACK, Settings

LARGEST_BODY = 2**20
"""Bytes of a request's body."""
BODY_SECONDS = 10.0
"""Within which a body must have come."""
LARGEST_URL = 2**14
"""Bytes of a request's path and query."""
LARGEST_HEAD = 2**16
"""Bytes of its headers."""
MOST_CLIENTS = 10_000
"""Clients whose requests are counted, those seen last."""
READS = frozenset({"GET", "HEAD", "OPTIONS"})
METHODS = READS | {"POST", "PUT", "DELETE", "PATCH", "TRACE"}
"""Those that metrics tell apart."""
PROXIED = ("forwarded", "via", "x-forwarded-for", "x-forwarded-host", "x-real-ip")
"""Headers by which a proxy gives itself away."""
CLOSE = {"connection": "close"}
"""Headers of answers to requests whose body was not read to its end."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; worker-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: nothing comes from other hosts."""
HEADERS = tuple(
    (name.encode(), value.encode())
    for name, value in (
        ("content-security-policy", POLICY),
        ("x-content-type-options", "nosniff"),
        ("x-frame-options", "DENY"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-opener-policy", "same-origin"),
        ("permissions-policy", "camera=(), microphone=(), geolocation=(self)"),
    )
)
_SECONDS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)
REQUESTS = Counter("sidestep_requests_total", "Requests by route and status.", ("method", "route", "status"))
DURATION = Histogram("sidestep_request_seconds", "Seconds until the answer began.", ("route",), buckets=_SECONDS)

_log = logging.getLogger("sidestep.access")
_log_errors = logging.getLogger("sidestep.server")


class Guard:
    """ASGI middleware around the whole app.

    Parameters
    ----------
    app
        What is guarded.
    settings
        Of the server.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app, self._settings = app, settings
        self._rate = Rate(settings.requests_per_second)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, partial(_tell_failure, scope, send))
            return
        begun, method = time.perf_counter(), scope["method"]
        answer = Answer(scope, send, begun)
        client = client_of(scope["client"][0] if scope.get("client") else "")
        CLIENT.set(client)
        try:
            self._check(scope, client)
            body = receive if method in READS else Body(scope, receive).receive
            await self._app(answer.scope, body, answer.send)
        except ProblemError as problem:
            await answer.refuse(problem)
        except ClientDisconnect:
            pass
        except asyncio.CancelledError:  # only where a stop has waited for long enough
            await answer.refuse(ProblemError(503, "the server stops; ask again soon"))
        except Exception as error:  # noqa: BLE001 - nothing of it may leave the server
            _log_errors.error("error in %s %s: %s", method, answer.template, where(error))
            await answer.refuse(ProblemError(500, "something went wrong in the server; its log says what"))
        finally:
            # Paths hold places and walks, so they are never logged: only which route was asked.
            template, status, seconds = answer.template, answer.status, time.perf_counter() - begun
            REQUESTS.labels(method if method in METHODS else "other", template, status).inc()
            said = {"method": method, "route": template, "status": status, "milliseconds": round(1000 * seconds, 1)}
            _log.info("request", extra=said)

    def _check(self, scope: Scope, client: str) -> None:
        """Refuse too many requests, too long ones, and writes from other origins."""
        if not self._rate.allows(client):
            raise ProblemError(429, "too many requests from this address; send fewer", headers={"retry-after": "1"})
        if len(scope.get("raw_path") or b"") + len(scope["query_string"]) > LARGEST_URL:
            raise ProblemError(414, f"addresses may have {LARGEST_URL:,} bytes at most; use POST with a JSON body")
        if sum(len(name) + len(value) + 4 for name, value in scope["headers"]) > LARGEST_HEAD:
            raise ProblemError(431, f"headers may have {LARGEST_HEAD:,} bytes at most")
        if scope["method"] in READS:
            return
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get(b"host", "")
        if not self._is_own(host):
            said = f"requests that change something must address this server by its name, not {host!r:.60}"
            raise ProblemError(403, said, field="host")
        origin = headers.get(b"origin")
        if origin is not None and origin not in {f"http://{host}", f"https://{host}", *self._settings.origins}:
            said = f"pages of {origin!r:.60} may not change anything here"
            raise ProblemError(403, said, field="origin")

    def _is_own(self, host: str) -> bool:
        """Whether a Host header names this server: other names may be a page's that points here (DNS rebinding)."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in LOOPBACK or name in self._settings.hosts or bool(ipaddress.ip_address(name))
        except ValueError:
            return False


class Answer:
    """What is sent of an answer, with the headers that all have.

    Parameters
    ----------
    scope, send
        Of the request.
    begun
        When it came, by the performance counter.
    """

    def __init__(self, scope: Scope, send: Send, begun: float) -> None:
        self._send, self._begun = send, begun
        self._head = scope["method"] == "HEAD"
        self.scope = {**scope, "method": "GET"} if self._head else scope
        """What the app is asked: of HEAD it does not know."""
        self.status = 0
        """0 until it begins."""

    @property
    def template(self) -> str:
        """Which route is asked, without what is filled in."""
        return getattr(self.scope.get("route"), "path", None) or "other"

    async def send(self, message: Message) -> None:
        """Send a part of it."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
            message["headers"] = [*message.get("headers", ()), *HEADERS]
            DURATION.labels(self.template).observe(time.perf_counter() - self._begun)
            await self._send(message)
            if self._head:
                await self._send({"type": "http.response.body", "body": b""})
        elif not self._head:
            await self._send(message)

    async def refuse(self, problem: ProblemError) -> None:
        """Answer with what is wrong, if no other answer has begun; then the connection is cut."""
        if not self.status:
            await refused(self.scope["path"], problem)(self.scope, _nothing, self.send)


async def _tell_failure(scope: Scope, send: Send, message: Message) -> None:
    """Say in a sentence why the server does not start, instead of by a traceback, where that is known."""
    failure = getattr(scope["app"].state, "failure", None)
    if failure is not None and message["type"].endswith(".failed"):
        message = {**message, "message": failure}
    await send(message)


async def _nothing() -> Message:
    return {"type": "http.disconnect"}


def where(error: BaseException) -> str:
    """Kinds of errors and lines of code, without the messages: these may hold places and walks."""
    said: list[str] = []
    each: BaseException | None = error
    while each is not None and len(said) < 5:
        frames = extract_tb(each.__traceback__)
        own = [frame for frame in frames if "sidestep" in frame.filename or frame is frames[-1]]
        lines = [f"{Path(frame.filename).name}:{frame.lineno} {frame.name}" for frame in own]
        said.append(f"{type(each).__name__} at {' > '.join(lines)}")
        each = each.__cause__ or each.__context__
    return "; after ".join(said)


class Body:
    """A request's body, which must end, in time, and within ``LARGEST_BODY``."""

    def __init__(self, scope: Scope, receive: Receive) -> None:
        self._receive, self._bytes, self._ended = receive, 0, False
        self._deadline = time.monotonic() + BODY_SECONDS
        length = dict(scope["headers"]).get(b"content-length", b"0")
        if length.isdigit() and (len(length) > 18 or int(length) > LARGEST_BODY):
            raise _too_large()

    async def receive(self) -> Message:
        """The next part of it."""
        if self._ended:
            return await self._receive()
        try:
            async with asyncio.timeout(self._deadline - time.monotonic()):
                message = await self._receive()
        except TimeoutError as error:
            said = f"the body must come within {BODY_SECONDS:g} seconds"
            raise ProblemError(408, said, field="body", headers=CLOSE) from error
        self._bytes += len(message.get("body", b""))
        if self._bytes > LARGEST_BODY:
            raise _too_large()
        self._ended = not message.get("more_body", False)
        return message


class Rate:
    """A bucket of tokens for each client (a leaky bucket): as many requests a second, and twice as many at once.

    Parameters
    ----------
    per_second
        Requests of one client.
    """

    def __init__(self, per_second: float) -> None:
        self._per_second, self._most = per_second, max(1.0, 2 * per_second)
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def allows(self, client: str) -> bool:
        """Whether a client may ask once more."""
        now = time.monotonic()
        left, since = self._left.get(client, (self._most, now))
        left = min(self._most, left + (now - since) * self._per_second)
        self._left[client] = (left - 1 if left >= 1 else left), now
        self._left.move_to_end(client)
        if len(self._left) > MOST_CLIENTS:
            self._left.popitem(last=False)
        return left >= 1


def client_of(address: str) -> str:
    """Who asks from an address: all of a /64 are one."""
    if ":" not in address:
        return address
    try:
        found = ipaddress.IPv6Address(address)
    except ValueError:
        return address
    return str(found.ipv4_mapped or ipaddress.IPv6Network((int(found) >> 64 << 64, 64)))


def check_key(given: str | None, key: str | None) -> None:
    """Refuse writes without the API key.

    Parameters
    ----------
    given
        The header ``Authorization``.
    key
        The key; None where none is needed.

    Raises
    ------
    ProblemError
        401.
    """
    if key is None:
        return
    scheme, _, said = (given or "").partition(" ")
    # Of the same length whatever is sent, so that the time of the comparison tells nothing.
    sent, wanted = (hashlib.sha256(each.encode()).digest() for each in (said.strip(), key))
    if not (hmac.compare_digest(sent, wanted) and scheme.lower() == "bearer"):
        asked = "this needs the API key: send the header Authorization: Bearer KEY"
        raise ProblemError(401, asked, field="authorization", headers={"www-authenticate": "Bearer"})


def writer(request: Request) -> None:
    """Refuse to change anything for those who may not.

    Parameters
    ----------
    request
        Of the app, which knows the key.

    Raises
    ------
    ProblemError
        401 without the API key; 403 where there is none and others than this machine can reach the server, itself or
        through a proxy.
    """
    key, settings = request.app.state.key, request.app.state.settings
    if key is None and not settings.on_loopback:
        said = "this server has no API key, so it takes nothing from the network; start it with one"
        raise ProblemError(403, said, field="authorization")
    if key is None and any(name in request.headers for name in PROXIED):
        said = "this server has no API key, so it takes nothing through a proxy; start it with one"
        raise ProblemError(403, said, field="authorization")
    check_key(request.headers.get("authorization"), key)


def _too_large() -> ProblemError:
    return ProblemError(413, f"the body may have {LARGEST_BODY:,} bytes at most", field="body", headers=CLOSE)
