"""Scenarios in files: a place of one's own, said in TOML. docs/scenarios.md lists the fields.

A file has the names of the specs of :mod:`sidestep.scenarios.model`. It differs in values: minutes for seconds, names
of weekdays, dates, tables of sensors and lights by name, lists for tuples, and files looked for from its own folder.
"""

import os
from collections.abc import ItemsView
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, ValidationError, field_validator

from sidestep.arguments import PATH, checked
from sidestep.crowds.counts import TEST, TRAIN
from sidestep.crowds.wall_time import DAYS
from sidestep.scenarios import values
from sidestep.scenarios.builtin import AUCKLAND_SENSORS, BUILT_IN, HELSINKI_TIMEZONE, scenario
from sidestep.scenarios.model import RewardSpec, Scenario, read_objective
from sidestep.scenarios.places import CountColumns, Counters, CrowdTable, Light, Sensor, Traffic, Venue
from sidestep.scenarios.spec import ScenarioError, faults, shown
from sidestep.scenarios.toml_files import read_toml, refusal
from sidestep.scenarios.walkers import read_walkers
from sidestep.walking.speed_laws import Law

PAIRED = "paired"


def _found(built_in: str, name: str, info: Any) -> str:
    """What comes with the package, or a file that is there, by its whole path."""
    if name == built_in:
        return name
    file = Path(info.context["folder"], name)
    try:
        there, folder = file.exists(), file.is_dir()
    except OSError as error:  # too long a name
        raise ValueError(f"must be the name of a file, not {shown(name)}") from error
    if not there or folder:
        or_built_in = f' or "{built_in}"' if built_in else ""
        raise ValueError(f"must be a file{or_built_in}, but {file} {'is a folder' if folder else 'does not exist'}")
    return str(file.resolve())


def _seconds(minutes: float) -> float:
    return 60 * minutes


def _both_seconds(minutes: tuple[float, float]) -> tuple[float, float]:
    return 60 * minutes[0], 60 * minutes[1]


def _weekday(value: object) -> int:
    for number, day in enumerate(DAYS):
        if isinstance(value, str) and value.strip().lower() in (day.lower(), day[:3].lower()):
            return number
    short = ", ".join(day[:3] for day in DAYS)
    raise ValueError(f"must be weekdays, {short}, or a span such as Mon-Fri, not {shown(value)}")


def _weekdays(value: object) -> object:
    """Numbers of weekdays from names in a list, or from a span such as Fri-Mon."""
    if isinstance(value, str) and value.count("-") == 1:
        first, last = map(_weekday, value.split("-"))
        return tuple(sorted((first + step) % 7 for step in range((last - first) % 7 + 1)))
    return tuple(sorted(map(_weekday, value if isinstance(value, tuple) else (value,))))


def _texts(value: object) -> object:
    """Dates and times as text."""
    if not isinstance(value, tuple):
        return value
    return tuple(day.isoformat() if isinstance(day, date) else day for day in value)


def _by_name(kind: Any, value: object) -> ItemsView[str, Any]:
    """The items of a table, by default none; mistakes in them are mistakes of these fields."""
    return TypeAdapter(dict[str, kind]).validate_python({} if value == () else value, strict=True).items()


class _TimedLight(Light):
    name: Literal[""] = ""


def _paired(value: object) -> object:
    if value != PAIRED and not isinstance(value, tuple):
        dotted = "; a name with a dot in it needs quotes" if isinstance(value, dict) else ""
        raise ValueError(f'must be [latitude, longitude] or "{PAIRED}", not {shown(value)}{dotted}')
    return None if value == PAIRED else value


def _sensors(table: object) -> tuple[Sensor, ...]:
    return tuple(Sensor(name=name, place=place) for name, place in _by_name(_SensorPlace, table))


def _lights(table: object) -> tuple[Light, ...]:
    return tuple(Light(**dict(light) | {"name": name}) for name, light in _by_name(_TimedLight, table))


