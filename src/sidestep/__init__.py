"""Sidestep: pedestrian routes that take the least time through crowds that keep changing.

The public names are loaded when they are first used, so that ``import sidestep`` costs nothing.
"""

from importlib import import_module

__version__ = "0.1.0"

_HOME = {
    "Darp": "planners.learned",
    "PRESETS": "agent.presets",
    "RoadNetwork": "network.graph",
    "Scenario": "scenarios.model",
    "SidestepError": "errors",
    "TrainConfig": "agent.config",
    "choose_planners": "planners.registry",
    "compare": "evaluation.compare",
    "draw_training_map": "scenarios.maps",
    "find_planner": "planners.registry",
    "foresee": "routing.grid_plan",
    "import_osm": "network.osm",
    "load_helsinki": "network.formats",
    "load_model": "agent.checkpoint",
    "load_scenario": "scenarios.reader",
    "load_town": "network.formats",
    "preset": "agent.presets",
    "trained_darp": "planners.learned",
    "draw_map": "scenarios.maps",
    "make_environment": "scenarios.futures",
    "instances": "scenarios.episodes",
    "register_planner": "planners.registry",
    "road_network": "network.graph",
    "routes": "planners.base",
    "scenario": "scenarios.builtin",
    "train": "agent.train",
    "train_darp": "planners.learned",
}
__all__ = ["__version__", *_HOME]  # noqa: PLE0604 - all are strings


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'sidestep' has no attribute {name!r}")
    return getattr(import_module(f"sidestep.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
