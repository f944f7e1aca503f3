"""The trained agent as a planner. No other planner may import the agent."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.checkpoint import Model, TrainingRun, load_model
from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import Preset, preset, preset_for
from sidestep.agent.train import QNetwork, greedy, selected_params, train
from sidestep.environment.types import EnvParams, Information, Instance, Observation
from sidestep.errors import SidestepError
from sidestep.planners.base import DecideByPlan, Plan
from sidestep.scenarios.episodes import destinations_of
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map
from sidestep.scenarios.model import Scenario


class ModelError(SidestepError):
    """A model that cannot walk what it is asked to: says why."""


OnRound = Callable[[int, Float[np.ndarray, " test"]], None]  # round number from 1, minutes of its greedy test walks


def _decide(network: QNetwork, _own: Array, observation: Observation, key: Key[Array, ""]) -> Int[Array, ""]:
    return greedy(network)(observation, key)


@dataclass(frozen=True, eq=False)
class Darp:
    """Greedy on the Q-values that it learned."""

    network: QNetwork
    curve: Float[np.ndarray, "round test"]  # minutes of the greedy test walks after every round of training
    level: Information = "position"
    name: ClassVar[str] = "darp"
    decide: ClassVar[DecideByPlan] = staticmethod(_decide)

    @property
    def observes(self) -> Information:
        """It looks at all that its level knows."""
        return self.level

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(self.network, jnp.asarray(np.zeros(instances.origin.shape[0])))


def train_darp(
    config: TrainConfig,
    scenario: Scenario,
    scenario_map: ScenarioMap,
    on_round: OnRound = lambda _number, _minutes: None,
) -> Darp:
    """Let an agent learn one map."""
    curve = []
    for state, report in train(config, scenario, scenario_map):
        network = selected_params(config, state)
        curve.append(np.asarray(report.test_minutes))
        on_round(len(curve), curve[-1])
    return Darp(network, np.stack(curve), config.level)


def trained_darp(model: Model | TrainingRun) -> Darp:
    """The planner that was saved."""
    return Darp(model.network, np.asarray(model.curve), model.config.level)


Factory = Callable[[ScenarioMap, int], Darp]


@dataclass(frozen=True)
class Learned:
    """Saved models as planners."""

    factories: dict[str, Factory]  # `darp`, or `darp-` and the folder's name where there are several
    index: int | None  # of the only map that they can walk, if one of them remembers places
    destinations: frozenset[int] | None  # the only ones, if one of them remembers places

    def check_destination(self, node: int) -> None:
        """Refuse a destination that was not learned, where only those that were can be walked to."""
        if self.destinations is not None and node not in self.destinations:
            known = ", ".join(map(str, sorted(self.destinations)))
            raise ModelError(f"this model remembers how to walk to {known}, not to {node}; see train --destinations")

    def check_destinations(self, scenario_map: ScenarioMap, destinations: int) -> None:
        """Refuse more destinations than were learned."""
        for node in destinations_of(scenario_map, destinations).ravel().tolist():
            self.check_destination(node)


def load_planners(folders: Sequence[Path], scenario: Scenario, seed: int, level: Information | None = None) -> Learned:
    """Load models to walk the maps of a scenario.

    Raises
    ------
    ModelError
        A model of another level than asked for or for another objective, one that remembers the places of another map,
        or one that knows crowds from sensors where it is to walk without, or the reverse.
    """
    models = {folder: load_model(folder) for folder in folders}
    bound: set[int] = set()
    ends: list[frozenset[int]] = []
    for folder, model in models.items():
        if level is not None and model.config.level != level:
            raise ModelError(f"the model in {folder} is of level {model.config.level}, not {level}")
        if model.scenario.objective != scenario.objective:
            raise ModelError(f"the model in {folder} learned for another objective; give the same --objective")
        if model.config.level in ("map", "live") and model.scenario.place.interpolated != scenario.place.interpolated:
            where = ("where crowds are known street by street", "in a town whose crowds are known from sensors")
            learned = where[model.scenario.place.interpolated]
            raise ModelError(f"the model in {folder} learned to walk {learned}; {scenario.name} is another kind")
        if model.config.level == "position" or model.config.places:
            scenario_map = draw_map(scenario, seed, model.index)
            _check_place(folder, model, scenario_map)
            bound.add(model.index)
            ends.append(frozenset(destinations_of(scenario_map, model.config.destinations).ravel().tolist()))
    if len(bound) > 1:
        raise ModelError(f"the models remember the places of different maps, numbers {sorted(bound)}")
    names = {folder: Darp.name if len(models) == 1 else f"{Darp.name}-{folder.name}" for folder in models}
    if len(set(names.values())) < len(names):
        raise ModelError("the folders of the models must have different names, since planners are called by them")
    return Learned(
        {names[folder]: partial(_ready, trained_darp(model)) for folder, model in models.items()},
        bound.pop() if bound else None,
        frozenset.intersection(*ends) if ends else None,
    )


def _ready(darp: Darp, _place: ScenarioMap, _index: int) -> Darp:
    return darp


def _check_place(folder: Path, model: Model, scenario_map: ScenarioMap) -> None:
    if scenario_map.fingerprint == model.fingerprint:
        return
    learned = draw_training_map(model.scenario, model.seed, model.index).network.nodes
    where = f"map {model.index} of {model.scenario.name}, seed {model.seed}"
    other = (
        f"one of {scenario_map.network.nodes} nodes" if scenario_map.network.nodes != learned else "another of as many"
    )
    raise ModelError(f"the model in {folder} remembers the {learned} nodes of {where}; this map is {other}")


def trainable(
    scenario: Scenario, seed: int, level: Information, name: Preset, destinations: int = 1
) -> dict[str, Factory]:
    """Agents that are trained before they walk: ``darp`` by the preset of this name, and the baselines that learn.

    They learn ``destinations`` destinations, or more where their preset does. Where a scenario has maps of its own to
    train on, that is done once for all maps.
    """
    configs = {Darp.name: preset_for(scenario, name, level), "dqn": preset_for(scenario, "dqn", level)}
    if not scenario.place.training_maps and not scenario.place.anywhere and destinations == 1:
        configs["tabular-q"] = preset("tabular-q")
    return {
        key: _factory(scenario, seed, replace(config, destinations=max(config.destinations, destinations)))
        for key, config in configs.items()
    }


def _factory(scenario: Scenario, seed: int, config: TrainConfig) -> Factory:
    once = lru_cache(lambda: train_darp(config, scenario, draw_training_map(scenario, seed)))

    def here(scenario_map: ScenarioMap, _index: int) -> Darp:
        return once() if scenario.place.training_maps else train_darp(config, scenario, scenario_map)

    return here
