"""Named problems: streets, crowds, speed law and walks, from one seed.

A scenario is drawn in two steps. :func:`draw_map` gives map number ``index`` of a seed: streets and today's crowds.
:func:`make_environment` gives futures of these crowds for one *purpose*. The purpose is part of every random stream,
so the futures that planners are compared on can never be those that the agent was trained on.
"""

import difflib
import math
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Key

from sidestep.environment.instances import InstanceSampler
from sidestep.environment.types import EnvParams, Instance, RewardWeights, walking_speeds
from sidestep.errors import SidestepError
from sidestep.flow.arima import change_step, load_fitted
from sidestep.flow.field import SLOT_SECONDS, ArimaFlow, FlowField
from sidestep.network.graph import RoadNetwork
from sidestep.network.grid import LENGTHS, grid_network
from sidestep.travel_time import CROSSING_RULES, Aoki, CrossingRule, SpeedLaw, Weidmann

Flows = Literal["arima", "forecast"]
Law = Literal["power", "power-capped", "weidmann"]
Purpose = Literal["learn", "explore", "test"]
PURPOSES: tuple[Purpose, ...] = get_args(Purpose)
LAWS: dict[str, SpeedLaw] = {"power": Aoki(capped=False), "power-capped": Aoki(capped=True), "weidmann": Weidmann()}


class ScenarioError(SidestepError):
    """A scenario that is unknown or cannot be: says what is wrong."""


