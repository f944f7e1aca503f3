"""Gymnasium environments, and the same walks for learners in JAX: docs/gymnasium.md.

Importing this package registers ``sidestep/PaperGrid-v0``, ``sidestep/Rush-v0``, ``sidestep/ShiftingCrowds-v0`` and
``sidestep/Town-v0`` with Gymnasium; all else is loaded when it is first used.
"""

import gymnasium
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

IDS = {
    "sidestep/PaperGrid-v0": "paper-congested",
    "sidestep/Rush-v0": "rush-16",
    "sidestep/ShiftingCrowds-v0": "shifting-crowds",
    "sidestep/Town-v0": "helsinki",
}
"""Environments, with the scenario that each of them has unless it is told another."""

for _id, _scenario in IDS.items():
    gymnasium.register(
        _id,
        entry_point="sidestep.gym.env:WalkEnv",
        vector_entry_point="sidestep.gym.vector:WalkVectorEnv",
        kwargs={"scenario": _scenario},
    )
