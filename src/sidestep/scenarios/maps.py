"""Maps of a scenario, drawn from a seed: streets, and the crowds that are usual on them."""

import hashlib
from dataclasses import dataclass, replace
from typing import Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.arima import change_step, load_fitted
from sidestep.crowds.base import ArimaFlow, FlowModel
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.rush import RushFlow, ShiftingFlow
from sidestep.crowds.sensors import SensorFlow
from sidestep.crowds.table import TableFlow
from sidestep.network.graph import RoadNetwork, disjoint_union
from sidestep.network.grid import grid_network
from sidestep.network.snapping import SplitStreets
from sidestep.scenarios.build import town_crowds
from sidestep.scenarios.model import Scenario, ScenarioError
from sidestep.walking.waits import Waits

Purpose = Literal["learn", "explore", "test"]
PURPOSES: tuple[Purpose, ...] = get_args(Purpose)


class ScenarioMap(eqx.Module):
    """Streets, and the crowds on them with the model that moves them.

    Several maps side by side, with no street between them, are one: ``parts`` are the nodes of each.
    """

    network: RoadNetwork
    flow: FlowModel
    key: Key[Array, ""]  # of this map; futures and training fold their purpose into it
    parts: tuple[int, ...] = eqx.field(static=True)
    recorded: FlowModel | None = None  # what walks are tested on, where that was counted and is not simulated
    origins: tuple[int, ...] = eqx.field(static=True, default=())  # nodes where walks begin; none: anywhere
    ends: tuple[int, ...] = eqx.field(static=True, default=())  # nodes where they end; none: anywhere
    waits: Waits | None = None  # at lights and for gaps in the traffic

    def flow_for(self, purpose: Purpose) -> FlowModel:
        """The crowds that walks of one purpose meet."""
        return self.recorded if self.recorded is not None and purpose == "test" else self.flow

    def beginning(self, starts: list[float]) -> "ScenarioMap":
        """The same place with clock 0 at these hours of the week, for one goal each."""
        start = jnp.asarray(starts, jnp.float32)
        recorded = None if self.recorded is None else _starting(self.recorded, start)
        waits = None if self.waits is None else replace(self.waits, start=start)
        return replace(self, flow=_starting(self.flow, start), recorded=recorded, waits=waits)

    def spliced(self, streets: SplitStreets) -> "ScenarioMap":
        """The same place with some streets split, the same crowds on all their pieces, and futures simulated."""
        parent, share = jnp.asarray(streets.parent), jnp.asarray(streets.fraction, jnp.float32)
        flow = _on_pieces(self.flow, parent, share)
        waits = None if self.waits is None else self.waits.on(parent, jnp.asarray(streets.begins_at_crossing))
        return ScenarioMap(streets.network, flow, self.key, (streets.network.nodes,), waits=waits)


def knows_time(flow: FlowModel) -> bool:
    """Whether crowds depend on the hour of the week."""
    return isinstance(flow, SensorFlow) or (isinstance(flow, TableFlow) and flow.start is not None)


def _starting(flow: FlowModel, start: Float[Array, " goal"]) -> FlowModel:
    """The same crowds from other hours of the week on, if they know the time."""
    return replace(flow, start=start) if knows_time(flow) else flow  # type: ignore[type-var]


def _on_pieces(flow: FlowModel, parent: Int[Array, " piece"], share: Float[Array, " piece"]) -> FlowModel:
    """The same crowds, as dense, on pieces of the segments; ``share`` is how long these are in parts of the whole."""
    if isinstance(flow, TableFlow):  # of the persons on a segment, each piece has as large a share as of its length
        return replace(flow, usual=flow.usual[:, parent] * share)
    if isinstance(flow, SensorFlow):
        return replace(flow, weights=InterpolationWeights(flow.weights.sensor[parent], flow.weights.weight[parent]))
    return flow


def draw_map(scenario: Scenario, seed: int, index: int = 0) -> ScenarioMap:
    """Map number ``index`` of a seed; the same for every planner and for every kind of flow."""
    if min(seed, index) < 0:
        raise ScenarioError(f"seed and number of a map must not be negative, not {seed} and {index}")
    if scenario.venue is not None:
        town = town_crowds(scenario.venue, scenario.slot_seconds, scenario.law)
        return ScenarioMap(
            town.network,
            town.flow,
            _key(seed, index),
            (town.network.nodes,),
            town.recorded,
            town.origins,
            town.destinations,
            town.waits,
        )
    key = _key(seed, index)
    streets = _Streets.draw(scenario, scenario.sides[index % len(scenario.sides)], np.random.default_rng([seed, index]))
    return _scenario_map(scenario, [streets], key)


