"""Studies: which agents are trained on what, and whom they walk beside, in a file of TOML. docs/sweeps.md has the keys.

A study is a grid, or several grids: every combination of its lists is one training. What a study asks for becomes a
list of jobs, each of which can be done by itself, anywhere.
"""

import hashlib
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator, Field, ValidationError

from sidestep.agent.config import TrainConfig, differences, settings_by_name
from sidestep.agent.presets import Preset, preset_for
from sidestep.arguments import MOST_COUNTED, MOST_WHOLE, PATH, checked
from sidestep.environment.types import Information
from sidestep.errors import SidestepError
from sidestep.files import cached_by_files
from sidestep.planners.registry import BASELINE, BOUND, REFERENCE, choose_planners, find_planner, planner_infos
from sidestep.scenarios.builtin import BUILT_IN
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.spec import Fault, Spec, SpecError, faults, shown
from sidestep.scenarios.toml_files import read_toml, refusal
from sidestep.scenarios.values import distinct, rule

MOST_JOBS = 100_000
LONGEST_NAME = 255  # bytes, of most file systems
AGENT = "darp"
"""What tables call the agents."""
_SPAN = re.compile(r"(\d{1,9})-(\d{1,9})")
_NOT_IN_NAMES = re.compile(r"[^\w.+=-]+")
Values = dict[str, Any]
"""Values by key; a tuple has several to choose from."""


class StudyError(SpecError):
    """A study that is wrong; ``field`` and ``line`` say where in its file."""


def _listed(value: object) -> object:
    return value if isinstance(value, tuple) else (value,)


def _numbers(value: object) -> object:
    """Numbers in a list, one by itself, or a span such as 0-499."""
    span = _SPAN.fullmatch(value) if isinstance(value, str) else None
    if span is None:
        return _listed(value)
    first, last = map(int, span.groups())
    if not first <= last < first + MOST_JOBS:
        raise ValueError(f"must be a span of at most {MOST_JOBS:,} numbers such as 0-9, not {shown(value)}")
    return tuple(range(first, last + 1))


_Several = rule(bool, "must have at least one value")
_Numbers = Annotated[
    tuple[Annotated[int, Field(ge=0, le=MOST_WHOLE)], ...], _Several, distinct, BeforeValidator(_numbers)
]
_Listed = BeforeValidator(_listed)


class StudyTable(Spec):
    """A grid of trainings, as a table of a study's file says it. A value may stand for a list of one."""

    refusal: ClassVar[type[SpecError]] = StudyError

    scenarios: Annotated[tuple[str, ...], _Several, distinct, _Listed] = Field((), validate_default=False)
    """Names, or scenario files, which are looked for from the study's folder."""
    changes: Values = Field({})
    """Fields of the scenarios with other values; lists have several to choose from."""
    maps: _Numbers = (0,)
    """Numbers of the maps that are learned, and walked."""
    seeds: _Numbers = (0,)
    """Seeds of maps, crowds and training."""
    levels: Annotated[tuple[Information, ...], _Several, distinct, _Listed] = Field((), validate_default=False)
    """What agents observe; each scenario's own level if it is left out."""
    presets: Annotated[tuple[Preset, ...], _Several, distinct, _Listed] = ("default",)
    """Settings of the learner, by name."""
    settings: Values = Field({})
    """Settings with other values than in the preset; lists have several to choose from."""
    variants: dict[str, dict[str, Any]] = Field({})
    """Settings that are changed in agents beside the plain ones, by a name for each such variant."""
    planners: Annotated[tuple[str, ...], distinct, _Listed] = ()
    """Planners that walk as well; shortest-path, expected and clairvoyant always do."""
    walks: Annotated[int, Field(ge=1, le=MOST_COUNTED)] | None = None
    """Walks on each map; by default the scenario's."""


class StudyFile(StudyTable):
    """A whole file: one grid, or what all of its ``grids`` have in common."""

    grids: dict[str, StudyTable] = Field({})


@dataclass(frozen=True)
class Agent:
    """An agent to train: how, and how this differs from other agents of the study."""

    config: TrainConfig
    preset: Preset
    variant: str
    """Name of the variant; empty for the plain agent."""
    settings: tuple[tuple[str, Any], ...]
    """Those that the study has in lists, by name."""

    @property
    def name(self) -> str:
        """Unique among the agents of a problem."""
        return "_".join([self.config.level, self.preset, *filter(None, [self.variant]), *map(_setting, self.settings)])