_SensorPlace = Annotated[values.Degrees | None, BeforeValidator(_paired)]
_Period = Annotated[values.Period, BeforeValidator(_texts)]


def _listed(value: object) -> object:
    return (value,) if isinstance(value, str) else value


_Names = Annotated[tuple[values.Line, ...], BeforeValidator(_listed)]


class CountColumnsFile(CountColumns):
    """``[place.crowd_source.columns]``; one name need not stand in a list."""

    count: _Names = ()
    ignore: _Names = ()


class CountersFile(Counters):
    """``[place.crowd_source]``, where its kind is ``counters``."""

    file: Annotated[values.Line, AfterValidator(partial(_found, "auckland"))] = "auckland"
    columns: CountColumnsFile = CountColumnsFile()
    sensors: Annotated[tuple[Sensor, ...], BeforeValidator(_sensors)] = ()
    fitted: _Period = TRAIN
    tested: _Period = TEST


class CrowdTableFile(CrowdTable):
    """``[place.crowd_source]``, where its kind is ``crowd_table``."""

    file: Annotated[values.Line, AfterValidator(partial(_found, ""))]


class TrafficFile(Traffic):
    """``[place.traffic]``."""

    lights: Annotated[tuple[Light, ...], BeforeValidator(_lights)] = ()


def _with_kind(table: object) -> object:
    return {"kind": "counters"} | table if isinstance(table, dict) else table


class VenueFile(Venue):
    """``[place]``."""

    streets: Annotated[values.Line, AfterValidator(partial(_found, "helsinki"))]
    crowd_source: Annotated[CountersFile | CrowdTableFile, Field(discriminator="kind"), BeforeValidator(_with_kind)] = (
        CountersFile()
    )
    days: Annotated[values.Days, BeforeValidator(_weekdays)] = Field(tuple(range(7)), validate_default=False)
    traffic: TrafficFile | None = None

    @field_validator("timezone")
    @classmethod
    def _helsinkis(cls, timezone: str | None, info: Any) -> str | None:
        return HELSINKI_TIMEZONE if timezone is None and info.data.get("streets") == "helsinki" else timezone


class RewardFile(RewardSpec):
    """``[reward]``; fields that it leaves out are 0, except ``unit_seconds``."""

    progress: float = 0.0
    bonus: float = 0.0


class ScenarioFile(Scenario):
    """A whole file. Fields that it leaves out are as in ``helsinki``, but without its event."""

    name: values.Remark = ""
    place: VenueFile
    horizon: Annotated[values.Positive, AfterValidator(_seconds)] = Field(180.0, alias="horizon_minutes")
    departures: Annotated[values.Range, AfterValidator(_both_seconds)] = Field((0.0, 60.0), alias="departures_minutes")
    slot_seconds: Annotated[values.Positive, AfterValidator(_seconds)] = Field(5.0, alias="slot_minutes")
    law: Law = "weidmann"
    reward: RewardFile = RewardFile()
    level: Literal["local", "map", "live"] = "map"
    maps: values.Count = 1
    walks: values.Count = 500


def find_scenario(
    name_or_file: str | Path, *, objective: str | None = None, walker: str | None = None, **changes: object
) -> Scenario:
    """A built-in scenario by its name, or one in a file, with some fields changed.

    Parameters
    ----------
    name_or_file
        A name; or a path, which ends in ``.toml``, has a separator in it, or exists.
    objective
        What walkers keep low, instead of the scenario's own, as
        :func:`sidestep.scenarios.model.read_objective` reads it.
    walker
        Who walks, instead of the scenario's own walker, as :func:`sidestep.scenarios.walkers.read_walkers` reads it.
    **changes
        Fields of the scenario, its place or its crowd source.

    Returns
    -------
    Scenario
        The scenario, checked.

    Raises
    ------
    ScenarioError
        Several walkers (field ``walker``).
    SidestepError
        Unknown names and fields, wrong values, files that hold no scenario.
    """
    name = str(name_or_file)
    in_a_file = name.endswith(".toml") or set(name) & {os.sep, os.altsep} or os.path.exists(name)  # noqa: PTH110 - Path.exists raises where a name is too long
    found = load_scenario(name) if name not in BUILT_IN and in_a_file else scenario(name)
    if objective is not None:
        changes["objective"] = read_objective(objective)
    if walker is not None:
        changes["walker"], *others = read_walkers(walker, found.walker)
        if others:
            raise ScenarioError(f"walker must be one only here, not {shown(walker)}", field="walker")
    return found.changed(**changes)


