"""Sidestep: pedestrian routes that take the least time through crowds that keep changing.

The public names are loaded when they are first used, so that ``import sidestep`` costs nothing.
"""

from importlib import import_module

__version__ = "0.1.0"

_HOME = {
    "BASELINES": "evaluation.compare",
    "Darp": "planners.darp",
    "PRESETS": "agent.config",
    "RoadNetwork": "network.graph",
    "Scenario": "scenarios",
    "SidestepError": "errors",
    "TrainConfig": "agent.config",
    "compare": "evaluation.compare",
    "draw_map": "scenarios",
    "make_environment": "scenarios",
    "instances": "scenarios",
    "road_network": "network.graph",
    "routes": "planners.base",
    "scenario": "scenarios",
    "train": "agent.train",
    "train_darp": "planners.darp",
}
__all__ = ["__version__", *_HOME]  # noqa: PLE0604 - all are strings


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'sidestep' has no attribute {name!r}")
    return getattr(import_module(f"sidestep.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