@dataclass(frozen=True)
class Job:
    """One training and its walks, or the walks of the planners that need none."""

    scenario: Scenario
    changes: tuple[tuple[str, Any], ...]
    """Fields of the scenario that the study has in lists, by name."""
    seed: int
    """Of map, crowds and training."""
    map: int
    """Number of the map that is learned."""
    walks: int
    """On each map."""
    planners: tuple[str, ...]
    """Planners that walk, where nothing is trained, as the study names them."""
    agent: Agent | None
    """What is trained; None for the walks of the planners."""

    @property
    def problem(self) -> str:
        """The scenario with its changes, for people."""
        return " ".join([self.scenario.name, *map(_setting, self.changes)])

    @property
    def title(self) -> str:
        """All that tells it from other jobs, in the study's own words."""
        who = "planners" if self.agent is None else self.agent.name
        return "_".join([self.scenario.name, *map(_setting, self.changes), f"map-{self.map}", f"seed-{self.seed}", who])

    @property
    def name(self) -> str:
        """Its folder: unique in a study, and the same whatever else the study asks for."""
        return _NOT_IN_NAMES.sub("-", self.title)

    @property
    def planner_names(self) -> list[str]:
        """What the planners call themselves."""
        return [find_planner(name).name for name in self.planners]

    @property
    def walked(self) -> tuple[int, ...]:
        """Numbers of the maps that are walked: the one that is learned, or all that training held out."""
        return tuple(range(self.scenario.maps)) if self.scenario.place.training_maps else (self.map,)

    def to_json(self) -> dict[str, Any]:
        """All that its result depends on, by name."""
        config = None if self.agent is None else self.agent.config
        files = {f"contents of {file}": _digest(file) for file in self.scenario.place.files}
        return {**settings_by_name(self.scenario, self.seed, self.map, config), "walks": self.walks, **files}


@cached_by_files(lambda file: (file,), most=64)
def _digest(file: str) -> str | None:
    """What a file of streets or counts holds, in a few letters; None where it is missing, as some may be."""
    try:
        return hashlib.blake2b(Path(file).read_bytes(), digest_size=8).hexdigest()
    except OSError:
        return None


@dataclass(frozen=True)
class Study:
    """What a study asks for."""

    name: str
    jobs: tuple[Job, ...]
    """First the planners' walks of each problem, then agent after agent."""


def _setting(named: tuple[str, Any]) -> str:
    """A setting and its value, such as gamma=0.9, in the name of a job."""
    name, value = named
    text = "x".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return f"{name}={text.lower() if isinstance(value, bool) else text}"


@checked(StudyError, path=PATH)
def read_study(path: str | Path) -> Study:
    """Read a study, and make sure that all it asks for can be done.

    Parameters
    ----------
    path
        A TOML file, as docs/sweeps.md describes it.

    Returns
    -------
    Study
        Its jobs.

    Raises
    ------
    StudyError
        One sentence that names the file and, where they are known, the line and the field; ``others`` has further
        mistakes.
    """
    path = Path(path)
    text, values = read_toml(path, "study", StudyError)
    try:
        return Study(path.stem, _jobs(values, path.parent))
    except (ValidationError, _Mistake) as error:
        refused = refusal(path, text, _faults(error), StudyError)
        raise refused from error


def make_study(name: str, values: Values) -> Study:
    """Make a study of what its file would say.

    Parameters
    ----------
    name
        What it is called.
    values
        By the keys of docs/sweeps.md; tuples for lists.

    Returns
    -------
    Study
        Its jobs.

    Raises
    ------
    StudyError
        One sentence about the first mistake, with its field.
    """
    try:
        return Study(name, _jobs(values, Path()))
    except (ValidationError, _Mistake) as error:
        first, *_ = _faults(error)
        raise StudyError(first.sentence, field=".".join(first.path)) from error


def _jobs(values: Values, folder: Path) -> tuple[Job, ...]:
    """All jobs of a study, whose scenario files are looked for from a folder."""
    read = StudyFile.model_validate(values)
    jobs: dict[str, Job] = {}
    for name, table in read.grids.items() or [("", StudyTable())]:
        for job in _Grid(read, name, table, folder).jobs():
            _add(jobs, job)
    # In the order of the file; within a problem, a worker that goes on with the same agent has compiled it already.
    problems = list(dict.fromkeys(job.problem for job in jobs.values()))
    return tuple(sorted(jobs.values(), key=lambda job: (problems.index(job.problem), job.agent is not None)))