def files_of(name_or_file: str, found: Scenario) -> tuple[str, ...]:
    """The files behind a scenario, as :func:`find_scenario` found it: its own, and those that it names.

    Parameters
    ----------
    name_or_file
        How it was called.
    found
        What was found.

    Returns
    -------
    tuple[str, ...]
        None of those that come with the package.
    """
    return (*(() if name_or_file in BUILT_IN else (name_or_file,)), *found.place.files)


@checked(ScenarioError, path=PATH)
def load_scenario(path: str | Path) -> Scenario:
    r"""Read a scenario file, and make sure that its streets, counts, sensors and places exist.

    Fields that the file leaves out are as in the built-in scenario ``helsinki``, but without its event (``crowding`` is
    1, ``uneven`` 0, ``streets_per_sensor`` 1, ``reach`` 150). Files that it names are looked for from its own folder.

    Parameters
    ----------
    path
        A TOML file, as docs/scenarios.md describes it.

    Returns
    -------
    Scenario
        What the file says, with the defaults of what it leaves out.

    Raises
    ------
    ScenarioError
        One sentence that names the file and, where they are known, the line and the field; ``others`` has further
        mistakes.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from sidestep.scenarios.reader import load_scenario
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "park.toml"
    ...     _ = file.write_text('walks = 20\n[place]\nstreets = "helsinki"\nhours = [8, 18]\n')
    ...     park = load_scenario(file)
    >>> park.name, park.walks, park.place.hours
    ('park', 20, (8, 18))
    """
    path = Path(path)
    text, parsed = read_toml(path, "scenario", ScenarioError)
    folder = path.resolve().parent
    name = folder.name if folder.name and path.name == "scenario.toml" else path.stem
    try:
        read = ScenarioFile.model_validate(parsed, context={"folder": folder})
        from sidestep.scenarios.maps import mistakes  # with shapely, which wrong values need not wait for

        if not (found := mistakes(read.place, read.walker)):
            return _with_sensors(Scenario.model_validate(read.model_dump() | {"name": read.name or name}))
    except ValidationError as error:
        found = faults(error, ScenarioFile)
    refused = refusal(path, text, found, ScenarioError)
    raise refused


def _with_sensors(found: Scenario) -> Scenario:
    """Name the sensors that are meant where none are named.

    Those that are known to stand in this town stand there. Where there are none, or sensors are to stand on several
    streets, all are paired; of Auckland's, those whose cameras were not exchanged, as far as there are streets.

    Returns
    -------
    Scenario
        The same otherwise.
    """
    match found.place:
        case Venue(crowd_source=Counters(sensors=()) as source) as venue:
            from sidestep.network.snapping import Snapper
            from sidestep.scenarios.crowd_sources import counts_of, standing_sensors
            from sidestep.scenarios.streets import town_of

            town = town_of(venue.streets)
            room = max(town.streets // source.streets_per_sensor, 1)
            sensors = AUCKLAND_SENSORS[:room] if source.file == "auckland" else ()
            if source.streets_per_sensor == 1:
                sensors = standing_sensors(counts_of(source.file, venue.layout), Snapper(town)) or sensors
            return found.changed(sensors=sensors)
        case _:
            return found
