"""The town that is served: routers, the clock, and the crowds as they are known now."""

import asyncio
import ctypes
import gc
import hashlib
import math
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from zoneinfo import ZoneInfo

import jax
import numpy as np
from pydantic_core import to_json

from sidestep import __version__, programs
from sidestep.crowds.live import LONGEST, LOOKBACK, LiveCount, LiveCounts, check_counts, is_late
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.wall_time import instant
from sidestep.errors import SidestepError
from sidestep.network.names import StreetNames
from sidestep.planners.registry import BASELINE, planner_infos
from sidestep.routing import live as walks
from sidestep.routing.clocks import TownClock
from sidestep.routing.directions import CROWDING
from sidestep.routing.formats import feature
from sidestep.routing.request import Departure, RouteRequest, at_fault, read_departure
from sidestep.routing.router import Router
from sidestep.scenarios.crowd_sources import sensor_places
from sidestep.scenarios.model import Scenario, read_objective
from sidestep.scenarios.places import Venue
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.walkers import WALKERS, read_walkers
from sidestep.server.count_formats import read_posted
from sidestep.server.desk import Desk
from sidestep.server.hints import Hinter
from sidestep.server.problems import ProblemError
from sidestep.server.settings import Settings
from sidestep.server.store import Store

T = TypeVar("T")
LEARNED = "darp"
"""Name of the planner that a model is."""
MOST_VARIANTS = 4
"""Routers for other walkers and objectives that are kept."""
AGED = timedelta(seconds=60)
"""After which crowds go on from the same counts anew: they have got older."""
LAPSES = timedelta(hours=1)
"""After which a simulated time no longer counts, unless it is set anew: a replay may have been killed."""
FEW = 50
"""Futures of answers that come with simulated times, where nobody asks for another number."""
MOST_MADE = 16
"""Such routers that are made until compiled programs are forgotten: many are made for one of them only."""
MOST_AT_ONCE = 5
"""Places of a route that nobody else needs to wait for: each takes a few milliseconds."""
AT_ONCE = 2
"""Questions that take long, answered side by side."""
MOST_WAITING = 32
"""Such questions that wait; more are refused."""
MOST_OF_ONE = 16
"""Such questions of one client."""
PATIENCE = 60.0
"""Seconds after which clients are told that an answer takes too long."""
SIZES = (1, 20, 50, 100, 200, 500, 1000)
"""Numbers of futures; others are rounded up, since programs are compiled for each."""
MOST_WORK = 10.0
"""Seconds of walking through futures that one question may take."""
WORK = {"expected": 1e-4, "shortest-path": 1e-4, "greedy-map": 1e-4, "forecast": 0.12}
"""Seconds of one walk through a future in a town of 2,500 streets, roughly."""
OTHERS_WORK = 2e-3
"""Those of planners that are not among them."""


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
        self.hinter, self.names = Hinter(self.town), StreetNames(self.town)
        self.zone = None if self.venue.timezone is None else ZoneInfo(self.venue.timezone)
        self._variants: OrderedDict[Scenario, Router] = OrderedDict()
        self._lock, self._making, self._made = threading.Lock(), threading.Lock(), 0
        self._clock: tuple[datetime, datetime, float] | None = None
        self.store = Store(settings.store_url(self.scenario.name))
        self.live = LiveCounts((), self.venue.timezone)
        self.counted = 0
        self._version, self._refreshed = -1, datetime.min.replace(tzinfo=UTC)
        self._heavy = Desk(AT_ONCE, MOST_WAITING, MOST_OF_ONE, PATIENCE)
        self._brief = Desk(1, 2 * MOST_WAITING, 2 * MOST_OF_ONE, PATIENCE)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors that crowds are known from."""
        return tuple(dict.fromkeys(self.router.sensors))

    def take_counts(self, body: bytes, content_type: str, seconds: float) -> dict[str, int]:
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
        now = self.instant
        counts = read_posted(body, content_type, self.venue.timezone, seconds)
        check_counts(counts, self.sensors, now)
        stored = Counter(self.store.put_counts(counts, datetime.now(UTC)))
        late = sum(is_late(count, now) for count in counts)
        return {
            "accepted": len(counts),
            **{word: stored[word] for word in ("new", "unchanged", "corrected")},
            "late": late,
        }

    def refresh(self) -> bool:
        """Let crowds go on from the latest counts, where there are others than before, or time has passed.

        Returns
        -------
        bool
            Whether anything changed.
        """
        version = self.store.version()
        if version != self._version:
            self._clock = self.store.clock()
        now = self.instant
        if version == self._version and abs(now - self._refreshed) < AGED:
            return False
        live = LiveCounts(tuple(self.store.counts_since(now - LOOKBACK)), self.venue.timezone)
        known, here = 0, self._local(now).replace(tzinfo=None)
        for router in (self.router, *self._variants.values()) if self.sensors else ():
            known = router.go_on_from(live, here)
        changed = version != self._version or known > 0
        self._version, self._refreshed, self.counted, self.live = version, now, known, live
        return changed

    @property
    def crowd_news(self) -> dict[str, Any]:
        """What is told of new crowds."""
        return {"version": self._version, "at": self._local(self._refreshed).isoformat(), "counted": self.counted}

    def _local(self, time: datetime) -> datetime:
        return time.astimezone(self.zone or UTC).replace(microsecond=0)

    @property
    def instant(self) -> datetime:
        """Now by the clock of the town, as UTC has it."""
        return self.now().astimezone(UTC)

    def sensor_features(self) -> dict[str, Any]:
        """What sensors counted in their last hour beside what is expected, as GeoJSON."""
        names, now = self.sensors, self.now().replace(tzinfo=None)
        latest = self.live.latest(names, now)
        expected = self.router.expected_counts(now)
        features = []
        for name, latitude, longitude in self.places:
            number = names.index(name)
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
    def places(self) -> list[tuple[str, float, float]]:
        """Where sensors stand: name, latitude and longitude; one may stand on several streets."""
        return sensor_places(self.venue)

    def warm(self) -> None:
        """Answer a question of each common kind, so that the first one of a client finds programs compiled."""
        self.quick.crowds(self.departs(None))
        longitude, latitude = self.town.place[0].tolist()
        self.quick.matrix([0], [self.quick.snapper.nearest(latitude, longitude)], self.departs(None))

    def prepare(self) -> None:
        """Compile what is asked later: crowds that go on from counts, and walks through simulated futures."""
        now = self.now()
        if self.sensors:
            counts = [LiveCount(name, self.instant - LONGEST, LONGEST.total_seconds(), 1.0) for name in self.sensors]
            Router(self.scenario).go_on_from(LiveCounts(tuple(counts), self.venue.timezone), now.replace(tzinfo=None))
        origin, destination = (tuple(place[::-1].tolist()) for place in self.town.place[self._far_apart])
        depart = self.asked("depart_at", None)
        self.router.plan(origin, destination, depart=depart, futures=FEW, alternatives=1)
        walk, _ = walks.begin(self.router, RouteRequest(origin, destination, depart))
        walks.report(self.router, walk, origin, 0.0 if depart is None else depart, density=0.0)

    @cached_property
    def _far_apart(self) -> list[int]:
        """A crossing, and one of those that are reached from it."""
        (seconds, _) = self.quick.matrix([0], list(range(min(self.town.nodes, 200))), self.departs(None))
        found = np.where(np.isfinite(seconds[0]), seconds[0], -1.0)
        return [0, int(found.argmax())]

    def routers(self, walker: str | None, objective: str | None) -> Router:
        """The router for a walker and an objective, as people write them; by default the scenario's own.

        Parameters
        ----------
        walker, objective
            Texts, or None.

        Returns
        -------
        Router
            Made once, as long as not too many others are asked for.

        Raises
        ------
        SidestepError
            Words that name none (field ``walker`` or ``objective``).
        """
        scenario = self._changed(walker, objective)
        if scenario == self.scenario:
            return self.router
        if (found := self._kept(scenario)) is not None:
            return found
        with self._making:
            if (found := self._kept(scenario)) is not None:
                return found
            found = Router(scenario)
            assert found.quick  # noqa: S101 - made here, where nobody waits for it
            if self.live.counts:
                found.go_on_from(self.live, self.now().replace(tzinfo=None))
            with self._lock:
                self._variants[scenario] = found
                if len(self._variants) > MOST_VARIANTS:
                    self._variants.popitem(last=False)
            self._made += 1
            if self._made % MOST_MADE == 0:
                forget_programs()
        return found

    def at_once(self, places: int, walker: str | None, depart_at: str | None) -> bool:
        """Whether quick routes through some places are found so soon that nobody else waits for them."""
        if places > MOST_AT_ONCE or not self.is_made(walker):
            return False
        router = self.routers(walker, None)
        return router.quick.tables.is_ready(self.departs(depart_at, router=router))

    def is_made(self, walker: str | None, objective: str | None = None) -> bool:
        """Whether a router for a walker and an objective is there already."""
        scenario = self._changed(walker, objective)
        return scenario == self.scenario or self._kept(scenario) is not None

    def _kept(self, scenario: Scenario) -> Router | None:
        with self._lock:
            found = self._variants.get(scenario)
            if found is not None:
                self._variants.move_to_end(scenario)
        return found

    def futures(self, planner: str | None, asked: int, times: int = 1) -> int:
        """Find out how many futures are simulated.

        Parameters
        ----------
        planner
            Who walks through them; None: the default.
        asked
            How many are asked for.
        times
            How often they are walked through.

        Returns
        -------
        int
            The next of ``SIZES``.

        Raises
        ------
        ProblemError
            Planners that are not offered (field ``planner``), and more walks than one question may take (``futures``).
        """
        name = planner or (LEARNED if self.has_model else BASELINE)
        if name not in self.facts["planners"]:
            raise ProblemError(400, f"planner must be one of {', '.join(self.facts['planners'])}", field="planner")
        size = next(each for each in SIZES if each >= asked)
        most = int(MOST_WORK / WORK.get(name, OTHERS_WORK))
        if size * times > most:
            said = f"{size} futures are too many here for the planner {name}"
            fits = [each for each in SIZES if each * times <= most]
            said += f"; ask for {fits[-1]} at most" if fits else "; choose another planner"
            raise ProblemError(400, said, field="futures")
        return size

    def most_walks(self, planner: str | None, futures: int) -> int:
        """How often a planner may walk through some futures in one question."""
        return int(MOST_WORK / WORK.get(planner or BASELINE, OTHERS_WORK)) // futures

    def _changed(self, walker: str | None, objective: str | None) -> Scenario:
        changes: dict[str, Any] = {}
        if walker is not None:
            with at_fault("walker"):
                walkers = read_walkers(walker, self.scenario.walker)
            if len(walkers) != 1:
                raise ProblemError(400, "one walker walks at a time", field="walker")
            changes["walker"] = walkers[0]
        if objective is not None:
            with at_fault("objective"):
                changes["objective"] = read_objective(objective)
        return self.scenario.changed(**changes) if changes else self.scenario

    def now(self) -> datetime:
        """Local time, by the clock of the town or the one that a replay has set."""
        real, clock = datetime.now(self.zone or UTC), self._simulated
        if clock is None:
            return real
        simulated, since, speed = clock
        return (simulated + (real - since) * speed).astimezone(self.zone or UTC)

    @property
    def _simulated(self) -> tuple[datetime, datetime, float] | None:
        """The clock that a replay has set, as long as it sets it anew: it may have been killed."""
        clock = self._clock
        return None if clock is None or datetime.now(UTC) - clock[1] > LAPSES else clock

    def set_clock(self, now: datetime, speed: float) -> None:
        """Go by a simulated time, in all processes.

        Parameters
        ----------
        now
            Local time where it has no offset.
        speed
            Seconds of it in each second.

        Raises
        ------
        SidestepError
            An hour that clocks leave out or repeat, given without an offset (field ``now``).
        StoreError
            A store that takes nothing at the moment.
        """
        with at_fault("now"):
            there, since = instant(now, self.venue.timezone), datetime.now(UTC)
        self.store.set_clock(there, since, speed)
        self._clock = there, since, speed

    def reset_clock(self) -> None:
        """Go by the time of the computer again."""
        self.store.clear_clock()
        self._clock = None

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
                return router.clock(self.now() if router.flow.timed else None)
            return router.clock(read_departure(given))

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
            return self.now().replace(second=0, microsecond=0) if self.router.flow.timed else None
        with at_fault(field):
            return read_departure(given)

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
    def streets_json(self) -> tuple[bytes, str]:
        """The same as text, and its entity tag."""
        text = to_json(self.streets)
        return text, f'"{hashlib.sha256(text).hexdigest()[:16]}"'

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
            "planners": planners + [LEARNED] * self.has_model,
            "walkers": list(WALKERS),
            "objectives": ["time", "distance", "exposure"],
            "crowding": [{"word": word, "limit": limit if math.isfinite(limit) else None} for limit, word in CROWDING],
            "horizon_minutes": scenario.horizon / 60,
            "sensors": len(self.sensors),
            "streets": town.streets,
            "version": __version__,
        }

    @property
    def clock_facts(self) -> dict[str, Any]:
        """The local time by which the server goes."""
        now, clock = self.now(), self._simulated
        speed = 1.0 if clock is None else clock[2]
        said = {"now": now.isoformat(timespec="seconds"), "speed": speed, "simulated": clock is not None}
        return {**said, "hour_of_week": round(time_of_week(now), 4)}

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


def forget_programs() -> None:
    """Forget compiled programs, and give the system what they took; those that are needed are read from disk again."""
    programs.clear_caches()
    jax.clear_caches()  # type: ignore[no-untyped-call]
    gc.collect()
    with suppress(OSError, AttributeError):  # systems without glibc
        ctypes.CDLL(None).malloc_trim(0)
