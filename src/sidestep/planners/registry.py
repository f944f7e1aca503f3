"""All planners by name: those that come with Sidestep, those of installed packages, and your own.

There are three ways to make a planner of your own known, and then it works in ``compare``, ``route`` and the reports:

- in Python, :func:`register_planner`, also as the decorator of the class;
- in a package, an entry point of the group ``sidestep.planners``: ``my-planner = "my_package:MyPlanner"``;
- on the command line, its place instead of a name: ``--planner my_module:MyPlanner``.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from inspect import getdoc
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from sidestep.arguments import COUNT, PATH, SEED, brief, checked, each, instance, one_of
from sidestep.environment.types import LEVELS, Information, Level
from sidestep.errors import SidestepError, hint
from sidestep.planners.base import Planner
from sidestep.planners.random import RandomProgress, RandomWalk
from sidestep.planners.reactive import Forecast, GreedyLocal, GreedyMap, Snapshot
from sidestep.planners.real_time import LrtaStar
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import A_SCENARIO, Scenario

REFERENCE = ShortestPath.name
"""The planner that savings are measured against."""

BASELINE = Expected.name
"""The planner that differences are measured against, unless another is named."""

BOUND = Clairvoyant.name
"""The planner that no other beats: the lower bound, which gaps are measured against."""

ENTRY_POINTS = "sidestep.planners"
"""The group of entry points under which packages offer planners."""

PlannerFactory = Callable[[ScenarioMap, int], Planner | None]
"""Makes the planner for a map and its number. None skips this map, and then all later ones."""

PlannerSource = TypeVar("PlannerSource")


A_NAME = instance(str, "the name of a planner, such as expected")
"""What public functions take as a planner's name."""


class PlannerError(SidestepError):
    """A planner that is unknown, or that does not fit."""


@dataclass(frozen=True)
class PlannerInfo:
    """A planner that is known by name."""

    name: str
    level: Level | Literal["any"]
    """What it may know; planners that learn at any level say ``any``."""

    summary: str
    """One line that says how it decides: the first line of its class's docstring."""

    use: str
    """One line that says when to use it."""

    planner: Planner | None = None
    """The planner itself; None where it has to be trained first."""

    @property
    def learns(self) -> bool:
        """Whether it has to be trained before it walks."""
        return self.planner is None


def register_planner(planner: PlannerSource, *, use: str = "") -> PlannerSource:
    """Make a planner known by its name; also the decorator of a planner's class.

    Parameters
    ----------
    planner
        A planner, or a class or function that returns one when called without arguments.
    use
        One line for ``sidestep planners`` that says when to use it.

    Returns
    -------
    PlannerSource
        The argument, unchanged.

    Raises
    ------
    PlannerError
        An object that lacks a part of the protocol, or a name that is taken by a planner of Sidestep.

    Examples
    --------
    >>> import sidestep
    >>> from sidestep.planners.time_dependent import Expected
    >>> @sidestep.register_planner
    ... class Optimist(Expected):
    ...     '''Hope that crowds come as expected.'''
    ...
    ...     name = "optimist"
    >>> sidestep.find_planner("optimist").level
    'map'
    """
    _add(planner, use)
    return planner


def _add(source: object, use: str = "") -> PlannerInfo:
    """Register a planner."""
    said = f"{source!r:.80} is no planner"
    try:
        planner: Any = source() if callable(source) else source
    except TypeError as error:
        raise PlannerError(f"{said} that can be made without arguments: {error}", field="planner") from error
    lacking = [part for part in ("name", "level", "observes", "decide", "plan") if not hasattr(planner, part)]
    if lacking:
        raise PlannerError(f"{said}: it has no {', no '.join(lacking)}", field="planner")
    if not isinstance(planner.name, str) or not planner.name.strip():
        raise PlannerError(f"{said}: its name must be text, not {brief(planner.name)}", field="planner")
    for part, known in (("level", get_args(Level)), ("observes", LEVELS)):
        if getattr(planner, part) not in known:
            raise PlannerError(f"{said}: its {part} must be one of {', '.join(known)}", field="planner")
    if planner.name in _BUILT_IN:
        raise PlannerError(f"{said} to add: the name {planner.name} is Sidestep's own", field="planner")
    summary = (getdoc(type(planner)) or "").partition("\n")[0]
    _KNOWN[planner.name] = PlannerInfo(planner.name, planner.level, summary, use, planner)
    return _KNOWN[planner.name]


