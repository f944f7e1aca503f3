"""What stands before every request: limits, checks of who writes, security headers, metrics and the log."""

import asyncio
import hmac
import ipaddress
import logging
import time
from collections import OrderedDict
from urllib.parse import urlsplit

from prometheus_client import Counter, Histogram
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from sidestep.server.problems import ProblemError, refused
from sidestep.server.settings import LOOPBACK, Settings

LARGEST_BODY = 2**20
"""Bytes of a request's body."""
BODY_SECONDS = 10.0
"""Within which a body must have come."""
MOST_CLIENTS = 10_000
"""Addresses whose requests are counted, those seen last."""
READS = frozenset({"GET", "HEAD", "OPTIONS"})
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
    "worker-src 'self' blob:; font-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
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
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun, status = time.perf_counter(), 0
        method = scope["method"]

        async def sending(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message.get("headers", ()), *HEADERS]
                DURATION.labels(_template(scope)).observe(time.perf_counter() - begun)
            await send(message)

        try:
            self._check(scope)
            body = receive if method in READS else Body(scope, receive).receive
            await self._app(scope, body, sending)
        except ProblemError as problem:
            if not status:
                await refused(scope["path"], problem)(scope, receive, sending)
        finally:
            # Paths hold places and walks, so they are never logged: only which route was asked.
            template, seconds = _template(scope), time.perf_counter() - begun
            REQUESTS.labels(method, template, status).inc()
            said = {"method": method, "route": template, "status": status, "milliseconds": round(1000 * seconds, 1)}
            _log.info("request", extra=said)

    def _check(self, scope: Scope) -> None:
        """Refuse too many requests, and writes from other origins."""
        client = scope.get("client")
        if not self._rate.allows(client[0] if client else ""):
            raise ProblemError(429, "too many requests from this address; send fewer", headers={"retry-after": "1"})
        if scope["method"] in READS:
            return
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        host = headers.get(b"host", "")
        if not self._is_own(host):
            said = f"requests that change something must address this server by its name, not {host!r:.60}"
            raise ProblemError(403, said, field="host")
        origin = headers.get(b"origin")
        own = origin is not None and urlsplit(origin).netloc == host
        if origin is not None and not own and origin not in self._settings.origins:
            said = f"pages of {origin!r:.60} may not change anything here"
            raise ProblemError(403, said, field="origin")

    def _is_own(self, host: str) -> bool:
        """Whether a Host header names this server: other names may be a page's that points here (DNS rebinding)."""
        name = urlsplit(f"//{host}").hostname or ""
        if name in LOOPBACK or name in self._settings.hosts:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


class Body:
    """A request's body, which must end, in time, and within ``LARGEST_BODY``."""

    def __init__(self, scope: Scope, receive: Receive) -> None:
        self._receive, self._bytes, self._ended = receive, 0, False
        self._deadline = time.monotonic() + BODY_SECONDS
        length = dict(scope["headers"]).get(b"content-length", b"0")
        if length.isdigit() and int(length) > LARGEST_BODY:
            raise _too_large()

    async def receive(self) -> Message:
        """The next part of it."""
        if self._ended:
            return await self._receive()
        try:
            async with asyncio.timeout(self._deadline - time.monotonic()):
                message = await self._receive()
        except TimeoutError as error:
            raise ProblemError(408, f"the body must come within {BODY_SECONDS:g} seconds") from error
        self._bytes += len(message.get("body", b""))
        if self._bytes > LARGEST_BODY:
            raise _too_large()
        self._ended = not message.get("more_body", False)
        return message


class Rate:
    """A bucket of tokens for each client (a leaky bucket): as many requests a second, and twice as many at once."""

    def __init__(self, per_second: float) -> None:
        self._per_second, self._most = per_second, 2 * per_second
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def allows(self, client: str) -> bool:
        """Whether a client may ask once more."""
        now = time.monotonic()
        left, since = self._left.get(client, (self._most, now))
        left = min(self._most, left + (now - since) * self._per_second)
        self._left[client] = (max(left - 1, 0.0) if left >= 1 else left), now
        self._left.move_to_end(client)
        if len(self._left) > MOST_CLIENTS:
            self._left.popitem(last=False)
        return left >= 1


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
    said = (given or "").removeprefix("Bearer ").encode()
    if not hmac.compare_digest(said, key.encode()):
        wanted = "this needs the API key: send the header Authorization: Bearer KEY"
        raise ProblemError(401, wanted, field="authorization", headers={"www-authenticate": "Bearer"})


def writer(request: Request) -> None:
    """Refuse to change anything for those who may not.

    Parameters
    ----------
    request
        Of the app, which knows the key.

    Raises
    ------
    ProblemError
        401 without the API key; 403 where there is none and others than this machine can reach the server.
    """
    key, settings = request.app.state.key, request.app.state.settings
    if key is None and not settings.on_loopback:
        said = "this server has no API key, so it takes nothing from the network; start it with one"
        raise ProblemError(403, said, field="authorization")
    check_key(request.headers.get("authorization"), key)


def _too_large() -> ProblemError:
    return ProblemError(413, f"the body may have {LARGEST_BODY:,} bytes at most", field="body")


def _template(scope: Scope) -> str:
    """Which route is asked, without what is filled in."""
    return getattr(scope.get("route"), "path", None) or "other"