def _faults(error: "ValidationError | _Mistake") -> list[Fault]:
    return faults(error, StudyFile) if isinstance(error, ValidationError) else [error.fault]


class _Mistake(Exception):  # noqa: N818 - it becomes a StudyError
    """Something in a study that can't be."""

    def __init__(self, place: tuple[str, ...], sentence: str) -> None:
        super().__init__(sentence)
        self.fault = Fault(place, sentence)


def _add(jobs: dict[str, Job], job: Job) -> None:
    """Take a job, or the planners of one that is there: grids may share maps."""
    if len(job.name.encode()) > LONGEST_NAME:
        sentence = f"the folder of a job would have a name of more than {LONGEST_NAME} bytes, {job.name:.60}…"
        raise _Mistake(("scenarios",), f"{sentence}; choose shorter names of scenarios and variants, or fewer lists")
    there = jobs.get(job.name)
    if there is None:
        jobs[job.name] = job
        return
    if there.title != job.title:
        sentence = f"{there.title} and {job.title} would have the same folder, {job.name}"
        raise _Mistake(("variants" if job.agent else "scenarios",), f"{sentence}; rename one")
    for name, values in differences(there.to_json(), job.to_json()).items():
        both = " and ".join(map(shown, values))
        field = name.rpartition(".")[2]
        # In a list, a setting is in the job's name; there are no lists of walks.
        remedy = "ask for the same in all grids" if field == "walks" else f"make {field} a list"
        sentence = f"{job.name} is asked for twice, with {name} {both}; {remedy}"
        raise _Mistake(("grids",), sentence)
    if job.agent is None:
        planners = tuple(dict.fromkeys((*there.planners, *job.planners)))
        jobs[job.name] = replace(job, planners=planners)


