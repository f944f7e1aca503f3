"""Expected times to cross all streets from an hour on, as tables that one search reads in a few microseconds."""

import math
from collections import OrderedDict
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from threading import Lock
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.base import FlowModel
from sidestep.crowds.profile import HOURS_OF_WEEK
from sidestep.crowds.wall_time import seconds_between
from sidestep.environment.crossing import as_expected
from sidestep.environment.types import EnvParams
from sidestep.network.graph import RoadNetwork
from sidestep.planners.time_dependent import STEP
from sidestep.programs import on_device, program
from sidestep.routing.clocks import TownClock
from sidestep.routing.paces import Paces
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import Scenario
from sidestep.walking.crossing_time import crosser
from sidestep.walking.opening import OpeningTimes, Timetables

HOUR = 3600.0
AHEAD = 2 * HOUR
"""Seconds of departures that a table is for."""
KEPT = 2**28
"""Bytes of tables with their potentials that are kept, those asked for last; two at least."""
POTENTIALS = 2**24
"""Bytes of potentials that each table keeps."""

Row: TypeAlias = "memoryview[float] | list[float]"
"""One number for each segment, single precision; read one by one, they are plain numbers sooner than NumPy's."""


@dataclass(eq=False)
class StreetTimes:
    """Expected times on all segments, entered as steps begin; linear in between, constant after the last step."""

    network: RoadNetwork
    hour: float
    """Hour of the week at clock 0."""
    step_seconds: float
    seconds: Float[np.ndarray, "step segment"]
    """From coming to a segment, if it is open, to its end, in s."""
    waits: Float[np.ndarray, "step segment"] | None
    """Of that the wait for traffic before the segment; None where nobody waits."""
    gates: Timetables | None
    """When segments are open; None where all always are."""
    density: Float[np.ndarray, "segment slot"]
    """Expected persons/m²."""
    slot_seconds: float
    _potentials: "OrderedDict[int, tuple[float, Row]]" = field(default_factory=OrderedDict)
    _lock: Lock = field(default_factory=Lock)

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        tables = sum(each.nbytes for each in (self.seconds, self.waits, self.density) if each is not None)
        return tables + len(self._potentials) * 8 * self.network.nodes

    @cached_property
    def rows(self) -> list[Row]:
        """Seconds by step."""
        return [memoryview(row.data) for row in self.seconds]

    @cached_property
    def least(self) -> Float[np.ndarray, " segment"]:
        """The fewest seconds from coming to each segment to its end, at any clock."""
        return self.seconds.min(axis=0).astype(np.float64)

    @cached_property
    def _backwards(self) -> object:
        """Least times from head to tail as SciPy's sparse matrix."""
        from scipy.sparse import csr_array

        network = self.network
        used = np.asarray(network.exit_segment)[np.asarray(network.valid)]
        tail, head = np.asarray(network.tail)[used], np.asarray(network.head)[used]
        order = np.lexsort((self.least[used], head, tail))
        tail, head, least = tail[order], head[order], self.least[used][order]
        first = np.append(True, (np.diff(tail) != 0) | (np.diff(head) != 0))  # of parallel segments the fastest
        return csr_array((least[first], (head[first], tail[first])), shape=(network.nodes, network.nodes))

    @property
    def lasts(self) -> float:
        """Seconds from clock 0 to the end of the last step."""
        return self.step_seconds * len(self.seconds)

    @cached_property
    def pace(self) -> float:
        """The fewest seconds for a metre, in the mean over all metres."""
        return float(self.least.sum() / np.asarray(self.network.length).sum(dtype=np.float64))

    def prepare(self) -> None:
        """Work out what the first search would."""
        _ = self.rows, self._backwards  # kept from now on

    def potential(self, node: int, within: float = math.inf) -> Row:
        """A lower bound of the seconds from every node to one of them, whatever the clock: what guides a search.

        Parameters
        ----------
        node
            Where walks end.
        within
            Seconds up to which bounds are the least times themselves. From nodes farther away the bound is as much, or
            more where more was asked for before: a large town is not searched as a whole for a short walk.

        Returns
        -------
        Row
            One number for each node; infinite where no path leads to it, unless bounds have an end.
        """
        with self._lock:
            farthest, found = self._potentials.get(node, (-math.inf, []))
            if farthest >= within:
                self._potentials.move_to_end(node)
                return found
        from scipy.sparse.csgraph import dijkstra

        seconds = dijkstra(self._backwards, indices=node, limit=within)
        found = np.minimum(seconds, within, out=seconds).data
        with self._lock:
            self._potentials[node] = within, found
            self._potentials.move_to_end(node)
            while len(self._potentials) * 8 * self.network.nodes > POTENTIALS:
                self._potentials.popitem(last=False)
        return found

    def at(self, table: Float[np.ndarray, "step segment"] | None, segment: int, clock: float) -> float:
        """Read a table of this object at a clock in s; 0 where there is none.

        Parameters
        ----------
        table, segment, clock
            The table, and where and when.

        Returns
        -------
        float
            Seconds.
        """
        if table is None:
            return 0.0
        last = len(table) - 1
        position = min(clock / self.step_seconds, last)
        step = int(position)
        before, after = float(table[step, segment]), float(table[min(step + 1, last), segment])
        return before + (position - step) * (after - before)

    def until_open(self, segment: int, clock: float) -> float:
        """Seconds until a segment opens that somebody comes to at a clock in s."""
        return 0.0 if self.gates is None else self.gates.until_open(self.hour, segment, clock)

    def densities(self, clock: float) -> Float[np.ndarray, " segment"]:
        """Expected persons/m² on all segments at a clock in s."""
        return self.density[:, min(int(clock // self.slot_seconds), self.density.shape[1] - 1)]

    def density_at(self, segment: int, clock: float) -> float:
        """Expected persons/m² on a segment at a clock in s."""
        return float(self.densities(clock)[segment])


@program()
def _tabulated(params: EnvParams, clocks: Float[Array, " step"]) -> tuple[Array, Array, Array]:
    """Seconds from coming to segments to their ends, the waits for traffic in them, and all densities."""
    every, hour = jnp.arange(params.network.segments), jnp.int32(0)
    wait, expected = params.wait_in(hour), params.futures.speeds.of(hour)
    cross = crosser(expected, params.network.length, params.rule)

    def at(clock: Float[Array, ""]) -> tuple[Array, Array]:
        come = jnp.full(every.shape, clock)
        waited = jnp.broadcast_to(wait(every, come), every.shape)
        return waited + cross(come + waited), waited

    return *jax.lax.map(at, clocks), expected.known_density


def street_times(
    scenario: Scenario, scenario_map: ScenarioMap, hour: float, pace: Float[Array, "segment step"] | None
) -> StreetTimes:
    """Tabulate the expected times on all segments.

    Parameters
    ----------
    scenario, scenario_map
        The problem, and its map.
    hour
        Hour of the week at clock 0.
    pace
        Mean seconds for each metre from then on (:func:`sidestep.scenarios.expectation.expected_pace`); None: they are
        worked out.

    Returns
    -------
    StreetTimes
        For departures within ``AHEAD`` of clock 0, and walks as long as the horizon.
    """
    params = make_environment(
        scenario, scenario_map, "test", 1, destinations=np.array([[0]]), hours=[hour], pace=pace, densities=True
    )
    alone, gates = as_expected(params), None
    if isinstance(alone.waits, OpeningTimes):
        gates, alone = alone.waits.timetables(), replace(alone, waits=alone.waits.traffic)
    # Between slots, means over chance change slowly, and certain crowds do not.
    every = 1 if alone.futures.speeds.expected else math.ceil(scenario.slot_seconds / STEP)
    step = scenario.slot_seconds / every
    clocks = on_device(np.arange(every * scenario.slots) * step)
    seconds, waits, density = (np.asarray(each) for each in _tabulated(alone, clocks))
    return StreetTimes(
        network=scenario_map.network,
        hour=hour,
        step_seconds=step,
        seconds=np.ascontiguousarray(seconds),
        waits=np.ascontiguousarray(waits) if waits.any() else None,
        gates=gates,
        density=np.ascontiguousarray(density),
        slot_seconds=scenario.slot_seconds,
    )


class Tables:
    """The expected times on one map, hour by hour of the week, and those that go on from current counts.

    Tables begin in the middles of hours, between which expected crowds are interpolated. So all departures of an hour
    share one. Several threads may share this object.

    Parameters
    ----------
    scenario, scenario_map
        The problem, and its map.
    paces
        Expected paces on the same map.
    """

    def __init__(self, scenario: Scenario, scenario_map: ScenarioMap, paces: Paces) -> None:
        self._scenario, self.horizon = scenario.changed(departures=(0.0, AHEAD)), scenario.horizon
        self._map, self._paces = scenario_map, paces
        self._covers = lru_cache(maxsize=2 * HOURS_OF_WEEK)(
            lambda hour: scenario_map.flow.timed and scenario_map.flow.covers(hour)
        )
        self._kept: OrderedDict[float, StreetTimes] = OrderedDict()
        self._lock, self._making = Lock(), Lock()
        self._live: tuple[TownClock, StreetTimes, float] | None = None

    def at(self, clock: TownClock) -> tuple[StreetTimes, float]:
        """Find the table for a departure.

        Parameters
        ----------
        clock
            When the walk begins: clock 0 is the departure.

        Returns
        -------
        StreetTimes, float
            The table, and the departure in s since its clock 0. Where current counts are known, departures soon
            after them go on from these.
        """
        if (live := self._going_on(clock)) is not None:
            return live
        begins = self._begins(clock.hour)
        return self._table(begins), (clock.hour - begins) % HOURS_OF_WEEK * HOUR

    def is_ready(self, clock: TownClock) -> bool:
        """Whether the table for a departure is there; otherwise it takes a while to work it out."""
        return self._going_on(clock) is not None or self._begins(clock.hour) in self._kept

    def _going_on(self, clock: TownClock) -> tuple[StreetTimes, float] | None:
        """The table that goes on from current counts, if the departure is soon after them."""
        live = self._live
        if live is not None and clock.date is not None:
            begins, table, lasts = live
            if begins.date is not None:
                ahead = seconds_between(begins.date, clock.date, clock.timezone)
                if 0 <= ahead <= lasts:
                    return table, ahead
        return None

    def _begins(self, hour: float) -> float:
        """Hour of the week at which the table for a departure begins."""
        middle = (math.floor(hour - 0.5) + 0.5) % HOURS_OF_WEEK
        # Tables of crowds that do not cover the middle begin with the departure itself.
        return middle if self._covers(middle) else hour

    def _table(self, hour: float) -> StreetTimes:
        if (found := self._look_up(hour)) is not None:
            return found
        with self._making:  # one at a time, or two threads would work out the same; others are found meanwhile
            if (found := self._look_up(hour)) is not None:
                return found
            found = street_times(self._scenario, self._map, hour, self._paces.at(self._scenario, hour))
            found.prepare()
            with self._lock:
                self._kept[hour] = found
        return found

    def _look_up(self, hour: float) -> StreetTimes | None:
        with self._lock:
            found = self._kept.get(hour)
            if found is not None:
                self._kept.move_to_end(hour)
            while len(self._kept) > 2 and sum(table.nbytes for table in self._kept.values()) > KEPT:
                self._kept.popitem(last=False)
        return found

    def go_on_from(self, flow: FlowModel, clock: TownClock, lasts: float) -> None:
        """From now on, let departures soon after a clock go on from current counts.

        The table is worked out first, and others are served meanwhile from the one before.

        Parameters
        ----------
        flow
            Crowds that go on from the counts.
        clock
            Clock 0 of these crowds, with its date.
        lasts
            Seconds from then on until departures know of no count any more.
        """
        here = replace(self._map, flow=flow, test_flow=flow)
        table = street_times(self._scenario, here, clock.hour, None)
        table.prepare()  # in this thread: in a large town the first route would take a third of a second
        self._live = clock, table, min(lasts, AHEAD)

    def forget_counts(self) -> None:
        """From now on, let crowds be those of the hour of the week."""
        self._live = None
