"""Live counts: taken, stored, and handed to the routers, whose crowds go on from them."""

import math
from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any

import numpy as np

from sidestep.crowds.live import AHEAD, LOOKBACK, LiveCounts, check_counts, is_late
from sidestep.routing.formats import feature
from sidestep.routing.router import Router
from sidestep.scenarios.crowd_sources import sensor_places
from sidestep.scenarios.places import Venue
from sidestep.server.clock import ServerClock
from sidestep.server.count_formats import read_posted
from sidestep.server.store import Store

AGED = timedelta(seconds=60)
"""After which crowds go on from the same counts anew: they have got older."""


class Counting:
    """What the sensors of a town count.

    Parameters
    ----------
    venue
        The town.
    router
        That of the scenario itself, which knows the sensors.
    store, clock
        Of the server.
    """

    def __init__(self, venue: Venue, router: Router, store: Store, clock: ServerClock) -> None:
        self._venue, self._router, self._store, self._clock = venue, router, store, clock
        self.sensors = tuple(dict.fromkeys(router.sensors))
        """Names of the sensors that crowds are known from."""
        self._live, self._counted = LiveCounts((), venue.timezone), 0
        self.version, self._refreshed = -1, datetime.min.replace(tzinfo=UTC)

    def take(self, body: bytes, content_type: str, seconds: float) -> dict[str, int]:
        """Take counts that somebody posts: they are stored before this returns.

        Parameters
        ----------
        body, content_type
            What was posted.
        seconds
            Length of intervals that do not say theirs.

        Returns
        -------
        dict
            How many were accepted, and of these how many were new, unchanged, corrected and late.

        Raises
        ------
        LiveError
            Counts that are not understood, or not taken; none of them is stored.
        StoreError
            A store that takes none at the moment.
        """
        self._clock.read()  # another process may have set it just now
        now = self._clock.instant
        counts = read_posted(body, content_type, self._venue.timezone, seconds)
        check_counts(counts, self.sensors, now)
        stored = Counter(self._store.put_counts(counts, datetime.now(UTC)))
        late = sum(is_late(count, now) for count in counts)
        return {
            "accepted": len(counts),
            **{word: stored[word] for word in ("new", "unchanged", "corrected")},
            "late": late,
        }

    def refresh(self, routers: Iterable[Router]) -> bool:
        """Let crowds go on from the latest counts, where there are others than before, or time has passed.

        Parameters
        ----------
        routers
            Whose crowds.

        Returns
        -------
        bool
            Whether anything changed.

        Raises
        ------
        StoreError
            A store that gives nothing at the moment.
        """
        version = self._store.version()
        if version != self.version:
            self._clock.read()
        now = self._clock.instant
        if version == self.version and abs(now - self._refreshed) < AGED:
            return False
        self._live = LiveCounts(tuple(self._store.counts_between(now - LOOKBACK, now + AHEAD)), self._venue.timezone)
        known = 0
        for router in routers:
            known = self._go_on(router, now)
        changed = version != self.version or known > 0 or self._counted > 0
        self.version, self._refreshed, self._counted = version, now, known
        return changed

    def begin(self, router: Router) -> None:
        """Let a router's crowds go on from the latest counts that are known, if they do not yet."""
        if router.live is not self._live:
            self._go_on(router, self._clock.instant)

    def _go_on(self, router: Router, now: datetime) -> int:
        """Let a router's crowds go on from the latest counts, and say from how many sensors."""
        here = self._clock.local(now).replace(tzinfo=None)
        return router.go_on_from(self._live, here) if self.sensors else 0

    @property
    def news(self) -> dict[str, Any]:
        """What is told of new crowds."""
        return {"version": self.version, "at": self._clock.local(self._refreshed).isoformat(), "counted": self._counted}

    def features(self) -> dict[str, Any]:
        """What sensors counted in their last hour beside what is expected, as GeoJSON: a feature for each."""
        names, now = self.sensors, self._clock.now().replace(tzinfo=None)
        latest = self._live.latest(names, now)
        expected = self._router.expected_counts(now)
        features = []
        for number, name in enumerate(names):
            latitude, longitude = self._places[name]
            count = math.nan if latest is None else float(latest.counts[number])
            counted = math.isfinite(count)
            hour = None if latest is None or not counted else np.broadcast_to(latest.hour, len(names))[number]
            features.append(
                feature(
                    "Point",
                    [longitude, latitude],
                    sensor=name,
                    count=round(count, 1) if counted else None,
                    counted_from=None if hour is None else str(hour.astype("datetime64[s]")),
                    expected=round(float(expected[number]), 1),
                )
            )
        return {"type": "FeatureCollection", "features": features}

    @cached_property
    def _places(self) -> dict[str, tuple[float, float]]:
        """Latitude and longitude of each sensor; of one that is paired with several streets, on the first of them."""
        return {name: (latitude, longitude) for name, latitude, longitude in reversed(sensor_places(self._venue))}
