"""The demonstration: one congested map, an agent that learns it, and the paths that planners then take."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from sidestep import plotting
from sidestep.agent.presets import PRESETS
from sidestep.agent.runs import OnRound, train
from sidestep.evaluation.compare import Comparison, compare
from sidestep.experiments.paper import PLANNERS
from sidestep.planners.base import routes
from sidestep.planners.learned import Darp, trained_darp
from sidestep.planners.registry import BOUND, REFERENCE, choose_planners, find_planner
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map, purpose_key

SCENARIO = "paper-congested"
CONFIG = PRESETS["default"]
"""How the agent learns."""

WALKS = 200
TRACE = 200
"""Most segments of a route that are drawn."""


def demonstrate(picture: Path, seed: int, on_round: OnRound) -> Comparison:
    """Train on map 0 of a seed, compare all planners there, and draw the first of the test walks.

    Parameters
    ----------
    picture
        File for the picture (.png).
    seed
        Seed of the map, the crowds and the training.
    on_round
        Called after every round of training.

    Returns
    -------
    Comparison
        Of the agent and the planners of the paper.
    """
    problem = scenario(SCENARIO)
    scenario_map = draw_map(problem, seed)
    darp = trained_darp(train(problem, CONFIG, seed=seed, on_round=on_round).model)
    planners = choose_planners(problem, PLANNERS).factories | {Darp.name: lambda *_: darp}
    comparison = compare(problem, planners, maps=[0], walks=WALKS, seed=seed)
    params = make_environment(problem, scenario_map, "test", WALKS)
    walk = instances(problem, scenario_map, params, 1)
    shown = {
        planner.name: routes(planner, params, walk, purpose_key(scenario_map, "test"), TRACE)[0]
        for planner in (find_planner(REFERENCE), darp, find_planner(BOUND))
    }
    title = f"{problem.name}, map 0, seed {seed}: one walk through crowds that were not known beforehand"
    volume = np.asarray(scenario_map.flow.expected(jnp.zeros(1), 1).counted[0, 0])
    plotting.save(plotting.crowded_map(title, params, volume, shown), picture)
    return comparison
