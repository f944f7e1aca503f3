"""Scenarios in files: a place of one's own, said in TOML. docs/scenarios.md lists the fields."""

import difflib
import math
import os
import re
import tomllib
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass, replace
from datetime import date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sidestep.errors import SidestepError
from sidestep.files import reason
from sidestep.scenarios.builtin import BUILT_IN, changed, scenario
from sidestep.scenarios.model import DAYS, Light, Place, Scenario, ScenarioError, Sensor, Traffic, Venue
from sidestep.scenarios.objectives import only_time, read_objective
from sidestep.scenarios.toml_lines import Keys, line_of
from sidestep.walking.objective import Objective

if TYPE_CHECKING:
    from sidestep.network.town import Town

LARGEST = 1 << 16  # bytes and
MOST_LINES = 2_000  # lines of a scenario file; more is no scenario
MOST_SLOTS = 10_000  # of one walk; futures are worked out for each of them
TOWN, COUNTS = "helsinki", "auckland"  # what comes with the package
PAIRED = "paired"
_PERIODS = ("fitted", "tested")

_DEFAULTS = BUILT_IN["helsinki"]
_LINE_OF_ERROR = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


class _WrongError(Exception):
    """What a value must be, for the sentence that begins with its field."""


@dataclass(frozen=True)
class _Field:
    """A key of the file: how its value is read, and which field of a scenario or venue it is."""

    of: Literal["scenario", "venue", "traffic", "objective"]
    name: str
    read: Callable[[Any], object]


Given = dict[Keys, tuple[_Field, object]]


def find_scenario(
    name_or_file: str | Path, *, crowding: float | None = None, objective: str | None = None, **changes: object
) -> Scenario:
    """A built-in scenario by its name, or one in a file, with some fields changed.

    Parameters
    ----------
    name_or_file
        A name; or a path, which ends in ``.toml``, has a separator in it, or is there.
    crowding
        Demand over that which was counted, instead of the scenario's own; for real places only.
    objective
        What walkers keep low, instead of the scenario's own, as
        :func:`sidestep.scenarios.objectives.read_objective` reads it.

    Raises
    ------
    SidestepError
        Unknown names and fields, impossible values, files that hold no scenario.
    """
    problem = changed(_named(str(name_or_file)), **changes)
    if objective is not None:
        problem = replace(problem, objective=read_objective(objective))
    if crowding is None:
        return problem
    if problem.venue is None:
        raise ScenarioError(f"{problem.name} is no real place where something was counted, so it has no crowding")
    return replace(problem, venue=replace(problem.venue, crowding=crowding))


