"""What a scenario file may say: the specs of :mod:`sidestep.scenarios.model` in the forms that people write.

A file has the names of the specs. It differs in values: minutes for seconds, names of weekdays, dates, tables of
sensors and lights by name, lists for tuples, and files looked for from the folder of the scenario.
"""

from collections.abc import ItemsView
from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, field_validator

from sidestep.crowds.counts import TEST, TRAIN
from sidestep.scenarios import values
from sidestep.scenarios.builtin import AUCKLAND_SENSORS, NO_EXTRAS
from sidestep.scenarios.model import RewardSpec, Scenario
from sidestep.scenarios.places import Counters, CrowdTable, Light, Sensor, Traffic, Venue
from sidestep.scenarios.spec import shown
from sidestep.scenarios.values import DAYS
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


class CountersFile(Counters):
    """``[place.crowd_source]``, where its kind is ``counters``."""

    file: Annotated[values.Line, AfterValidator(partial(_found, "auckland"))] = "auckland"
    sensors: Annotated[tuple[Sensor, ...], BeforeValidator(_sensors)] = ()
    fitted: _Period = TRAIN
    tested: _Period = TEST

    @field_validator("sensors")
    @classmethod
    def _aucklands(cls, sensors: tuple[Sensor, ...], info: Any) -> tuple[Sensor, ...]:
        return sensors or (AUCKLAND_SENSORS if info.data.get("file") == "auckland" else ())


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


class ScenarioFile(Scenario):
    """A whole file. Fields that it leaves out are as in ``helsinki``, but without its event."""

    name: values.Remark = ""
    place: VenueFile
    horizon: Annotated[values.Positive, AfterValidator(_seconds)] = Field(180.0, alias="horizon_minutes")
    departures: Annotated[values.Range, AfterValidator(_both_seconds)] = Field((0.0, 60.0), alias="departures_minutes")
    slot_seconds: Annotated[values.Positive, AfterValidator(_seconds)] = Field(5.0, alias="slot_minutes")
    law: Law = "weidmann"
    reward: RewardSpec = NO_EXTRAS
    level: Literal["local", "map", "live"] = "map"
    maps: values.Count = 1
    walks: values.Count = 500
