"""Sidestep plans walks that take the least time, or meet the fewest people, through changing crowds.

The public names are loaded when they are first used, so that ``import sidestep`` costs nothing. The stub beside this
file, ``__init__.pyi``, is their only list.
"""

import sys

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Where Gymnasium is in use, it knows these environments: gymnasium.make("sidestep/Rush-v0"). Alone, it is not loaded.
if "gymnasium" in sys.modules:
    from sidestep import gym as gym