def planner_infos() -> dict[str, PlannerInfo]:
    """List all planners: Sidestep's, registered ones, and those of installed packages.

    Returns
    -------
    dict of PlannerInfo
        By name.

    Raises
    ------
    PlannerError
        A planner of an installed package that does not load.
    """
    for point in entry_points(group=ENTRY_POINTS):
        _info(point.name)
    return dict(_KNOWN)


def _info(name: str) -> PlannerInfo:
    """Find a planner by its name or its place, ``module:name``."""
    if name in _KNOWN:
        return _KNOWN[name]
    installed = {point.name: point.value for point in entry_points(group=ENTRY_POINTS)}
    if ":" not in name and name not in installed:
        meant = hint(name, [*_KNOWN, *installed], "MODULE:NAME of your own")
        raise PlannerError(f"unknown planner {name!r:.60}{meant}", field="planner")
    place = installed.get(name, name)
    module, _, attribute = place.partition(":")
    try:
        source = getattr(import_module(module), attribute)
    except Exception as error:  # somebody else's module may raise anything
        raise PlannerError(f"no planner at {place}: {error}", field="planner") from error
    found = _add(source)
    if name in installed and name != found.name:
        said = f"the entry point {name} leads to a planner that is called {found.name}; rename one"
        raise PlannerError(said, field="planner")
    return found


@checked(PlannerError, name=A_NAME)
def find_planner(name: str) -> Planner:
    """Find a planner that need not be trained.

    Parameters
    ----------
    name
        The planner's name, or its place as ``module:name``.

    Returns
    -------
    Planner
        Ready to plan and walk.

    Raises
    ------
    PlannerError
        Unknown names, and planners that learn.

    Examples
    --------
    >>> import sidestep
    >>> sidestep.find_planner("greedy-map").level
    'map'
    """
    planner = _info(name).planner
    if planner is None:
        raise PlannerError(f"{name} learns, so it needs a trained model; give --model FOLDER", field="planner")
    return planner


@dataclass(frozen=True)
class Lineup:
    """Planners that were chosen for a scenario."""

    scenario: Scenario
    factories: dict[str, PlannerFactory]
    """By name, in the order of tables: what :func:`sidestep.compare` takes."""

    baseline: str = BASELINE
    """Name of the planner that the others' minutes are set against."""

    only_map: int | None = None
    """Number of the only map that they can walk, where one of them is a model that remembers its places."""

    @checked(PlannerError, maps=COUNT)
    def map_numbers(self, maps: int | None = None) -> list[int]:
        """Number the maps to walk.

        Parameters
        ----------
        maps
            How many; None leaves it to the scenario.

        Returns
        -------
        list of int
            Numbers for :func:`sidestep.compare`.

        Raises
        ------
        PlannerError
            Not a number of maps, or any number where a model remembers a single one (field ``maps``).
        """
        if self.only_map is None:
            return list(range(self.scenario.maps if maps is None else maps))
        if maps is not None:
            raise PlannerError(f"the model remembers map {self.only_map} alone; leave out --maps", field="maps")
        return [self.only_map]


