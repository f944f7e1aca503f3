"""What an environment is made of: the keyword arguments of ``gymnasium.make``."""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, Field

from sidestep.arguments import brief
from sidestep.environment.types import Information
from sidestep.scenarios import values
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.spec import Spec, SpecError

Form = Literal["features", "node", "one-hot"]
"""What of a walker's observation is shown, and how."""
MaskForm = Literal["info", "dict", "tianshou"]
"""Where the mask of actions stands, beside ``info["action_mask"]``."""
TOWN_DESTINATIONS = 32
"""Destinations in towns, unless told otherwise or there are fewer."""


class EnvError(SpecError):
    """An environment that cannot be made so, or a walk in it that cannot be begun so; ``field`` is the argument."""


def _unset(value: Any) -> Any:
    """Leave out what is not given: gymnasium passes None for it."""
    return "NextStep" if value is None else getattr(value, "value", value)


class TaskOptions(Spec):
    """Keyword arguments of the functional core: whose walks, and what walkers know."""

    refusal = EnvError

    scenario: Scenario
    """A problem; in its place, the name of a built-in one or a scenario file."""
    level: Information | None = None
    """What walkers know; by default what the scenario says, and ``position`` where nothing but the node is shown."""
    map_seed: Annotated[int, Field(ge=0)] = 0
    """Seed of the map. ``reset(seed=…)`` decides which walks are walked on it."""
    map_index: Annotated[int, Field(ge=0)] = 0
    """Number of the map among those of the seed."""
    purpose: Literal["learn", "test"] = "learn"
    """Whether crowds are those to learn from, or those that agents are compared in: no future is in both."""
    futures: values.Count = 64
    """Futures of the crowds that walks are drawn from."""
    walks: Literal["scenario", "anywhere"] | None = None
    """Whether walks begin where the scenario's do or anywhere; by default as the scenario has it, anywhere in towns."""
    destinations: values.Count | None = None
    """How many crossings walks lead to; by default one on grids, and up to 32 in towns."""
    observation: Form = "features"
    """``features``: a vector of numbers; ``node``: the number of the crossing; ``one-hot``: a one in its place."""

    _level_of_form = values.across(
        "observation",
        lambda form, given: form == "features" or given["level"] in (None, "position"),
        "must be features above level position",
    )

    @property
    def shown_level(self) -> Information:
        """The level of the walkers."""
        return self.level or (self.scenario.level if self.observation == "features" else "position")

    @property
    def from_anywhere(self) -> bool:
        """Whether walks begin anywhere."""
        return self.walks == "anywhere" or (self.walks is None and self.scenario.place.anywhere)


class GymnaxOptions(TaskOptions):
    """Keyword arguments of :class:`sidestep.gym.gymnax.GymnaxEnv`, beside its ``api``."""

    mask: MaskForm = "info"
    """``info``: nowhere else; ``dict``: observations are ``{"observation", "action_mask"}``; ``tianshou``:
    ``{"obs", "mask"}``."""


class EnvOptions(GymnaxOptions):
    """Keyword arguments of Gymnasium's environments."""

    render_mode: Literal["human", "rgb_array"] | None = None
    """A window, or pictures as arrays."""
    render_fps: values.Positive = 4.0
    """Pictures a second, in a window and in films."""


class VectorOptions(EnvOptions):
    """Keyword arguments of vector environments."""

    render_mode: Literal["rgb_array"] | None = None
    """Pictures as arrays, one for each walker."""
    num_envs: values.Count = 1
    """Walkers."""
    autoreset_mode: Annotated[Literal["NextStep", "SameStep", "Disabled"], BeforeValidator(_unset)] = "NextStep"
    """When the next walk begins after the end of one, as :class:`gymnasium.vector.AutoresetMode` says."""
    max_episode_steps: values.Count | None = None
    """Segments after which a walk is cut off, beside the scenario's horizon."""


Options = TypeVar("Options", bound=TaskOptions)


def read_options(kind: type[Options], scenario: object, given: dict[str, Any]) -> Options:
    """Check the keyword arguments of an environment.

    Parameters
    ----------
    kind
        Which of them.
    scenario
        A scenario, its name or its file.
    given
        All others.

    Returns
    -------
    Options
        Checked.

    Raises
    ------
    EnvError
        Unknown and wrong values, each with its field.
    """
    if isinstance(scenario, str | Path):
        scenario = find_scenario(scenario)
    if not isinstance(scenario, Scenario):
        raise EnvError(f"scenario must be a name, a file or a scenario, not {brief(scenario)}", field="scenario")
    return kind(scenario=scenario, **given)