def _key(seed: int, index: int) -> Key[Array, ""]:
    # A key made of plain numbers needs no compiled program.
    return jax.random.wrap_key_data(jnp.asarray(np.random.SeedSequence([seed, index]).generate_state(2)))


def draw_training_map(scenario: Scenario, seed: int, index: int = 0) -> ScenarioMap:
    """What an agent learns on that will walk map number ``index``: that map, or others, as the scenario says.

    The others are drawn from another stream than all maps that agents are compared on.
    """
    here = draw_map(scenario, seed, index)
    if not scenario.training_maps:
        return here
    rngs = [np.random.default_rng([seed, number, _LEARN]) for number in range(scenario.training_maps)]
    return _scenario_map(scenario, [_Streets.draw(scenario, scenario.side, rng) for rng in rngs], here.key)


_LEARN = 1  # a third number makes another stream: no map that is compared on has one


@dataclass(frozen=True)
class _Streets:
    """One map while it is being drawn."""

    network: RoadNetwork
    volume: np.ndarray  # persons on each segment, without waves or noise
    waves: np.ndarray  # amplitude and phase of each segment

    @staticmethod
    def draw(scenario: Scenario, side: int, rng: np.random.Generator) -> "_Streets":
        network = grid_network(side, rng, scenario.lengths)
        tail, head = np.asarray(network.tail), np.asarray(network.head)
        volume = rng.uniform(*scenario.volumes, network.segments)
        crowded_nodes = _crowded_nodes(scenario, network.nodes)
        crowded = rng.choice(np.arange(1, network.nodes - 1), crowded_nodes, replace=False)
        if scenario.rush is None or not scenario.rush.shifting:
            at_crowded = np.isin(tail, crowded) | np.isin(head, crowded)
            drawn = np.maximum(rng.normal(*scenario.crowded_volume, network.segments), 1.0)
            volume = np.where(at_crowded, drawn, volume)
        waves = np.zeros((2, network.segments))
        if scenario.rush is not None:
            # Both directions of a street have one wave.
            street = np.unique(np.sort([tail, head], axis=0), axis=1, return_inverse=True)[1].reshape(-1)
            amplitude = rng.uniform(*scenario.rush.amplitude, network.segments)
            waves = np.stack([amplitude, rng.uniform(0, 2 * np.pi, network.segments)])[:, street]
        return _Streets(network, volume, waves)


def _crowded_nodes(scenario: Scenario, nodes: int) -> int:
    """As large a share of the nodes as on the scenario's first map."""
    return round(scenario.crowded_nodes * nodes / scenario.side**2)


def _scenario_map(scenario: Scenario, maps: list[_Streets], key: Key[Array, ""]) -> ScenarioMap:
    network = disjoint_union([streets.network for streets in maps])
    volume = jnp.asarray(np.concatenate([streets.volume for streets in maps]), jnp.float32)
    parts = tuple(streets.network.nodes for streets in maps)
    if scenario.rush is None:
        return ScenarioMap(network, ArimaFlow(volume, change_step(load_fitted(), scenario.slot_seconds)), key, parts)
    rush, waves = scenario.rush, jnp.asarray(np.concatenate([streets.waves for streets in maps], axis=1), jnp.float32)
    amplitude, phase = waves
    flow = RushFlow(volume, amplitude, phase, rush.period, rush.memory, rush.deviation, scenario.slot_seconds)
    if not rush.shifting:
        return ScenarioMap(network, flow, key, parts)
    spared = np.zeros(network.nodes, bool)
    first = np.cumsum((0, *parts))
    spared[[*first[:-1], *(first[1:] - 1)]] = True
    ends = jnp.stack([network.tail, network.head], axis=1)
    crowded_nodes = sum(_crowded_nodes(scenario, nodes) for nodes in parts)
    shifting = ShiftingFlow(flow, ends, jnp.asarray(spared), crowded_nodes, *scenario.crowded_volume)
    return ScenarioMap(network, shifting, key, parts)


def fingerprint(scenario_map: ScenarioMap) -> str:
    """The same for the same streets with the same usual crowds, whatever the speed law, and for no others."""
    digest = hashlib.sha256(
        str(jax.tree.structure((scenario_map.network, scenario_map.flow, scenario_map.waits))).encode()
    )
    for leaf in jax.tree.leaves((scenario_map.network, scenario_map.flow, scenario_map.waits)):
        digest.update(f"{leaf.shape}".encode() + np.asarray(leaf).tobytes())
    return digest.hexdigest()[:16]


def purpose_key(scenario_map: ScenarioMap, purpose: Purpose) -> Key[Array, ""]:
    """The random stream of one purpose on one map."""
    return jax.random.fold_in(scenario_map.key, PURPOSES.index(purpose))
