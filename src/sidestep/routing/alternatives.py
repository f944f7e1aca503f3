"""Other routes that a walker may like as much: by way of other places, different enough, and not much worse.

Every segment is one to go by way of: on the path of least cost to it, and from its end on the path of least cost to the
destination. Two searches know all of these routes and their costs, one from the origin and one to the destination.
Penalties on streets that are used already would need a search for each route.

References
----------
I. Abraham, D. Delling, A. V. Goldberg, R. F. Werneck, Alternative routes in road networks (2013),
doi:10.1145/2444016.2444019.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from sidestep.environment.cost_to_go import at_clock, field_cost_to_go, gate_steps
from sidestep.environment.crossing import crossings
from sidestep.environment.types import EnvParams, Instance, Level
from sidestep.planners.base import Plan, Planned, Planner, Route, routes
from sidestep.planners.shortest_path import ShortestPath, metres_at
from sidestep.planners.time_dependent import FINE_STEP
from sidestep.routing.request import RouteError
from sidestep.routing.trees import least_costs
from sidestep.walking.objective import WeightedObjective
from sidestep.walking.waits import NoWaits

MOST_SHARED = 0.7
"""Largest share of its length, or of that of a better route, that an alternative has in common with it."""

MOST_COST = 1.4
"""Largest cost of an alternative, as a multiple of the best one."""


@dataclass(frozen=True)
class KeptPath(Planned):
    """Keep to one path, whatever happens on it."""

    exits: Bool[np.ndarray, "node exit"]
    """The exit at each node of the path; others are not reached."""

    name: ClassVar[str] = "kept-path"
    level: ClassVar[Level] = "map"

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(None, np.broadcast_to(self.exits, (len(instances.origin), *self.exits.shape)))


class Alternative(NamedTuple):
    """A route beside the best one."""

    planner: KeptPath
    """Walks it."""

    route: Route
    """The walk if crowds are as expected."""

    shared: float
    """The largest share of its length, or of that of a better route, that both have in common."""


def alternatives(
    planner: Planner,
    params: EnvParams,
    instance: Instance,
    best: Route,
    most: int,
    pieces: Int[np.ndarray, "segment 3"],
    key: Key[Array, ""],
) -> list[Alternative]:
    """Find alternatives to a planner's route.

    Parameters
    ----------
    planner
        Decides what costs are: metres for ``shortest-path``, and else those of the objective.
    params, instance
        The environment with the expected times as its only future, and one walk.
    best
        The planner's own route there.
    most
        How many to find; there may be fewer.
    pieces
        A name for each segment, the same for both directions of a street.
    key
        As for :func:`~sidestep.planners.base.routes`.

    Returns
    -------
    list of Alternative
        The best first. Each shares at most ``MOST_SHARED`` with every better one and costs at most ``MOST_COST`` times
        as much as the best one, on the clock and in the crowds in which it is walked.

    Raises
    ------
    RouteError
        Planners that decide on the way (field ``alternatives``).
    """
    if not isinstance(planner, Planned) or planner.level != "map":
        said = "alternatives are fixed before the walk; plan them with expected or shortest-path"
        raise RouteError(
            f"{said}, not {planner.name}, which decides on the way or knows the future", field="alternatives"
        )
    by_length = isinstance(planner, ShortestPath)
    weighed = _by_length(params, instance) if by_length else params
    length = np.asarray(params.network.length, np.float64)
    street = np.unique(pieces, axis=0, return_inverse=True)[1].reshape(-1)
    least = float(weighed.network.length[jnp.array(best.segments)].sum()) if by_length else best.cost
    chosen, found = [_Course.of(best.segments, street, length)], []
    for path in _by_way_of_others(weighed, instance, MOST_COST * least):
        course = _Course.of(path, street, length)
        shared = max(course.shared(better) for better in chosen)
        if shared > MOST_SHARED:
            continue
        kept = KeptPath(_exits_along(params, path))
        (route,) = routes(kept, weighed, instance, key, params.network.nodes)
        cost = max(route.cost, least)  # rounding makes none cheaper than the best
        if by_length:
            (route,) = routes(kept, params, instance, key, params.network.nodes)
        if not (route.arrived and cost <= MOST_COST * least):
            continue
        chosen.append(course)
        found.append((cost, Alternative(kept, route if by_length else replace(route, cost=cost), shared)))
        if len(found) == most:
            break
    return [other for _, other in sorted(found, key=lambda each: each[0])]


def _by_length(params: EnvParams, instance: Instance) -> EnvParams:
    """The environment as ``shortest-path`` sees it at the departure: metres are all that counts, and nobody waits."""
    length = metres_at(params, params.futures.hour[0], instance.departure[0])
    metres = WeightedObjective(time=0.0, distance=1.0)
    return replace(params, network=replace(params.network, length=length), objective=metres, waits=NoWaits())


@dataclass(frozen=True)
class _Course:
    """The streets of a route."""

    metres: dict[int, float]
    """Length of each street, by its number."""

    @classmethod
    def of(
        cls, path: Sequence[int], street: Int[np.ndarray, " segment"], length: Float[np.ndarray, " segment"]
    ) -> Self:
        segments = np.asarray(path, int)
        return cls(dict(zip(street[segments].tolist(), length[segments].tolist(), strict=True)))

    def shared(self, other: "_Course") -> float:
        """Metres in both, as a share of the shorter one."""
        both = sum(metres for number, metres in self.metres.items() if number in other.metres)
        return both / max(min(sum(self.metres.values()), sum(other.metres.values())), 1e-9)


def _exits_along(params: EnvParams, path: Sequence[int]) -> Bool[np.ndarray, "node exit"]:
    """The exits that a path takes."""
    network, segments = params.network, np.asarray(path)
    exits = np.zeros((network.nodes, network.exits), bool)
    tail = np.asarray(network.tail)[segments]
    exits[tail] = np.asarray(network.exit_segment)[tail] == segments[:, None]
    return exits


def _by_way_of_others(params: EnvParams, instance: Instance, most: float) -> Iterator[list[int]]:
    """Paths without circles by way of every segment, the cheapest first.

    Parameters
    ----------
    params, instance
        The environment, and one walk.
    most
        Cost of the last ones.

    Yields
    ------
    list of int
        The segments of a path.
    """
    origin, destination, departure = (leaf[0] for leaf in (instance.origin, instance.destination, instance.departure))
    total, via, onward = map(np.asarray, _both_ways(params, origin, destination, departure))
    tail, head = np.asarray(params.network.tail), np.asarray(params.network.head)
    exit_segment = np.asarray(params.network.exit_segment)
    # A segment that the path from its tail takes anyway is no detour: one before it stands for that path, and the first
    # one for the path without any.
    detour = np.flatnonzero((total <= most) & (exit_segment != onward[:, None]))
    detours = exit_segment.flat[detour[np.argsort(total.flat[detour], kind="stable")]]
    for segment in (int(onward[origin]), *detours.tolist()):
        before = _chain(via, tail, int(tail[segment]), int(origin))[::-1]
        path = [*before, segment, *_chain(onward, head, int(head[segment]), int(destination))]
        ends = head[path].tolist()
        if ends[-1] == destination and len({int(origin), *ends}) == len(path) + 1:
            yield path


def _chain(link: Int[np.ndarray, " node"], other: Int[np.ndarray, " segment"], node: int, end: int) -> list[int]:
    """The segments from a node on, each at the other end of the one before, until the end is reached."""
    found: list[int] = []
    while node != end and link[node] >= 0 and len(found) < len(link):
        found.append(int(link[node]))
        node = int(other[link[node]])
    return found


@jax.jit
def _both_ways(
    params: EnvParams, origin: Int[Array, ""], destination: Int[Array, ""], departure: Float[Array, ""]
) -> tuple[Float[Array, "node exit"], Int[Array, " node"], Int[Array, " node"]]:
    """Search forwards from the origin and backwards from the destination.

    Parameters
    ----------
    params
        The environment, whose expected times are its only future.
    origin, destination, departure
        One walk.

    Returns
    -------
    total : Float[Array, "node exit"]
        Cost from the origin over each exit to the destination; infinite where there is none.
    via, onward : Int[Array, " node"]
        The last segment of the path to each node, -1 where there is none; and the first one after it.
    """
    network, wait, field = params.network, params.wait_in(jnp.int32(0)), params.futures.speeds.of(jnp.int32(0))
    every = gate_steps(params, field.slot_seconds, FINE_STEP)
    crossed, step_seconds = crossings(params, field, wait, every=every), field.slot_seconds / every
    to_go = field_cost_to_go(params, field, wait, jnp.arange(network.nodes) == destination, every=every)
    label, clock, via = least_costs(network, crossed, step_seconds, origin, departure)
    segment = network.exit_segment.reshape(-1)
    at = jnp.repeat(clock, network.exits)
    cost, seconds = (at_clock(table, step_seconds, at, segment) for table in (crossed.cost, crossed.seconds))
    ahead = cost + at_clock(to_go, step_seconds, at + seconds, network.head[segment])
    taken = network.exits_to(destination)
    ahead = jnp.where(taken, ahead.reshape(taken.shape), jnp.inf)
    onward = jnp.take_along_axis(network.exit_segment, ahead.argmin(axis=1)[:, None], axis=1)[:, 0]
    return label[:, None] + ahead, via, onward
