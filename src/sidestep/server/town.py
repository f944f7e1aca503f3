"""The town that is served: routers, the clock, and the crowds as they are known now."""

import asyncio
import math
from collections.abc import Callable, Iterator
from datetime import datetime
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic_core import to_json

from sidestep import __version__
from sidestep.crowds.live import LONGEST, LiveCount, LiveCounts
from sidestep.errors import SidestepError
from sidestep.network.names import StreetNames
from sidestep.planners.registry import BASELINE, planner_infos
from sidestep.routing import live as walks
from sidestep.routing.clocks import TownClock
from sidestep.routing.directions import CROWDING
from sidestep.routing.formats import feature
from sidestep.routing.request import Departure, RouteRequest, at_fault, read_departure
from sidestep.routing.router import Router
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Venue
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.walkers import WALKERS
from sidestep.server.clock import ServerClock
from sidestep.server.counting import Counting
from sidestep.server.desk import Desk
from sidestep.server.documents import Document
from sidestep.server.effort import futures_of
from sidestep.server.hints import Hinter
from sidestep.server.problems import GeoJsonResponse, ProblemError
from sidestep.server.settings import Settings
from sidestep.server.store import Store
from sidestep.server.variants import Variants

T = TypeVar("T")
LEARNED = "darp"
"""Name of the planner that a model is."""
FEW = 50
"""Futures of answers that come with simulated times, where nobody asks for another number."""
MOST_AT_ONCE = 2
"""Places of a route that nobody else needs to wait for: the next ones may be reached in an hour without a table."""
AT_ONCE = 2
"""Questions that take long, answered side by side."""
MOST_WAITING = 32
"""Such questions that wait; more are refused."""
MOST_OF_ONE = 16
"""Such questions of one client."""
PATIENCE = 60.0
"""Seconds after which clients are told that an answer takes too long."""


def venue_of(scenario: Scenario) -> Venue:
    """The place of a scenario; SidestepError (field ``scenario``) where it has no coordinates."""
    if isinstance(scenario.place, Venue):
        return scenario.place
    said = f"{scenario.name} is a grid without coordinates; serve a scenario with real streets, such as helsinki"
    raise SidestepError(said, field="scenario")


