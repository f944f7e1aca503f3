"""The trained agent as a planner. No other planner may import the agent."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import jax
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.agent.checkpoint import Metadata, Model, load_model
from sidestep.agent.policy import Policy
from sidestep.agent.presets import Preset, preset_for
from sidestep.agent.runs import train
from sidestep.arguments import checked, instance
from sidestep.environment.types import EnvParams, Information, Instance, Observation
from sidestep.errors import SidestepError
from sidestep.planners.base import DecideByPlan, Plan, Planner
from sidestep.scenarios.episodes import destinations_of
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map
from sidestep.scenarios.model import Scenario


class ModelError(SidestepError):
    """A model that cannot walk where it is asked to; ``field`` says what does not fit."""


def _decide(policy: Policy, _own: Array, observation: Observation, key: Key[Array, ""]) -> Int[Array, ""]:
    return policy(observation, key)


@dataclass(frozen=True, eq=False)
class Darp:
    """A planner that follows a learned policy.

    Examples
    --------
    >>> import sidestep
    >>> sidestep.Darp.name
    'darp'
    """

    policy: Policy
    """What was learned, with the margins that it is followed with."""
    curve: Float[np.ndarray, "round test"]
    """Minutes of the greedy test walks after every round of training."""
    level: Information = "position"
    """What it knows, and observes on the way."""
    name: ClassVar[str] = "darp"
    decide: ClassVar[DecideByPlan] = staticmethod(_decide)

    @property
    def observes(self) -> Information:
        """All that its level knows."""
        return self.level

    def plan(self, _params: EnvParams, instances: Instance) -> Plan:
        return Plan(self.policy, jax.device_put(np.zeros(instances.origin.shape[0], np.float32)))


@checked(ModelError, model=instance(Model, "a model, such as sidestep.load_model(folder)"))
def trained_darp(model: Model) -> Darp:
    """Make a planner of a model.

    Parameters
    ----------
    model
        What :func:`sidestep.load_model` read, or the ``model`` of a training run.

    Returns
    -------
    Darp
        A planner for :func:`sidestep.compare`, :func:`sidestep.routes` and the like.

    Raises
    ------
    ModelError
        Anything but a model (field ``model``).

    Examples
    --------
    >>> import sidestep
    >>> tiny = sidestep.preset("default").changed(rounds=2, round_steps=64, walkers=8, batch=16, capacity=64)
    >>> problem = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> sidestep.trained_darp(sidestep.train(problem, tiny).model).level
    'position'
    """
    return Darp(model.policy, np.asarray(model.metadata.curve), model.metadata.config.level)


@dataclass(frozen=True)
class Learned:
    """Saved models as planners."""

    planners: dict[str, Planner]
    """By name: ``darp``, or ``darp-`` and the folder's name where there are several."""
    index: int | None
    """Number of the only map that they can walk, if one of them remembers places."""
    destinations: frozenset[int] | None
    """The only destinations that they can walk to, if one of them remembers places."""
    scenario: Scenario
    """What they were loaded for, with the walker and the objective that they learned for."""

    def check_problem(self, scenario: Scenario) -> None:
        """Refuse another walker or objective than the planners learned for.

        Raises
        ------
        ModelError
            The scenario has another one (field ``walker`` or ``objective``).
        """
        _check_problem("the model", self.scenario, scenario)

    def check_destination(self, node: int) -> None:
        """Refuse a destination that was not learned, where only those that were can be walked to.

        Raises
        ------
        ModelError
            The node is none of them.
        """
        if self.destinations is not None and node not in self.destinations:
            known = ", ".join(map(str, sorted(self.destinations)))
            raise ModelError(
                f"this model remembers how to walk to {known}, not to {node}; see train --destinations",
                field="destination",
            )

    def check_destinations(self, scenario_map: ScenarioMap, destinations: int) -> None:
        """Refuse more destinations than were learned.

        Raises
        ------
        ModelError
            One of them was not learned.
        """
        for node in destinations_of(scenario_map, destinations).ravel().tolist():
            self.check_destination(node)


