"""News for those who listen: what changed in the town, as it happens."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

MOST_LISTENERS = 200
"""In one process."""
BEHIND = 32
"""News that a listener may be behind; the oldest are then left out."""

News = tuple[str, dict[str, Any]]
"""What kind of news, and what it says."""


class Bus:
    """Hands on news to all listeners of one process."""

    def __init__(self) -> None:
        self._queues: set[asyncio.Queue[News | None]] = set()
        self._ended = False

    @property
    def full(self) -> bool:
        """Whether nobody more may listen."""
        return len(self._queues) >= MOST_LISTENERS

    def tell(self, kind: str, said: dict[str, Any]) -> None:
        """Tell all who listen."""
        for queue in self._queues:
            _put(queue, (kind, said))

    async def listen(self, *before: News) -> AsyncIterator[News]:
        """Wait for news, until the server stops.

        Parameters
        ----------
        *before
            What this listener is told first.

        Yields
        ------
        News
            As they come.
        """
        queue: asyncio.Queue[News | None] = asyncio.Queue(BEHIND)
        self._queues.add(queue)
        for news in before:
            _put(queue, news)
        try:
            while not self._ended and (told := await queue.get()) is not None:
                yield told
        finally:
            self._queues.discard(queue)

    def end(self) -> None:
        """Let all who listen go: the server stops."""
        self._ended = True
        for queue in self._queues:
            _put(queue, None)


def _put(queue: asyncio.Queue[News | None], news: News | None) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(news)
