"""Connections of clients: what one may hold, for how long, and which must go where there are too many."""

import asyncio
from http import HTTPStatus
from typing import Any

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from sidestep.server.guard import HEADERS
from sidestep.server.problems import ProblemError, refused

MOST_CONNECTIONS = 800
"""Connections of one process; systems often give a process 1,024 files."""
IDLE = 20.0
"""Seconds that a client has to send a request, and that a connection stays open without one."""
UNREAD = 20.0
"""Seconds that a client has to take some of the answer that waits for it."""
LARGEST_HEAD = 2**16
"""Bytes of a request's headers, and of anything else that is no body."""
MOST_PIPELINED = 100
"""Requests that wait for the answers to earlier ones on their connection."""
LOOK = 1.0
"""Seconds after which a connection is looked at again."""


class Connection(HttpToolsProtocol):
    """A connection that nobody can keep by sending little, taking little, or sending without end.

    uvicorn itself limits neither the time in which a request comes, nor the length of its headers.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._held, self._unread, self._receiving = 0, 0, False
        self._taken = self.loop.time()
        self.since: float | None = self._taken
        """When it began to wait for its client; None while the server works."""
        self._timer = self.loop.call_later(LOOK, self._look)
        if len(self.connections) > MOST_CONNECTIONS:
            self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        self._timer.cancel()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        self._held += len(data)
        super().data_received(data)
        if self._held > LARGEST_HEAD:
            self._refuse(ProblemError(431, f"headers may have {LARGEST_HEAD:,} bytes at most"))

    def on_message_begin(self) -> None:
        self._receiving = True
        if self.since is not None:
            self.since = self.loop.time()
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        self._held = 0
        if len(self.pipeline) >= MOST_PIPELINED:
            self.transport.abort()
            raise httptools.HttpParserError("too many requests at once")
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        self._held = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        self._held, self._receiving = 0, False
        if not self.cycle.response_complete:
            self.since = None
        super().on_message_complete()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        waits = self._receiving or self.cycle.response_complete
        self.since = self.loop.time() if waits else None

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002 - says what a developer wants to know
        self._refuse(ProblemError(400, "this is no HTTP request"))

    def _refuse(self, problem: ProblemError) -> None:
        """Answer what never becomes a request of the app, and close."""
        if self.transport.is_closing():
            return
        if self.cycle is None or self.cycle.response_complete:
            answer = refused("", problem)
            first = f"HTTP/1.1 {problem.status} {HTTPStatus(problem.status).phrase}\r\nconnection: close\r\n"
            lines = [b"%s: %s\r\n" % each for each in (*answer.raw_headers, *HEADERS)]
            self.transport.write(b"".join([first.encode(), *lines, b"\r\n", bytes(answer.body)]))
        self.transport.close()

    def _look(self) -> None:
        """Close the connection if its client lets it wait for too long."""
        now, unread = self.loop.time(), self.transport.get_write_buffer_size()
        if not unread or unread < self._unread:
            self._taken = now
        self._unread = unread
        if unread and now - self._taken > UNREAD:
            self.transport.abort()
        elif not unread and self.since is not None and now - self.since > IDLE:
            self.transport.close()
        self._timer = self.loop.call_later(LOOK, self._look)

    def _make_room(self) -> None:
        """Close the connection that has waited for its client for longest; this one where none waits."""
        others: list[Any] = [each for each in self.connections if each is not self]
        waiting = [each for each in others if each.since is not None]
        if not waiting:
            self._refuse(ProblemError(503, "too many requests at once; ask again soon", headers={"retry-after": "2"}))
            return
        oldest = min(waiting, key=lambda each: each.since)
        self.connections.discard(oldest)
        oldest.transport.abort()
