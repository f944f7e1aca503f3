"""The rest of a walk under way: decided anew from the next crossing on, with the crowds that the walker saw."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sidestep.environment.crossing import as_expected
from sidestep.environment.rollout import Past
from sidestep.environment.types import RECENT_NODES, EnvParams, Instance, Level
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.planners.base import Plan, Planned, Planner, Route
from sidestep.programs import on_device, program
from sidestep.routing.located import Located, NodeEnd
from sidestep.routing.walks import Walker, Walks, densities
from sidestep.walking.crossing_time import crossing_time
from sidestep.walking.expected_times import Speeds
from sidestep.walking.sightings import Sightings
from sidestep.walking.speed_laws import SpeedLaw

_STEPS_AT_ONCE = 64  # a route is filled up to a multiple, so that routes of many lengths share programs


@dataclass(frozen=True)
class KeptRoute(Planned):
    """Keep to one route, which may pass a crossing twice, whatever happens on it."""

    exits: tuple[int, ...]
    """The exit at each node of the route."""

    name: ClassVar[str] = "kept-route"
    level: ClassVar[Level] = "map"

    @classmethod
    def along(cls, network: RoadNetwork, segments: Sequence[int]) -> "KeptRoute":
        """Keep to a route, given its segments."""
        taken = np.array(segments, int)
        tail, exit_segment = np.asarray(network.tail)[taken], np.asarray(network.exit_segment)
        return cls(tuple((exit_segment[tail] == taken[:, None]).argmax(axis=1).tolist()))

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        own = np.zeros(max(len(self.exits) + -len(self.exits) % _STEPS_AT_ONCE, _STEPS_AT_ONCE), np.int32)
        own[: len(self.exits)] = self.exits
        return Plan(None, np.broadcast_to(own, (len(instances.origin), len(own))))


@dataclass(frozen=True)
class Standing:
    """Where a walker next decides, and how far that is."""

    node: int
    """The crossing, or the place in the middle of a street at which the walker left its route."""

    clock: float
    """Now, in s since clock 0 of the crowds."""

    left: tuple[int, ...] = ()
    """Nodes that were left before that one, the latest first."""

    remembered: tuple[float, ...] = ()
    """What is remembered of each of them, as of then; empty where the planner remembers nothing of nodes."""

    segment: int | None = None
    """The segment on the way there; None at the crossing."""

    part: float = 0.0
    """The share of that segment that is ahead."""

    ago: float = 0.0
    """Seconds since the walker left the crossing, if it is only a few metres behind."""

    inside: bool = False
    """Whether the walker came to the node along its street, and so is past the gate that the street may have."""


class Onward(Walker):
    """Walks the rest of a walk from the crossing at which the walker decides next.

    Planners that look at crowds on the way are shown what was seen as they are shown all crowds. To others, who know
    the streets only as they are expected, what was seen is what is expected.

    Parameters
    ----------
    located
        The streets and the crowds.
    planner
        Who decides.
    futures
        How many to simulate.
    standing
        Where the walker decides next.
    sightings
        The crowds that it saw; None where it saw none.
    """

    def __init__(
        self, located: Located, planner: Planner, futures: int, standing: Standing, sightings: Sightings | None
    ) -> None:
        origin, destination = located.ends
        node = origin if origin.node == standing.node else NodeEnd(standing.node, f"crossing {standing.node}")
        recent = np.full(RECENT_NODES, ABSENT, np.int32)
        recent[: len(standing.left)] = standing.left[:RECENT_NODES]
        remembered = np.zeros(located.scenario_map.network.nodes, np.float32)
        for left, number in zip(standing.left[::-1], standing.remembered[::-1], strict=False):
            remembered[left] = number
        super().__init__(
            replace(located, ends=(node, destination), baselines=()),
            planner,
            futures,
            inside=standing.inside,
            past=Past(on_device(recent, np.int32), on_device(remembered)),
        )
        self.standing = standing
        if sightings is not None:
            self._see(planner, sightings)
        self.until_node = np.full(1, -standing.ago)
        """Seconds until the walker is at the node, if crowds are as expected."""
        if standing.segment is not None:
            self.until_node = self._until_node(self.alone)
        self.located = self.located.departing(standing.clock + float(self.until_node[0]))
        self._departures = standing.clock + self.until_node

    def walk(self, planner: Planner, futures: int) -> Walks:
        """Walk through the first of the futures from now on."""
        there, until_node = copy(self), self._until_node_in_futures
        there._departures, there._instances = self.standing.clock + until_node, {}  # noqa: SLF001 - of this class
        walks = super(Onward, there).walk(planner, futures)
        return replace(walks, minutes=walks.minutes + np.resize(until_node, futures) / 60)

    def instances(self, count: int) -> Instance:
        """The walk from the node on in the first ``count`` futures, in each of which it may be reached at another time.

        Returns
        -------
        Instance
            One walk for each.
        """
        if count not in self._instances:
            origin, destination = (np.full(count, end.node, np.int32) for end in self.located.ends)
            departure, future = np.resize(self._departures, count), np.arange(count, dtype=np.int32)
            walks = origin, destination, departure.astype(np.float32), future
            self._instances[count] = Instance(*jax.device_put(walks))
        return self._instances[count]

    def keeping(self, segments: Sequence[int]) -> KeptRoute:
        """A planner that keeps to the route of some segments."""
        return KeptRoute.along(self.params.network, segments)

    def judged(self, segments: Sequence[int]) -> Route:
        """The walk along some segments if crowds are as expected."""
        return self.expected_route(self.keeping(segments))

    def _see(self, planner: Planner, sightings: Sightings) -> None:
        params = self.params
        expected, futures = _seeing(params, sightings, self.located.scenario.speed_law)
        self.params = replace(params, futures=replace(params.futures, speeds=futures))
        self.alone = as_expected(replace(self.params, expected=expected))
        self.density = np.asarray(densities(expected))
        if planner.observes == "position":
            self.params = replace(self.params, expected=expected)
        else:  # what is known beforehand stays, for crowds that are seen to differ from it
            self.alone = replace(self.alone, expected=params.expected)

    @cached_property
    def _until_node_in_futures(self) -> Float[np.ndarray, " future"]:
        return self.until_node if self.standing.segment is None else self._until_node(self.params)

    def _until_node(self, params: EnvParams) -> Float[np.ndarray, " future"]:
        standing = self.standing
        segment = on_device(np.array(standing.segment), np.int32)
        return np.asarray(
            _seconds_left(params, segment, on_device(standing.clock), on_device(standing.part)), np.float64
        )


@program()
def _seeing(params: EnvParams, sightings: Sightings, law: SpeedLaw) -> tuple[Speeds, Speeds]:
    """Expected speeds, and those of the futures, where some crowds were seen."""
    pace = params.network.pace
    expected, futures = params.expected, params.futures.speeds
    return expected.seeing(sightings, law, pace), futures.seeing(sightings, law, pace)


@program()
def _seconds_left(
    params: EnvParams, segment: Int[Array, ""], clock: Float[Array, ""], part: Float[Array, ""]
) -> Float[Array, " future"]:
    """Seconds for the last part of a segment in each of the futures; waits were where it begins."""

    def one(future: Int[Array, ""]) -> Float[Array, ""]:
        row, length = params.futures.speeds.row(future, segment), params.network.length[segment]
        if row.expected:
            return part * row.at(clock)
        return crossing_time(row, part * length, clock, params.rule)

    return jax.vmap(one)(jnp.arange(params.futures.count))