@dataclass(frozen=True)
class Scenario:
    """A whole problem. The defaults are the paper's (section V-A), or stand for what it leaves open."""

    name: str
    summary: str
    side: int = 6  # nodes along one side of the grid
    lengths: tuple[float, float] = LENGTHS  # m, uniform per street
    volumes: tuple[float, float] = (200.0, 1000.0)  # persons at clock 0, uniform per segment
    crowded_nodes: int = 0  # the paper: "several"; origin and destination are never among them
    crowded_volume: tuple[float, float] = (5000.0, math.sqrt(1000.0))  # mean and standard deviation, persons
    flows: Flows = "arima"  # with the model's noise, or its forecast only
    slot_seconds: float = SLOT_SECONDS
    horizon: float = 24 * 3600.0  # s; a walk that has not arrived counts as this
    law: Law = "power"  # literal: above free speed where there is less than a person per m²
    rule: CrossingRule = "integrated"
    reward: RewardWeights = field(default_factory=RewardWeights)

    def __post_init__(self) -> None:
        if self.side < 2:
            raise ScenarioError(f"side must be at least 2 nodes, not {self.side}")
        if not 0 <= self.crowded_nodes <= self.side**2 - 2:
            raise ScenarioError(
                f"crowded nodes must be between 0 and {self.side**2 - 2} on a grid of {self.side} x {self.side}, "
                f"not {self.crowded_nodes}"
            )
        for name, allowed in (("flows", get_args(Flows)), ("law", tuple(LAWS)), ("rule", CROSSING_RULES)):
            if getattr(self, name) not in allowed:
                raise ScenarioError(f"{name} must be one of {', '.join(allowed)}, not {getattr(self, name)!r}")
        for name, (low, high) in (("lengths", self.lengths), ("volumes", self.volumes)):
            if not (0 < low <= high < math.inf):
                raise ScenarioError(f"{name} must be two positive numbers in order, not {low} and {high}")
        mean, deviation = self.crowded_volume
        if not (0 < mean < math.inf and 0 <= deviation < math.inf):
            raise ScenarioError(f"crowded_volume must be a positive mean and a deviation, not {mean} and {deviation}")
        for name in ("slot_seconds", "horizon"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ScenarioError(f"{name} must be a positive number of seconds, not {getattr(self, name)}")

    @property
    def origin(self) -> int:
        """Where walks begin: the lower left corner."""
        return 0

    @property
    def destination(self) -> int:
        """Where they end: the upper right corner."""
        return self.side**2 - 1

    @property
    def slots(self) -> int:
        """Slots that the horizon spans."""
        return math.ceil(self.horizon / self.slot_seconds)


BUILT_IN = {
    scenario.name: scenario
    for scenario in (
        Scenario("paper-unblocked", "the paper's 5 x 5 blocks, all segments with 200 to 1,000 people"),
        Scenario("paper-congested", "the same with the segments at four nodes crowded by 5,000", crowded_nodes=4),
    )
}


def scenario(name: str, **changes: object) -> Scenario:
    """A built-in scenario, with some fields changed.

    Raises
    ------
    ScenarioError
        Unknown names and impossible values.
    """
    if name not in BUILT_IN:
        close = difflib.get_close_matches(name, BUILT_IN, n=1)
        hint = f"; did you mean {close[0]}?" if close else f"; there are {', '.join(BUILT_IN)}"
        raise ScenarioError(f"unknown scenario {name!r}{hint}")
    unknown = changes.keys() - {known.name for known in fields(Scenario)}
    if unknown:
        raise ScenarioError(f"a scenario has no field {', '.join(sorted(unknown))}")
    return replace(BUILT_IN[name], **changes)  # type: ignore[arg-type]


class CrowdedMap(eqx.Module):
    """One map of a scenario: its streets, and the crowds on them at clock 0 with the model that moves them."""

    network: RoadNetwork
    flow: ArimaFlow
    key: Key[Array, ""]  # of this map; futures and training fold their purpose into it


def draw_map(scenario: Scenario, seed: int, index: int = 0) -> CrowdedMap:
    """Map number ``index`` of a seed; the same for every planner and for every kind of flow."""
    if min(seed, index) < 0:
        raise ScenarioError(f"seed and number of a map must not be negative, not {seed} and {index}")
    rng = np.random.default_rng([seed, index])
    network = grid_network(scenario.side, rng, scenario.lengths)
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    volume = rng.uniform(*scenario.volumes, network.segments)
    inner = np.setdiff1d(np.arange(network.nodes), [scenario.origin, scenario.destination])
    crowded = rng.choice(inner, scenario.crowded_nodes, replace=False)
    at_crowded = np.isin(tail, crowded) | np.isin(head, crowded)
    volume = np.where(at_crowded, rng.normal(*scenario.crowded_volume, network.segments), volume)
    model = change_step(load_fitted(), scenario.slot_seconds)
    # A key made of plain numbers needs no compiled program.
    key = jax.random.wrap_key_data(jnp.asarray(np.random.SeedSequence([seed, index]).generate_state(2)))
    return CrowdedMap(network, ArimaFlow(jnp.asarray(volume, jnp.float32), model), key)


def purpose_key(place: CrowdedMap, purpose: Purpose) -> Key[Array, ""]:
    """The random stream of one purpose on one map."""
    return jax.random.fold_in(place.key, PURPOSES.index(purpose))


@partial(jax.jit, static_argnames=("scenario", "purpose", "crowds"))
def make_environment(scenario: Scenario, place: CrowdedMap, purpose: Purpose, crowds: int) -> EnvParams:
    """The environment on one map with possible futures for one purpose.

    ``crowds`` futures are drawn; where the flows are the forecast only there is one, whatever was asked.
    """
    expected = place.flow.expected(scenario.slots)
    if scenario.flows == "forecast":
        drawn = FlowField(expected.volume[None], expected.slot_seconds)
    else:
        drawn = place.flow.draw(purpose_key(place, purpose), crowds, scenario.slots)
    law = LAWS[scenario.law]
    return EnvParams(
        network=place.network,
        crowds=walking_speeds(place.network, drawn, law),
        expected=walking_speeds(place.network, expected, law),
        horizon=jnp.float32(scenario.horizon),
        reward=scenario.reward,
        rule=scenario.rule,
    )


def sampler(scenario: Scenario, params: EnvParams, crowds: int, *, anywhere: bool = False) -> InstanceSampler:
    """The scenario's walks, or walks from anywhere to its destination, through the first ``crowds`` futures."""
    # Both have as many candidates, so that training from either is the same compiled program.
    elsewhere = np.setdiff1d(np.arange(scenario.side**2), [scenario.destination])
    origins = elsewhere if anywhere else np.full_like(elsewhere, scenario.origin)
    return InstanceSampler(
        origins=jnp.asarray(origins, jnp.int32),
        destinations=jnp.asarray([scenario.destination], jnp.int32),
        departures=jnp.asarray(np.zeros(2), jnp.float32),
        crowds=jnp.asarray(min(crowds, params.crowds.count), jnp.int32),
    )


def instances(scenario: Scenario, params: EnvParams, walks: int, first: int = 0) -> Instance:
    """``walks`` walks of the scenario, from future number ``first`` on each through its own, as far as there are."""
    return Instance(
        origin=jnp.asarray(np.full(walks, scenario.origin), jnp.int32),
        destination=jnp.asarray(np.full(walks, scenario.destination), jnp.int32),
        departure=jnp.asarray(np.zeros(walks), jnp.float32),
        crowd=jnp.asarray((first + np.arange(walks)) % params.crowds.count, jnp.int32),
    )