def _named(name: str) -> Scenario:
    if name in BUILT_IN:
        return scenario(name)
    if name.endswith(".toml") or set(name) & {os.sep, os.altsep} or _is_there(Path(name)):
        return load_scenario(name)
    return scenario(name)


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # too long a name, or a null character
        return False


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario file, and make sure that its streets, counts, sensors and places are there.

    Fields that the file leaves out are as in the built-in scenario ``helsinki``, but without an event
    (``crowding`` is 1, ``uneven`` is 0, ``places`` is 1, ``reach`` is 150). Files that it names are looked for from its
    own folder.

    Raises
    ------
    ScenarioError
        One sentence that names the file and, wherever that is known, the line and the field.
    """
    path = Path(path)
    text = _text(path)
    return _Reader(path, text, _parsed(path, text)).scenario()


def _text(path: Path) -> str:
    if _is_there(path) and path.is_dir():
        raise ScenarioError(f"{path} is a folder; name the file in it, such as {path / 'scenario.toml'}")
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        said = reason(error) if isinstance(error, OSError) else str(error)
        raise ScenarioError(f"cannot read the scenario {str(path)!r:.300}: {said}") from error
    if len(content) > LARGEST or content.count(b"\n") > MOST_LINES:
        raise ScenarioError(f"{path}: more than {LARGEST >> 10} KiB or {MOST_LINES:,} lines are no scenario")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ScenarioError(f"{path}: line {line}: not a text file (UTF-8)") from error
    if not text.strip():
        raise ScenarioError(f"{path}: the file is empty")
    return text


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ScenarioError(f"{path}: brackets are nested too deeply") from error
    except tomllib.TOMLDecodeError as error:
        said, line = str(error), text.rstrip("\n").count("\n") + 1
        if found := _LINE_OF_ERROR.search(said):
            said, line = said[: found.start()], min(int(found[1] or line), line)
        raise ScenarioError(f"{path}: line {line}: not TOML: {said[:1].lower()}{said[1:]:.200}") from error
    except ValueError as error:  # a number of thousands of digits
        raise ScenarioError(f"{path}: not TOML: {str(error)[:200]}") from error


@dataclass(frozen=True)
class _Reader:
    """One file while it is being read."""

    path: Path
    text: str
    values: dict[str, Any]

    def scenario(self) -> Scenario:
        """The scenario, checked part by part so that what is wrong is known by its line."""
        given = self._given()
        if ("network", "file") not in given:
            raise self._error(("network",), 'network.file is needed: a file of streets, or "helsinki"')
        folder = self.path.resolve().parent
        name = folder.name if self.path.name == "scenario.toml" else self.path.stem
        problem = replace(_DEFAULTS, name=name or self.path.stem, summary="")
        venue = Venue()
        # What the others mean depends on the kind of counts.
        single = [item for item in given.items() if item[1][0].of not in _WHOLE]
        for keys, (field, value) in sorted(single, key=lambda item: item[0] != ("counts", "file")):
            at = self._file(keys, folder, value) if keys[-1] == "file" else value
            changes = {field.name: at}
            if field.name in _PERIODS:  # neither must overlap the other, nor what the other is by default
                changes = {name: given["counts", name][1] for name in _PERIODS if ("counts", name) in given}
            try:
                if field.of == "venue":
                    venue = replace(venue, **changes)  # type: ignore[arg-type]
                else:
                    problem = replace(problem, **changes)  # type: ignore[arg-type]
            except ScenarioError as error:
                raise self._blamed(keys, str(error), given) from error
        problem, venue = self._with_wholes(problem, venue, given)
        slots = (problem.departures[1] + problem.horizon) / problem.slot_seconds
        if slots > MOST_SLOTS:
            long = "departures_minutes" if problem.departures[1] > problem.horizon else "horizon_minutes"
            keys = ("walking", "slot_minutes" if problem.slot_seconds < _DEFAULTS.slot_seconds else long)
            raise self._error(keys, f"{'.'.join(keys)} makes {slots:,.0f} slots; at most {MOST_SLOTS:,} will do")
        if venue.places > 1 and any(sensor.place for sensor in venue.sensors):
            raise self._error(("counts", "places"), "counts.places must be 1 where sensors have places of their own")
        if venue.counts == COUNTS and not venue.sensors and _DEFAULTS.venue:
            venue = replace(venue, sensors=_DEFAULTS.venue.sensors)
        self._check_place(venue, given)
        return replace(problem, venue=venue)

    def _with_wholes(self, problem: Scenario, venue: Venue, given: Given) -> tuple[Scenario, Venue]:
        """Tables that are taken as a whole, since what one of their fields may be depends on the others."""
        table = _WHOLE[0]
        try:
            if table in self.values:
                venue = replace(venue, traffic=Traffic(**dict(self._fields_of(table, given))))
            table = _WHOLE[1]
            if table in self.values:
                wanted = only_time(Objective(**dict(self._fields_of(table, given))))
                problem = replace(problem, objective=wanted)
        except ScenarioError as error:
            raise self._blamed((table,), str(error), given) from error
        return problem, venue

    @staticmethod
    def _fields_of(table: str, given: Given) -> Iterator[tuple[str, Any]]:
        return ((field.name, value) for field, value in given.values() if field.of == table)

    def _given(self) -> Given:
        """All fields of the file and their values, as a scenario has them."""
        given: Given = {}
        for table, inner in self.values.items():
            if table not in _FIELDS:
                self._check_name((table,), table, _FIELDS)
                if isinstance(inner, dict):
                    raise self._error((table,), f"{table} must be a value, not a table")
                given[table,] = self._value((table,), _TOP[table], inner)
                continue
            if not isinstance(inner, dict):
                raise self._error((table,), f"{table} must be a table, [{table}], not {_said(inner)}")
            if table == "sensors":
                given[table,] = (_SENSORS, tuple(self._sensor(name, at) for name, at in inner.items()))
                continue
            for key, value in inner.items():
                self._check_name((table, key), key, _FIELDS[table])
                given[table, key] = self._value((table, key), _FIELDS[table][key], value)
        return given

    def _check_name(self, keys: Keys, name: str, known: dict[str, Any]) -> None:
        top = len(keys) == 1
        known = {**known, **_TOP} if top else known
        if name in known:
            return
        close = difflib.get_close_matches(name.lower(), known, n=1)
        hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}"
        what = "table or field" if top else "field"
        where = "" if top else f" in [{keys[0]}]"
        raise self._error(keys, f"unknown {what} {name!r:.60}{where}; {hint}")

    def _value(self, keys: Keys, field: _Field, value: object) -> tuple[_Field, object]:
        try:
            return field, field.read(value)
        except _WrongError as error:
            raise self._error(keys, f"{'.'.join(keys)} {error}") from error

    def _sensor(self, name: str, value: object) -> Sensor:
        keys = ("sensors", name)
        try:
            return Sensor(name, None if value == PAIRED else _degrees(value))
        except _WrongError as error:
            more = "; a name with a dot in it needs quotes" if isinstance(value, dict) else ""
            said = f'must be [latitude, longitude] or "{PAIRED}", not {_said(value)}{more}'
            raise self._error(keys, f"sensor {name!r:.60} {said}") from error

    def _file(self, keys: Keys, folder: Path, value: object) -> str:
        """What comes with the package, or a file that is there, by its whole path."""
        built_in = TOWN if keys[0] == "network" else COUNTS
        if value == built_in:
            return built_in
        file = folder / str(value)
        if not _is_there(file):
            raise self._error(keys, f'{".".join(keys)}: there is no file {file} (nor is it "{built_in}")')
        if file.is_dir():
            raise self._error(keys, f"{'.'.join(keys)}: {file} is a folder, not a file")
        return str(file.resolve())

    def _check_place(self, venue: Venue, given: Container[Keys]) -> None:
        """Read the files that are named, and look for the sensors and places in them."""
        from sidestep.scenarios.build import check_ways, crossings, table_of, town_of, waits_of

        town = self._at(("network", "file"), town_of, venue.streets)
        if venue.tabled:
            self._at(("counts", "file"), table_of, venue, town)
        else:
            self._check_counts(venue, town, given)
        self._at(("traffic", "lights"), waits_of, town, venue)
        origins, ends = (
            self._at(("walks", name), crossings, town, name, getattr(venue, name))
            for name in ("origins", "destinations")
        )
        self._at(("walks", "destinations"), check_ways, town.network(), origins, ends)

    def _check_counts(self, venue: Venue, town: "Town", given: Container[Keys]) -> None:
        from sidestep.network.snapping import Snapper
        from sidestep.scenarios.build import counts_of, nearest_street

        table = self._at(("counts", "file"), counts_of, venue.counts)
        for period in _PERIODS:
            defaulted = venue.counts != COUNTS and ("counts", period) not in given
            more = f"; give counts.{period}, since the default days are Auckland's" if defaulted else ""
            self._at(("counts", period), table.between, *getattr(venue, period), more=more)
        snap = Snapper(town)
        for sensor in venue.sensors:
            self._at(("sensors", sensor.name), table.series, sensor.name)
            self._at(("sensors", sensor.name), nearest_street, snap, sensor)

    def _at(self, keys: Keys, ask: Callable[..., Any], *about: object, more: str = "") -> Any:
        """The answer; or, where it is refused, the refusal with the line that it comes of."""
        try:
            return ask(*about)
        except SidestepError as error:
            raise self._blamed(keys, f"{error}{more}") from error

    def _blamed(self, keys: Keys, said: str, given: Container[Keys] = ()) -> ScenarioError:
        """An error of another module, which may name the field in its own words first.

        Where that is another one of those that were ``given`` in the same table, it is the one to blame.
        """
        named = (keys[0], said.partition(" ")[0])
        keys = named if named in given else keys
        field = ".".join(keys)
        return self._error(keys, field + (said.removeprefix(keys[-1]) if said.startswith(keys[-1]) else f": {said}"))

    def _error(self, keys: Keys, said: str) -> ScenarioError:
        return ScenarioError(f"{self.path}: line {line_of(self.text, keys)}: {' '.join(said.split())}")


def _said(value: object) -> str:
    """A value in a message: what it is, or, where that is long, of which kind."""
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value) if isinstance(value, str | float) else str(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def _words(value: object) -> str:
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise _WrongError(f"must be a line of text in quotes, not {_said(value)}")
    return value


def _remark(value: object) -> str:
    return "" if value == "" else _words(value)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _WrongError(f"must be a number, not {_said(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise _WrongError(f"must be a smaller number, not {_said(value)}") from error


def _whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise _WrongError(f"must be a whole number, not {_said(value)}")
    return value


def _count(value: object) -> int:
    if not 1 <= _whole(value) <= 10**6:
        raise _WrongError(f"must be between 1 and 1,000,000, not {_said(value)}")
    return _whole(value)


def _few(value: object) -> int:
    if not 1 <= _whole(value) <= 100:
        raise _WrongError(f"must be between 1 and 100, not {_said(value)}")
    return _whole(value)


def _seed(value: object) -> int:
    if not 0 <= _whole(value) < 2**63:
        raise _WrongError(f"must be a seed of 0 or more, not {_said(value)}")
    return _whole(value)


def _minutes(value: object) -> float:
    """Seconds."""
    if not 0 < _number(value) < math.inf:
        raise _WrongError(f"must be a positive number of minutes, not {_said(value)}")
    return 60 * _number(value)


def _two(value: object, what: str) -> list[Any]:
    if not isinstance(value, list) or len(value) != 2:
        raise _WrongError(f"must be two {what} in brackets, not {_said(value)}")
    return value


def _departures(value: object) -> tuple[float, float]:
    """Seconds."""
    first, last = (_number(minutes) for minutes in _two(value, "numbers of minutes"))
    if not 0 <= first <= last < math.inf:
        raise _WrongError(f"must be two numbers of minutes in order, from 0 on, not {first:g} and {last:g}")
    return 60 * first, 60 * last


def _hours(value: object) -> tuple[int, int]:
    first, last = (_whole(hour) for hour in _two(value, "hours"))
    return first, last


def _noise(value: object) -> tuple[float, float]:
    memory, deviation = (_number(part) for part in _two(value, "numbers"))
    return memory, deviation


def _choice(*allowed: str) -> Callable[[Any], str]:
    def read(value: object) -> str:
        if value not in allowed:
            raise _WrongError(f"must be one of {', '.join(allowed)}, not {_said(value)}")
        return str(value)

    return read


def _period(value: object) -> tuple[str, str]:
    first, last = (_day(day) for day in _two(value, "days"))
    if not first < last:
        raise _WrongError(f"must be the first day and the one past the last, in order, not {first} and {last}")
    return first, last


def _day(value: object) -> str:
    """A day, or an hour of it, as the counts know them."""
    try:
        time = datetime.fromisoformat(value) if isinstance(value, str) else value
    except ValueError as error:
        raise _WrongError(f"must be days such as 2025-03-10, not {_said(value)}") from error
    if isinstance(time, datetime):
        if time.tzinfo is not None or (time.minute, time.second, time.microsecond) != (0, 0, 0):
            raise _WrongError(f"must be days or hours of local wall time without an offset, not {_said(value)}")
        return time.isoformat(timespec="hours") if time.hour else time.date().isoformat()
    if isinstance(time, date):
        return time.isoformat()
    raise _WrongError(f"must be days such as 2025-03-10, not {_said(value)}")


def _days(value: object) -> tuple[int, ...]:
    """Numbers of weekdays, 0 is Monday, from a list of names or from a span such as Fri-Mon."""
    if isinstance(value, str) and value.count("-") == 1:
        first, last = (_weekday(name) for name in value.split("-"))
        return tuple(sorted((first + step) % 7 for step in range((last - first) % 7 + 1)))
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not names:
        raise _WrongError(f'must be a list of weekdays, or a span such as "Mon-Fri", not {_said(value)}')
    found = [_weekday(name) for name in names]
    if len(set(found)) < len(found):
        raise _WrongError(f"must all be different, but {DAYS[max(found, key=found.count)]} is there twice")
    return tuple(sorted(found))


def _weekday(value: object) -> int:
    for number, day in enumerate(DAYS):
        if isinstance(value, str) and value.strip().lower() in (day.lower(), day[:3].lower()):
            return number
    raise _WrongError(f"must be weekdays, {', '.join(day[:3] for day in DAYS)}, not {_said(value)}")


def _degrees(value: object) -> tuple[float, float]:
    latitude, longitude = (_number(degrees) for degrees in _two(value, "numbers of degrees"))
    return latitude, longitude


def _places(value: object) -> tuple[Place, ...]:
    if not isinstance(value, list):
        raise _WrongError(f"must be a list of crossings, not {_said(value)}")
    return tuple(_place(place) for place in value)


def _place(value: object) -> Place:
    if isinstance(value, list) and len(value) == 2:
        return _degrees(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise _WrongError(f"must be numbers of crossings or [latitude, longitude], not {_said(value)}")
    return value


def _lights(value: object) -> tuple[Light, ...]:
    if not isinstance(value, dict):
        raise _WrongError(f"must be a table, [traffic.lights], not {_said(value)}")
    return tuple(_light(name, timing) for name, timing in value.items())


def _light(name: str, value: object) -> Light:
    if not isinstance(value, dict) or set(value) != {"at", "cycle", "green", "offset"}:
        raise _WrongError(f"{name!r:.60} must be {{ at = […, …], cycle = …, green = …, offset = … }}")
    try:
        timing = (_number(value[key]) for key in ("cycle", "green", "offset"))
        return Light(name, _degrees(value["at"]), *timing)
    except (_WrongError, ScenarioError) as error:
        raise _WrongError(f"{name!r:.60}: {error}") from error


_SENSORS = _Field("venue", "sensors", tuple)
_TOP: dict[str, _Field] = {
    "name": _Field("scenario", "name", _words),
    "summary": _Field("scenario", "summary", _remark),
}
_WHOLE = ("traffic", "objective")
_FIELDS: dict[str, dict[str, _Field]] = {
    "network": {"file": _Field("venue", "streets", _words)},
    "counts": {
        "file": _Field("venue", "counts", _words),
        "fitted": _Field("venue", "fitted", _period),
        "tested": _Field("venue", "tested", _period),
        "pairing": _Field("venue", "pairing", _seed),
        "places": _Field("venue", "places", _few),
    },
    "sensors": {},
    "demand": {
        "crowding": _Field("venue", "crowding", _number),
        "uneven": _Field("venue", "uneven", _number),
        "reach": _Field("venue", "reach", _number),
        "noise": _Field("venue", "noise", _noise),
        "days": _Field("venue", "days", _days),
        "hours": _Field("venue", "hours", _hours),
    },
    "walking": {
        "law": _Field("scenario", "law", _choice("power-capped", "weidmann")),
        "rule": _Field("scenario", "rule", _choice("integrated", "entry")),
        "horizon_minutes": _Field("scenario", "horizon", _minutes),
        "departures_minutes": _Field("scenario", "departures", _departures),
        "slot_minutes": _Field("scenario", "slot_seconds", _minutes),
    },
    "walks": {
        "origins": _Field("venue", "origins", _places),
        "destinations": _Field("venue", "destinations", _places),
        "count": _Field("scenario", "walks", _count),
    },
    "traffic": {
        "cycle": _Field("traffic", "cycle", _number),
        "green": _Field("traffic", "green", _number),
        "seed": _Field("traffic", "seed", _seed),
        "vehicles": _Field("traffic", "vehicles", _number),
        "critical_gap": _Field("traffic", "critical_gap", _number),
        "lights": _Field("traffic", "lights", _lights),
    },
    "objective": {
        "time": _Field("objective", "time", _number),
        "distance": _Field("objective", "distance", _number),
        "exposure": _Field("objective", "exposure", _number),
        "max_density": _Field("objective", "max_density", _number),
    },
    "agent": {"level": _Field("scenario", "level", _choice("local", "map", "live"))},
}
