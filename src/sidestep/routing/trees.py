"""The paths from one place to everywhere: which they are, and how long they take in many futures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sidestep.environment.cost_to_go import at_clock
from sidestep.environment.crossing import as_expected, cross, crossings
from sidestep.environment.types import EnvParams
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.planners.base import Planner
from sidestep.planners.shortest_path import ShortestPath, metres_at
from sidestep.planners.time_dependent import ROUNDING, earliest_arrivals, leaving, steps_in_slot
from sidestep.routing.located import Located, OnSegments
from sidestep.scenarios.futures import make_environment
from sidestep.walking.objective import Crossing

MINUTE, MILLISECOND = 60.0, 1e-3
NAMES: dict[float | None, str] = {None: "expected", 0.5: "p50", 0.9: "p90"}
"""What times are called within which walks arrive in a share of the futures, and if crowds are as expected."""

Nodes = Int[Array, " node"]
Labels = Float[Array, " node"]


def least_costs(
    network: RoadNetwork, crossed: Crossing, slot_seconds: float, origin: Int[Array, ""], departure: Float[Array, ""]
) -> tuple[Labels, Labels, Nodes]:
    """Find paths of low cost to every node: of the paths to each node before, the cheapest one goes on.

    They are the best ones where cost is time, since nobody who enters a segment later leaves it earlier. For other
    objectives a better path may begin with a worse one, which reaches its second half when that is less crowded.

    Parameters
    ----------
    network
        The streets.
    crossed, slot_seconds
        Each segment, entered as each slot or step of it begins, arrays [slot, segment]; and its length in s.
    origin, departure
        Where the walk begins, and at which clock.

    Returns
    -------
    label, clock : Float[Array, " node"]
        Cost from the origin, infinite where no path leads; and the clock on arrival.
    via : Int[Array, " node"]
        The last segment of the path to each node; -1 where there is none.
    """
    every, tail, head = jnp.arange(network.segments), network.tail, network.head
    walked = jnp.zeros(network.segments, bool).at[network.exit_segment].max(network.exits_from(origin))

    def further(carry: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        label, clock, via, _ = carry
        goes = walked & jnp.isfinite(label[tail])
        cost, seconds = (at_clock(each, slot_seconds, clock[tail], every) for each in (crossed.cost, crossed.seconds))
        there = jnp.where(goes, label[tail] + cost, jnp.inf)
        best = label.at[head].min(there)
        reached = jnp.where((there <= best[head] * (1 + ROUNDING)) & (there < label[head]), head, network.nodes)
        clock = clock.at[reached].set(clock[tail] + seconds, mode="drop")
        return best, clock, via.at[reached].set(every, mode="drop"), (best < label).any()

    start = jnp.full(network.nodes, jnp.inf).at[origin].set(0.0)
    begin = (start, jnp.full(network.nodes, departure), jnp.full(network.nodes, ABSENT), jnp.bool_(True))
    label, clock, via, _ = jax.lax.while_loop(lambda carry: carry[3], further, begin)
    return label, clock, via


@partial(jax.jit, static_argnames="by_length")
def _paths_from(
    params: EnvParams, origin: Int[Array, ""], departure: Float[Array, ""], *, by_length: bool
) -> tuple[Nodes, Nodes, Labels]:
    """Find the paths from a node to all others by expected times.

    Parameters
    ----------
    params
        The environment, with the expected times as its only future.
    origin, departure
        Where the walks begin, and at which clock.
    by_length
        Whether the shortest paths are wanted, and not the best ones by the objective.

    Returns
    -------
    via : Int[Array, " node"]
        The last segment of the path to each node; -1 where there is none.
    order : Int[Array, " node"]
        All nodes, each after the one before it on its path.
    arrival : Float[Array, " node"]
        Clock on arrival; infinite where no path leads.
    """
    network, future = params.network, jnp.int32(0)
    wait, speeds = params.wait_in(future), params.futures.speeds
    if by_length:
        length = metres_at(params, params.futures.hour[future], departure)
        label, via = earliest_arrivals(
            network, lambda segment, metres: metres + length[segment], origin, jnp.float32(0)
        )
    elif params.objective.needs_density:
        field = speeds.of(future)
        every = steps_in_slot(params, field.slot_seconds)
        crossed, seconds = crossings(params, field, wait, every=every), field.slot_seconds / every
        label, _, via = least_costs(network, crossed, seconds, origin, departure)
    else:
        leave = leaving(network, speeds, future, params.rule, wait)
        arrival, via = earliest_arrivals(network, leave, origin, departure)
        return via, jnp.argsort(arrival), arrival
    order = jnp.argsort(label)
    return via, order, _arrivals_along(params, via, order, origin, departure)[:, 0]


@jax.jit
def _arrivals_along(
    params: EnvParams, via: Nodes, order: Nodes, origin: Int[Array, ""], departure: Float[Array, ""]
) -> Float[Array, "node future"]:
    """Walk given paths to all nodes through every future, node by node: each path goes on from the one before it.

    Parameters
    ----------
    params
        The environment.
    via, order
        The paths, as of :func:`_paths_from`.
    origin, departure
        Where they begin, and at which clock.

    Returns
    -------
    Float[Array, "node future"]
        Clock on arrival in each future; infinite where no path leads.
    """
    network, futures = params.network, jnp.arange(params.futures.count)

    def leave(future: Int[Array, ""], segment: Int[Array, ""], clock: Float[Array, ""]) -> Float[Array, ""]:
        return leaving(network, params.futures.speeds, future, params.rule, params.wait_in(future))(segment, clock)

    def reach(arrival: Float[Array, "node future"], node: Int[Array, ""]) -> tuple[Float[Array, "node future"], None]:
        segment = via[node]
        clock = arrival[network.tail[segment]]
        goes = (segment >= 0) & jnp.isfinite(clock)
        # Nobody enters at infinity, so what is not entered is computed at clock 0 and then ignored.
        there = jax.vmap(leave, (0, None, 0))(futures, segment, jnp.where(goes, clock, 0.0))
        return arrival.at[node].set(jnp.where(goes, there, arrival[node])), None

    start = jnp.full((network.nodes, params.futures.count), jnp.inf).at[origin].set(departure)
    return jax.lax.scan(reach, start, order)[0]


@jax.jit
def _lasting(params: EnvParams, clock: Float[Array, " segment"]) -> Float[Array, "2 segment"]:
    """Seconds that segments take in the only future, come to at these finite clocks: the wait before them, and all."""
    every, wait = jnp.arange(params.network.segments), params.wait_in(jnp.int32(0))
    seconds = jax.vmap(lambda segment, at: cross(params, jnp.int32(0), segment, at).seconds)(every, clock)
    return jnp.stack([jnp.broadcast_to(wait(every, clock), seconds.shape), seconds])


def minutes_or_none(seconds: Float[np.ndarray, "*n"]) -> list[Any]:
    """Minutes to a thousandth, as lists; None instead of infinity."""
    minutes = np.round(seconds / MINUTE, 3).astype(object)
    minutes[~np.isfinite(seconds)] = None
    return minutes.tolist()


class Paths:
    """Walks from one place to everywhere, by paths that are fixed beforehand.

    Parameters
    ----------
    located
        The streets, the crowds and the departure.
    planner
        ``expected`` or ``shortest-path``: whose paths are walked.
    futures
        How many to simulate; None: crowds are as expected.
    """

    def __init__(self, located: Located, planner: Planner, futures: int | None) -> None:
        self._params = make_environment(
            located.scenario,
            located.scenario_map,
            "test",
            futures or 1,
            destinations=np.array([[0]]),
            hours=located.hours,
            pace=located.pace,
        )
        self._alone = as_expected(self._params)
        self._by_length = isinstance(planner, ShortestPath)
        self._clock, self._horizon = located.clock, located.scenario.horizon
        self.shares: tuple[float | None, ...] = (None,) if futures is None else tuple(NAMES)
        """Shares of the futures that are asked about; None stands for expected times."""

    def reach(self, node: int, ends: Sequence[int] | None = None) -> "Reach":
        """Walk from a node to all others.

        A search for all nodes at once goes no further where it leaves a restricted area, but walks that end in the area
        may come back to it. So areas that offer a short cut are searched again, each as if everybody might walk there.

        Parameters
        ----------
        node
            Where walks begin.
        ends
            The nodes that matter; by default all.

        Returns
        -------
        Reach
            The walks.
        """
        reach = self._searched(node, self.network)
        area_of = np.full(self.network.nodes, ABSENT) if self.network.area is None else np.asarray(self.network.area)
        areas = np.unique(area_of if ends is None else area_of[np.asarray(ends)])
        prune = not (self._by_length or self._alone.objective.needs_density)
        for area in reach.short_cuts(areas[areas >= 0], prune=prune):
            again = self._searched(node, self.network.opened(area))
            seconds = {
                share: np.where(area_of == area, again.seconds[share], found) for share, found in reach.seconds.items()
            }
            reach = replace(reach, seconds=seconds, again=(*reach.again, (area, again)))
        return reach

    def _searched(self, node: int, network: RoadNetwork) -> "Reach":
        """The walks by one search, on streets that may be open to more."""
        alone = replace(self._alone, network=network).begun_at(node)
        origin, departure = jnp.int32(node), jnp.float32(self._clock)
        via, order, expected = _paths_from(alone, origin, departure, by_length=self._by_length)
        seconds: dict[float | None, Float[np.ndarray, " node"]] = {None: np.asarray(expected, np.float64) - self._clock}
        if len(self.shares) > 1:
            params = self._params.begun_at(node)
            walked = np.asarray(_arrivals_along(params, via, order, origin, departure), np.float64) - self._clock
            goes = np.isfinite(walked).all(axis=1)
            for share, row in zip((0.5, 0.9), np.quantile(walked[goes], (0.5, 0.9), axis=1), strict=True):
                seconds[share] = np.full(len(walked), np.inf)
                seconds[share][goes] = row
        within = {share: np.where(each <= self._horizon, each, np.inf) for share, each in seconds.items()}
        return Reach(self, node, np.asarray(via), within)

    def lasting(self, node: int, begins: Float[np.ndarray, " segment"]) -> Float[np.ndarray, "2 segment"]:
        """Seconds that segments take if crowds are as expected.

        Parameters
        ----------
        node
            Where walks begin.
        begins
            When they come to each segment, in seconds after the departure.

        Returns
        -------
        Float[np.ndarray, "2 segment"]
            The wait before each, and all of the time.
        """
        clock = self._clock + np.where(np.isfinite(begins), begins, 0.0)
        return np.asarray(_lasting(self._alone.begun_at(node), jnp.asarray(clock, jnp.float32)), np.float64)

    @property
    def network(self) -> RoadNetwork:
        """The streets."""
        return self._params.network


@dataclass(frozen=True, eq=False)
class Reach:
    """The walks from one node to all others."""

    paths: Paths
    node: int
    """Where they begin."""
    via: Int[np.ndarray, " node"]
    """The last segment of the path to each node; -1 where there is none."""
    seconds: dict[float | None, Float[np.ndarray, " node"]]
    """Within which each node is reached, by the share of the futures in which it is; infinite where it is not."""
    again: tuple[tuple[int, "Reach"], ...] = ()
    """Restricted areas whose nodes are reached by walks through the same area, each with these walks."""

    def short_cuts(self, areas: Int[np.ndarray, " area"], *, prune: bool) -> list[int]:
        """Restricted areas through which one may get somewhere earlier than round them.

        Parameters
        ----------
        areas
            Those that matter.
        prune
            Whether paths are those of the earliest arrivals, which tell.

        Returns
        -------
        list of int
            Their numbers.
        """
        network = self.paths.network
        if network.area is None or not len(areas):
            return []
        area, owner, head = np.asarray(network.area), network.owners(), np.asarray(network.head)
        begins, lasts = self._as_expected
        leaves = (owner >= 0) & (area[head] < 0) & np.isfinite(begins)
        if prune:
            leaves &= begins + lasts < self.seconds[None][head] - MILLISECOND
        return np.intersect1d(owner[leaves], areas).tolist()

    def on_segments(self, share: float | None) -> OnSegments:
        """When segments are entered, and how long they take.

        Parameters
        ----------
        share
            Of the futures.

        Returns
        -------
        begins, seconds : Float[np.ndarray, " segment"]
            Seconds after the departure, infinite for segments that are not walked; and seconds on the segment, which
            is entered after the wait before it.
        """
        return self._as_expected if share is None else self._walked(share)

    @cached_property
    def _as_expected(self) -> OnSegments:
        return self._walked(None)

    def _walked(self, share: float | None) -> OnSegments:
        network, reached = self.paths.network, self.seconds[share]
        tail, head = np.asarray(network.tail), np.asarray(network.head)
        begins = np.full(network.segments, np.inf)
        walked = np.asarray(network.exit_segment)[np.asarray(network.valid)]
        begins[walked] = reached[tail[walked]]
        waits, lasts = self.paths.lasting(self.node, begins)
        # Along the paths, nodes and the streets between them must agree.
        on_path = (self.via[head] == np.arange(network.segments)) & np.isfinite(reached[head])
        seconds = np.where(
            on_path, np.where(on_path, reached[head], 0.0) - np.where(on_path, reached[tail], 0.0), lasts
        )
        waits = np.minimum(waits, seconds)
        begins, seconds = begins + waits, seconds - waits
        for area, again in self.again:
            mine, there = network.owners() == area, again.on_segments(share)
            begins, seconds = np.where(mine, there[0], begins), np.where(mine, there[1], seconds)
        return begins, seconds