def load_planners(folders: Sequence[Path], scenario: Scenario, seed: int, level: Information | None = None) -> Learned:
    """Load models to walk the maps of a scenario.

    Parameters
    ----------
    folders
        Of the models.
    scenario, seed
        The maps that will be walked.
    level
        The only level that is wanted; any by default.

    Returns
    -------
    Learned
        Without planners where no folder is given.

    Raises
    ------
    CheckpointError
        A folder holds no model that can be read.
    ModelError
        A model is of another level than asked for, or learned for another objective or another kind of crowds; or it
        remembers the places of another map.
    """
    models = {folder: load_model(folder) for folder in folders}
    planners: dict[str, Planner] = {}
    known: dict[int, frozenset[int]] = {}  # by the number of the map
    for folder, model in models.items():
        metadata, config = model.metadata, model.metadata.config
        _check_fits(folder, metadata, scenario, level)
        planners[Darp.name if len(models) == 1 else f"{Darp.name}-{folder.name}"] = trained_darp(model)
        if config.remembers_places:
            scenario_map = draw_map(scenario, seed, metadata.map)
            _check_place(folder, metadata, scenario_map)
            ends = frozenset(destinations_of(scenario_map, config.destinations).ravel().tolist())
            known[metadata.map] = known.get(metadata.map, ends) & ends
    if len(known) > 1:
        raise ModelError(f"the models remember the places of different maps, numbers {sorted(known)}", field="map")
    if len(planners) < len(models):
        raise ModelError(
            "the folders of the models must have different names, since planners are called by them", field="model"
        )
    index, destinations = next(iter(known.items()), (None, None))
    return Learned(planners, index, destinations, scenario)


def _check_fits(folder: Path, metadata: Metadata, scenario: Scenario, level: Information | None) -> None:
    learned, at = metadata.scenario, metadata.config.level
    if level is not None and at != level:
        raise ModelError(f"the model in {folder} is of level {at}, not {level}", field="level")
    _check_problem(f"the model in {folder}", learned, scenario)
    if at in ("map", "live") and learned.place.interpolated != scenario.place.interpolated:
        where = ("where crowds are known street by street", "in a town whose crowds are known from sensors")
        known = where[learned.place.interpolated]
        raise ModelError(
            f"the model in {folder} learned to walk {known}; {scenario.name} is another kind", field="scenario"
        )


def _check_problem(called: str, learned: Scenario, asked: Scenario) -> None:
    if learned.walker != asked.walker:
        said = f"{called} learned for another walker; choose the same, {learned.walker.in_words()}"
        raise ModelError(f"{said}, or another planner", field="walker")
    if learned.objective != asked.objective:
        said = f"{called} learned for another objective; choose the same, or another planner"
        raise ModelError(said, field="objective")


def _check_place(folder: Path, metadata: Metadata, scenario_map: ScenarioMap) -> None:
    if scenario_map.fingerprint == metadata.fingerprint:
        return
    here = scenario_map.network.nodes
    learned = draw_training_map(metadata.scenario, metadata.seed, metadata.map).network.nodes
    where = f"map {metadata.map} of {metadata.scenario.name}, seed {metadata.seed}"
    other = f"one of {here} nodes" if here != learned else "another of as many"
    raise ModelError(
        f"the model in {folder} remembers the {learned} nodes of {where}; this map is {other}", field="fingerprint"
    )


def trainable(
    scenario: Scenario, seed: int, level: Information | None, name: Preset, destinations: int = 1
) -> Callable[[ScenarioMap, int], Darp]:
    """Make a factory of agents that are trained before they walk.

    Parameters
    ----------
    scenario, seed
        The maps that are walked. Where the scenario has maps of its own to train on, an agent is trained on these, once
        for all maps.
    level
        What agents observe; the scenario's own level by default.
    name
        The preset by which they learn.
    destinations
        Least number of destinations to learn; the preset may have more.

    Returns
    -------
    Callable
        Trains the agent of a map's number when it is first asked for.

    Raises
    ------
    TrainConfigError
        What is asked for cannot be learned at this level.
    """
    config = preset_for(scenario, name, level)
    config = config.changed(destinations=max(config.destinations, destinations))

    @lru_cache
    def learned(index: int) -> Darp:
        return trained_darp(train(scenario, config, seed=seed, index=index).model)

    return lambda _map, index: learned(0 if scenario.place.training_maps else index)
