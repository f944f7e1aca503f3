"""Threads that answer what would hold up everybody else, a few questions at a time."""

import asyncio
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar
from functools import partial
from typing import Any, TypeVar

from sidestep.server.problems import ProblemError

T = TypeVar("T")
CLIENT: ContextVar[str] = ContextVar("client", default="")
"""Who asks."""


class Desk:
    """Answers questions in threads, in the order in which they come.

    Parameters
    ----------
    threads
        Questions that are answered side by side.
    waiting
        Questions that are answered or wait; more are refused.
    of_one
        Those of one client.
    seconds
        After which a client is told to ask again later. A question that has begun is worked out all the same, and keeps
        its thread: nothing can stop a thread.
    """

    def __init__(self, threads: int, waiting: int, of_one: int, seconds: float) -> None:
        self._threads = ThreadPoolExecutor(threads, thread_name_prefix="desk")
        self._waiting, self._of_one, self._seconds = waiting, of_one, seconds
        self._clients: Counter[str] = Counter()

    async def answer(self, work: Callable[[], T]) -> T:
        """Answer a question.

        Parameters
        ----------
        work
            Works the answer out.

        Returns
        -------
        T
            What that returns.

        Raises
        ------
        ProblemError
            503 where too many wait already, or the answer takes too long.
        """
        client, later = CLIENT.get(), {"retry-after": "2"}
        if self._clients.total() >= self._waiting:
            raise ProblemError(503, "too many such questions at once; ask again soon", headers=later)
        if self._clients[client] >= self._of_one:
            raise ProblemError(503, "too many such questions of one client at once; ask again soon", headers=later)
        self._clients[client] += 1
        future = self._threads.submit(work)
        loop = asyncio.get_running_loop()
        future.add_done_callback(partial(self._done, loop, client))
        answer = asyncio.wrap_future(future)
        answer.add_done_callback(_looked_at)
        try:
            await asyncio.wait([answer], timeout=self._seconds)
            if not answer.done():
                raise ProblemError(503, "the answer takes too long; ask for less", headers={"retry-after": "30"})
            return answer.result()
        finally:
            future.cancel()  # what has not begun need not

    def close(self) -> None:
        """Begin no more work."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _done(self, loop: asyncio.AbstractEventLoop, client: str, _future: "Future[T]") -> None:
        """Count a question that is answered, in the loop's thread; where the loop is gone nobody counts any more."""
        if not loop.is_closed():
            loop.call_soon_threadsafe(self._leave, client)

    def _leave(self, client: str) -> None:
        self._clients[client] -= 1
        if not self._clients[client]:
            del self._clients[client]


def _looked_at(answer: "asyncio.Future[Any]") -> None:
    """Take note of how a question ended that nobody waits for any more: otherwise its error is logged, with places."""
    if not answer.cancelled():
        answer.exception()