class _Grid:
    """One grid of a study: what its own table says, or else the file."""

    def __init__(self, file: StudyFile, name: str, own: StudyTable, folder: Path) -> None:
        said = {key: getattr(file, key) for key in file.model_fields_set - {"grids"}}
        self._file_keys = said.keys()
        self._own = {key: getattr(own, key) for key in own.model_fields_set}
        self._table = StudyTable.model_construct(**{**dict(StudyTable()), **said, **self._own})
        self._name, self._folder = name, folder

    def jobs(self) -> Iterator[Job]:
        """All jobs of the grid; a :class:`_Mistake` where one can't be done."""
        table = self._table
        if not table.scenarios:
            raise _Mistake(self._place("scenarios"), f"{'.'.join(self._place('scenarios'))} is missing")
        numbers, total = len(table.maps) * len(table.seeds), 0
        for scenario, changes in self._problems():
            if scenario.place.training_maps and table.maps != (0,):
                said = (
                    f"agents of {scenario.name} learn its {scenario.place.training_maps} training maps; leave out maps"
                )
                raise _Mistake(self._place("maps"), said)
            with self._at("planners"):
                planners = self._planners(scenario)
            for agent in (None, *self._agents(scenario)):
                total += numbers
                if total > MOST_JOBS:
                    raise _Mistake(self._place("seeds"), f"more than {MOST_JOBS:,} jobs are no study")
                for map_number, seed in product(table.maps, table.seeds):
                    walk = () if agent else planners
                    yield Job(scenario, changes, seed, map_number, table.walks or scenario.walks, walk, agent)

    def _problems(self) -> Iterator[tuple[Scenario, tuple[tuple[str, Any], ...]]]:
        for name in self._table.scenarios:
            with self._at("scenarios"):  # before any change
                find_scenario(self._file(name))
            for changes, listed in self._choices("changes", self._table.changes):
                with self._at("changes"):
                    yield find_scenario(self._file(name), **changes), listed

    def _file(self, name: str) -> str:
        """A scenario's name, or its file from the study's folder."""
        in_a_file = name not in BUILT_IN and (name.endswith(".toml") or set(name) & {os.sep, os.altsep})
        return str(self._folder / name) if in_a_file else name

    def _planners(self, scenario: Scenario) -> tuple[str, ...]:
        infos = planner_infos()
        for name in self._table.planners:
            if name in infos and infos[name].learns:
                raise StudyError(f"{name} learns, and all that learn are agents of levels and presets; leave it out")
        choose_planners(scenario, self._table.planners)
        return tuple(dict.fromkeys((REFERENCE, BASELINE, BOUND, *self._table.planners)))

    def _agents(self, scenario: Scenario) -> list[Agent]:
        found: list[Agent] = []
        used = set()
        for level, preset in product(self._table.levels or (scenario.level,), self._table.presets):
            with self._at("levels", preset="presets"):
                config = preset_for(scenario, preset, level)
            for settings, listed in self._choices("settings", self._table.settings):
                plain = self._changed(scenario, config, settings, "settings")
                found.append(Agent(plain, preset, "", listed))
                for name, changes in self._table.variants.items():
                    changed = self._changed(scenario, plain, changes, "variants", name)
                    if changed != plain:
                        used.add(name)
                        found.append(Agent(changed, preset, name, listed))
        for name in self._table.variants:
            if not name:
                raise _Mistake(self._place("variants"), "a variant must have a name; '' is that of the plain agents")
            if name not in used:
                raise _Mistake(self._place("variants", name), f"variants.{name} changes nothing")
        return found

    def _changed(self, scenario: Scenario, config: TrainConfig, settings: Values, *key: str) -> TrainConfig:
        if "level" in settings:
            raise _Mistake(self._place(*key, "level"), "level is no setting; name it in levels")
        with self._at(*key):
            changed = config.changed(**settings)
        if changed.remembers_places and scenario.place.training_maps:
            said = "places must be 0 where maps are walked that were not learned"
            raise _Mistake(self._place(*key, "places"), said)
        return changed

    def _choices(self, key: str, values: Values) -> Iterator[tuple[Values, tuple[tuple[str, Any], ...]]]:
        """Each combination of values, and those of them that stand in lists."""
        several = {name: value for name, value in values.items() if isinstance(value, tuple)}
        for name, value in several.items():
            if not value:
                raise _Mistake(self._place(key, name), f"{key}.{name} must have at least one value, not []")
            for number, one in enumerate(value):
                if one in value[:number]:  # 1 and 1.0 are one setting, and would be two folders
                    both = f"{shown(value[value.index(one)])} and {shown(one)}"
                    said = f"{key}.{name} must all be different, and {both} are the same; leave one out"
                    said += f", or write [{shown(list(value))}] for one value that is a list"
                    raise _Mistake(self._place(key, name), said)
        for combination in product(*several.values()):
            listed = dict(zip(several, combination, strict=True))
            yield values | listed, tuple(listed.items())

    def _place(self, key: str, *within: str) -> tuple[str, ...]:
        """Where a key of this grid stands in the file."""
        own = self._name and (key in self._own or key not in self._file_keys)
        return (*(("grids", self._name) if own else ()), key, *within)

    @contextmanager
    def _at(self, *key: str, **others: str) -> Iterator[None]:
        """Say where in the file a mistake is; ``others`` are keys that stand for other fields."""
        try:
            yield
        except (SidestepError, TypeError) as error:  # TypeError: the key is self
            field = getattr(error, "field", None) or ""
            first, *_ = field.split(".")
            place = self._place(others[field]) if field in others else self._place(*key)
            if key[0] in ("changes", "settings", "variants") and first:
                place = (*place, first)
            raise _Mistake(place, str(error)) from error


def labels(jobs: Sequence[Job]) -> dict[str, str]:
    """What tables call each job's agent: what all agents of its problem have in common is left out.

    Parameters
    ----------
    jobs
        All jobs of a study.

    Returns
    -------
    dict[str, str]
        By the job's name; without the planners' jobs.
    """
    found = {}
    for problem in {job.problem for job in jobs}:
        agents = {job.name: job.agent for job in jobs if job.problem == problem and job.agent is not None}
        levels, presets = ({pick(agent) for agent in agents.values()} for pick in (_level, _preset))
        for name, agent in agents.items():
            parts = [_level(agent)] * (len(levels) > 1) + [_preset(agent)] * (len(presets) > 1)
            parts += [*filter(None, [agent.variant]), *map(_setting, agent.settings)]
            found[name] = "-".join([AGENT, *parts])
    return found


def _level(agent: Agent) -> str:
    return agent.config.level


def _preset(agent: Agent) -> str:
    return agent.preset
