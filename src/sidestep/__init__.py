"""Sidestep: pedestrian routes that take the least time through crowds that keep changing.

The public names are loaded when they are first used, so that ``import sidestep`` costs nothing.
"""

from importlib import import_module

__version__ = "0.1.0"

_HOME = {
    "BASELINES": "planners.registry",
    "Darp": "planners.learned",
    "PRESETS": "agent.presets",
    "RoadNetwork": "network.graph",
    "RoutePlan": "routing.plan",
    "RouteRequest": "routing.request",
    "Router": "routing.router",
    "Scenario": "scenarios.model",
    "SidestepError": "errors",
    "TrainConfig": "agent.config",
    "compare": "evaluation.compare",
    "draw_training_map": "scenarios.maps",
    "import_osm": "network.osm",
    "load_helsinki": "network.formats",
    "load_model": "agent.checkpoint",
    "load_scenario": "scenarios.reader",
    "load_town": "network.formats",
    "plan_route": "routing.router",
    "preset": "agent.presets",
    "trained_darp": "planners.learned",
    "draw_map": "scenarios.maps",
    "make_environment": "scenarios.futures",
    "instances": "scenarios.episodes",
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