@checked(
    PlannerError,
    scenario=A_SCENARIO,
    names=each(A_NAME, "a list of names of planners", least=0),
    models=each(PATH, "a list of folders of models", least=0),
    against=A_NAME,
    seed=SEED,
    level=one_of(LEVELS),
    destinations=COUNT,
)
def choose_planners(
    scenario: Scenario,
    names: Iterable[str] | None = None,
    *,
    models: Iterable[Path | str] = (),
    against: str = BASELINE,
    seed: int = 0,
    level: Information | None = None,
    preset: Literal["default", "paper", "dqn", "tabular-q"] = "default",
    destinations: int = 1,
) -> Lineup:
    """Choose planners by name.

    The three that the others are measured against are always among them: ``shortest-path``, ``expected`` and
    ``clairvoyant``.

    Parameters
    ----------
    scenario
        The scenario that they walk.
    names
        Names of planners, or places such as ``my_module:MyPlanner``. By default all of Sidestep's planners that need no
        training and, without models, ``darp``, which is trained before it walks.
    models
        Folders of trained models, which are chosen in any case. One walks as ``darp``, several as ``darp-`` and the
        name of their folder.
    against
        The planner that the others' minutes are set against; it is chosen, too.
    seed, level, preset
        How planners that learn are trained: seed of map and training, what the agent observes, and the way to learn.
    destinations
        Number of destinations that walks go to.

    Returns
    -------
    Lineup
        The planners, and the maps that they can walk.

    Raises
    ------
    SidestepError
        Unknown planners, and models that cannot walk this scenario.

    Examples
    --------
    >>> import sidestep
    >>> list(sidestep.choose_planners(sidestep.scenario("rush-16"), ["greedy-map"]).factories)
    ['shortest-path', 'expected', 'clairvoyant', 'greedy-map']
    """
    learned: dict[str, Planner] = {}
    only_map = None
    if models:
        from sidestep.planners.learned import load_planners

        loaded = load_planners([Path(folder) for folder in models], scenario, seed, level)
        loaded.check_destinations(draw_map(scenario, seed, loaded.index or 0), destinations)
        learned, only_map = loaded.planners, loaded.index
    if names is None:
        names = [name for name, info in _BUILT_IN.items() if not info.learns or (name == "darp" and not models)]
    found = {name: _info(name).name for name in (*names, REFERENCE, BASELINE, BOUND, against) if name not in learned}
    planners = {name: info.planner for name, info in _KNOWN.items() if name in found.values()} | learned
    factories: dict[str, PlannerFactory] = {}
    for name, planner in planners.items():
        factories[name] = lambda *_, planner=planner: planner
        if planner is None:
            from sidestep.planners.learned import trainable

            at: Any = level if _KNOWN[name].level == "any" else _KNOWN[name].level
            way: Any = preset if name == "darp" else name
            factories[name] = trainable(scenario, seed, at, way, destinations)
    return Lineup(scenario, factories, found.get(against, against), only_map)


_KNOWN: dict[str, PlannerInfo] = {}
_BUILT_IN: dict[str, PlannerInfo] = {}
for _planner, _use in (
    (RandomWalk, "The floor: one reading of the paper's random selection."),
    (RandomProgress, "The other reading; what a walker without a plan may still do."),
    (ShortestPath, "The reference of all savings: what most navigation does."),
    (Expected, "The default of `route`: when no live counts are at hand."),
    (Clairvoyant, "Never in practice: the bound that shows what is left to gain."),
    (GreedyLocal, "When there is no map, only what is in sight."),
    (LrtaStar, "The same in a town, where streets end or bend: it mostly arrives."),
    (GreedyMap, "When a map and expected crowds are at hand, and the walker looks around."),
    (Snapshot, "When all counters report now, and crowds change slowly."),
    (Forecast, "When all counters report now: the best without training."),
):
    _add(_planner, _use)
_LEARNERS: tuple[tuple[str, Level | Literal["any"], str, str], ...] = (
    ("darp", "any", "Follow the Q-values that a dueling network learned.", "When crowds are noisy but can be learned."),
    ("dqn", "any", "The same without dueling heads, double Q-learning and priorities.", "To see what these are worth."),
    ("tabular-q", "position", "Follow a table of Q-values, one for each exit.",
     "As the simplest baseline that learns."),
)  # fmt: skip
_KNOWN |= {learner[0]: PlannerInfo(*learner) for learner in _LEARNERS}
_BUILT_IN |= _KNOWN