class ServedTown:
    """What the server knows of its town.

    Parameters
    ----------
    settings
        Of the server.

    Raises
    ------
    SidestepError
        A scenario or model that is not there, or without coordinates (field ``scenario``).
    """

    def __init__(self, settings: Settings) -> None:
        self.scenario = find_scenario(settings.scenario)
        self.venue = venue_of(self.scenario)
        self.router = Router(self.scenario, model=None if settings.model is None else Path(settings.model))
        self.has_model = settings.model is not None
        self.quick = self.router.quick
        self.town = self.quick.snapper.town
        self.hinter, self.names = Hinter(self.quick.snapper), StreetNames(self.town)
        self.store = Store(settings.store_url(self.scenario.name))
        self.clock = ServerClock(self.venue.timezone, self.store)
        self.counting = Counting(self.venue, self.router, self.store, self.clock)
        self.variants = Variants(self.router, self.counting.begin)
        self._heavy = Desk(AT_ONCE, MOST_WAITING, MOST_OF_ONE, PATIENCE)
        self._brief = Desk(1, 2 * MOST_WAITING, 2 * MOST_OF_ONE, PATIENCE)

    def refresh(self) -> bool:
        """Let crowds go on from the latest counts, and say whether anything changed; as :meth:`Counting.refresh`."""
        return self.counting.refresh(self.variants)

    def warm(self) -> None:
        """Answer a question of each common kind, so that the first one of a client finds programs compiled."""
        assert self.streets_document.zipped  # noqa: S101 - made here, where nobody waits for it
        self.quick.crowds(self.departs(None))
        longitude, latitude = self.town.place[0].tolist()
        self.quick.matrix([0], [self.quick.snapper.nearest(latitude, longitude)], self.departs(None))

    def prepare(self) -> Iterator[Callable[[], object]]:
        """Compile what is asked later: crowds that go on from counts, and walks through simulated futures.

        Yields
        ------
        Callable
            One step after the other, so that a server may stop between them.
        """
        now, seconds = self.clock.instant, LONGEST.total_seconds()
        if sensors := self.counting.sensors:
            counts = tuple(LiveCount(name, now - LONGEST, seconds, 1.0) for name in sensors)
            here = self.clock.local(now).replace(tzinfo=None)
            yield lambda: Router(self.scenario).go_on_from(LiveCounts(counts, self.venue.timezone), here)
        origin, destination = (tuple(place[::-1].tolist()) for place in self.town.place[self._far_apart])
        depart = self.asked("depart_at", None)
        for alternatives in (0, 1):
            yield partial(self.router.plan, origin, destination, depart=depart, futures=FEW, alternatives=alternatives)
        walk, _ = walks.begin(self.router, RouteRequest(origin, destination, depart))
        yield partial(walks.report, self.router, walk, origin, 0.0 if depart is None else depart, density=0.0)

    @cached_property
    def _far_apart(self) -> list[int]:
        """A crossing, and one of those that are reached from it."""
        (seconds, _) = self.quick.matrix([0], list(range(min(self.town.nodes, 200))), self.departs(None))
        found = np.where(np.isfinite(seconds[0]), seconds[0], -1.0)
        return [0, int(found.argmax())]

    def at_once(self, places: int, walker: str | None, depart_at: str | None) -> bool:
        """Whether quick routes through some places are found so soon that nobody else waits for them."""
        if places > MOST_AT_ONCE or not self.variants.is_made(walker):
            return False
        router = self.variants.router(walker, None)
        return router.quick.tables.is_ready(self.departs(depart_at, router=router))

    def departs(self, given: str | None, field: str = "depart_at", router: Router | None = None) -> TownClock:
        """Read a local time.

        Parameters
        ----------
        given
            As people write it; None: now.
        field
            The parameter.
        router
            Whose crowds it is for.

        Returns
        -------
        TownClock
            Clock 0 is that time.

        Raises
        ------
        SidestepError
            What is no local time, and times of which crowds know nothing (with the field).
        """
        router = router or self.router
        with at_fault(field):
            if given is None:
                return router.clock(self._now() if router.flow.timed else None)
            return router.clock(read_departure(given, today=self.clock.wall, grids=False))

    def _now(self) -> datetime:
        """Now, with an offset where the town has a timezone: of an hour that its clocks show twice only that tells."""
        return self.clock.wall if self.venue.timezone is None else self.clock.now()

    def asked(self, field: str, given: str | None) -> Departure | None:
        """Read a local time for a router, which takes None where crowds know no times.

        Parameters
        ----------
        field, given
            The parameter, and its text; None: now.

        Returns
        -------
        Departure or None
            The time.

        Raises
        ------
        SidestepError
            What is no local time (with the field).
        """
        if given is None:
            # Minute by minute, what is expected is kept.
            return self._now().replace(second=0, microsecond=0) if self.router.flow.timed else None
        return read_departure(given, field, self.clock.wall, grids=False)

    @cached_property
    def streets(self) -> dict[str, Any]:
        """All streets as a GeoJSON feature collection."""
        town = self.town
        columns = zip(town.name, town.kind, town.length.tolist(), strict=True)
        features = [
            feature(
                "LineString",
                np.round(town.course(street), 6).tolist(),
                street=street,
                name=name,
                kind=kind,
                metres=round(metres, 1),
            )
            for street, (name, kind, metres) in enumerate(columns)
        ]
        return {"type": "FeatureCollection", "attribution": town.attribution, "features": features}

    @cached_property
    def streets_document(self) -> Document:
        """The same as text."""
        return Document(to_json(self.streets), GeoJsonResponse.media_type)

    @cached_property
    def facts(self) -> dict[str, Any]:
        """What is served, whose it is, and what may be asked."""
        town, scenario = self.town, self.scenario
        (west, south), (east, north) = town.place.min(axis=0).tolist(), town.place.max(axis=0).tolist()
        planners = [name for name, info in planner_infos().items() if info.level != "hindsight" and not info.learns]
        return {
            "scenario": scenario.name,
            "summary": scenario.summary,
            "bounds": [west, south, east, north],
            "attribution": town.attribution,
            "crowds": self.venue.attribution,
            "synthetic": self.venue.synthetic,
            "timezone": self.venue.timezone,
            "timed": self.router.flow.timed,
            "planners": planners + [LEARNED] * self.has_model,
            "walkers": list(WALKERS),
            "objectives": ["time", "distance", "exposure"],
            "crowding": [{"word": word, "limit": limit if math.isfinite(limit) else None} for limit, word in CROWDING],
            "horizon_minutes": scenario.horizon / 60,
            "sensors": len(self.counting.sensors),
            "streets": town.streets,
            "version": __version__,
        }

    def exactly(self, field: str, given: str | None) -> Departure | None:
        """Read a local time to the second, as :meth:`asked`."""
        if given is None:
            return self._now() if self.router.flow.timed else None
        return read_departure(given, field, grids=False)

    def futures(self, planner: str | None, asked: int, times: int = 1) -> int:
        """Find out how many futures are simulated, as :func:`~sidestep.server.effort.futures_of`."""
        return futures_of(self.planner_name(planner), asked, times)

    def planner_name(self, planner: str | None) -> str:
        """Who plans: the planner that is asked for, or the default.

        Parameters
        ----------
        planner
            As it is asked for.

        Returns
        -------
        str
            Its name.

        Raises
        ------
        ProblemError
            One that is not offered (field ``planner``).
        """
        found = planner or (LEARNED if self.has_model else BASELINE)
        if found == LEARNED and not self.has_model:
            said = "this server has no trained model for the planner darp"
            raise ProblemError(400, f"{said}; start it with sidestep serve --model DIR", field="planner")
        if found not in self.facts["planners"]:
            said = f"planner must be one of {', '.join(self.facts['planners'])}, not {found!r:.60}"
            raise ProblemError(400, said, field="planner")
        return found

    async def stored(self, answer: Callable[[], T]) -> T:
        """Ask the store in a thread, since it may have to wait for a disk or a network."""
        return await asyncio.to_thread(answer)

    async def heavily(self, answer: Callable[[], T]) -> T:
        """Answer a question that takes long in a thread, a few at a time.

        Parameters
        ----------
        answer
            Works it out.

        Returns
        -------
        T
            What that returns.

        Raises
        ------
        ProblemError
            503 where too many wait already, or it takes too long.
        """
        return await self._heavy.answer(answer)

    async def briefly(self, answer: Callable[[], T]) -> T:
        """Answer a question that takes less than a second or so, past those that take longer; as :meth:`heavily`."""
        return await self._brief.answer(answer)

    def close(self) -> None:
        """Answer no more."""
        self._heavy.close()
        self._brief.close()
        self.store.close()
