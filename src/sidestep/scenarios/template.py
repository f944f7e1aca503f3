"""A scenario file to start from: every field, with what it means and what it is by default."""

import json
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from string import Template
from tempfile import TemporaryDirectory

import numpy as np

from sidestep.crowds.counts import AUCKLAND_TIMEZONE, TEST, TRAIN, CountsError, CountTable, Period
from sidestep.crowds.layouts import RECOGNISED, SEVERAL, Layout
from sidestep.crowds.wall_time import timezone_of
from sidestep.files import OutputError, reason
from sidestep.scenarios.builtin import AUCKLAND_SENSORS, BUILT_IN, HELSINKI_TIMEZONE
from sidestep.scenarios.places import Sensor
from sidestep.scenarios.spec import ScenarioError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_WEEK, _FEWEST_FITTED, _FEWEST_TESTED = np.timedelta64(7, "D"), 4, 2  # weeks


@dataclass(frozen=True)
class Beginning:
    """The streets and the counts that a scenario begins with."""

    streets: str = "helsinki"
    """Name of a file, or "helsinki"."""
    counts: str = "auckland"
    """Name of a file, or "auckland"."""
    timezone: str | None = HELSINKI_TIMEZONE
    sensors: tuple[Sensor, ...] = AUCKLAND_SENSORS
    """Those that are paired with streets; or, at their places, those that stand in the town."""
    layout: Layout = RECOGNISED
    """What the counts do not say themselves."""
    counted: int = len(AUCKLAND_SENSORS)
    """Sensors of the counts."""
    located: bool = False
    """Whether the counts know where their sensors stand."""
    fitted: Period = TRAIN
    tested: Period = TEST

    @property
    def standing(self) -> int:
        """Number of sensors at their places; 0: they are paired."""
        return sum(sensor.place is not None for sensor in self.sensors)


def begin(streets: str, counts: str, layout: Layout = RECOGNISED) -> Beginning:
    """Look at the streets and the counts that a scenario is to begin with.

    Parameters
    ----------
    streets, counts
        Files, or what comes with the package.
    layout
        What the counts do not say themselves. Its timezone is by default Auckland's with Auckland's counts at their
        true places, Helsinki's with its streets.

    Returns
    -------
    Beginning
        With the sensors that stand in the town, where the counts know it, otherwise with all.

    Raises
    ------
    SidestepError
        Files that cannot be read, an unknown timezone, fewer than six weeks of counts, places of sensors whose latitude
        and longitude are swapped.
    """
    timezone = layout.timezone
    if counts == "auckland":
        layout.check_needed()
    if Beginning(streets, counts, timezone or HELSINKI_TIMEZONE) == Beginning():
        return Beginning()  # without a look at what comes with the package
    from sidestep.network.snapping import Snapper
    from sidestep.scenarios.crowd_sources import counts_of, standing_sensors
    from sidestep.scenarios.streets import town_of

    given = timezone or (HELSINKI_TIMEZONE if streets == "helsinki" else None)
    layout = replace(layout, timezone=given)
    if given is not None:
        timezone_of(given)  # refused where it is not known
    table, town = counts_of(counts, layout), town_of(streets)
    standing = standing_sensors(table, Snapper(town))
    every = AUCKLAND_SENSORS if counts == "auckland" else tuple(Sensor(name=name) for name in table.sensors)
    fitted, tested = (TRAIN, TEST) if counts == "auckland" else _periods(table)
    home = AUCKLAND_TIMEZONE if counts == "auckland" and standing else given
    located = table.positions is not None
    return Beginning(streets, counts, timezone or home, standing or every, layout, len(every), located, fitted, tested)


def _periods(table: CountTable) -> tuple[Period, Period]:
    """Days to fit to, and whole weeks after them to test on, about a quarter of all."""
    monday = np.datetime64("1970-01-05", "D")
    first, past = table.times[0].astype("datetime64[D]"), (table.times[-1] + 1).astype("datetime64[D]")
    first += (table.times[0] > first).astype(int)
    end = past - (past - monday) % _WEEK
    weeks = int((end - first) // _WEEK)
    begins = end - max(_FEWEST_TESTED, weeks // 4) * _WEEK
    if begins - first < _FEWEST_FITTED * _WEEK:
        needed = f"{_FEWEST_FITTED} weeks to fit to and {_FEWEST_TESTED} from Monday to Sunday to test on are needed"
        raise CountsError(f"{table.source}: {needed}; the counts run from {table.times[0]} to {table.times[-1]}")
    return (str(first), str(begins)), (str(begins), str(end))


def check_name(name: str) -> None:
    """Refuse a name that no scenario can have.

    Raises
    ------
    ScenarioError
        A name that is not allowed, or that a built-in scenario has.
    """
    if not _NAME.fullmatch(name):
        rule = "at most 64 letters, digits, - and _, and begin with a letter or digit"
        raise ScenarioError(f"a scenario's name must have {rule}, not {name!r:.80}", field="name")
    if name in BUILT_IN:
        raise ScenarioError(f"{name} is the name of a built-in scenario; choose another", field="name")


def new_scenario(folder: Path, name: str, beginning: Beginning | None = None) -> Path:
    """Make a folder with a ``scenario.toml`` in it, whole or not at all.

    Parameters
    ----------
    folder
        Where the new folder is made.
    name
        Of the new folder and the scenario.
    beginning
        Its streets and counts; by default those that come with the package.

    Returns
    -------
    file
        The scenario file.

    Raises
    ------
    ScenarioError
        A name that is not allowed, or that a built-in scenario has.
    OutputError
        A folder that exists already or cannot be made.
    """
    check_name(name)
    made = folder / name
    if os.path.lexists(made):
        raise OutputError(f"{made} exists already, and is left as it is")
    try:
        with TemporaryDirectory(dir=folder, prefix=f".{name}.") as temporary:
            file = Path(temporary, name, "scenario.toml")
            file.parent.mkdir()
            file.write_text(template(name, beginning or Beginning(), made), encoding="utf-8")
            file.parent.rename(made)
    except OSError as error:
        raise OutputError(f"cannot make the folder {made}: {reason(error)}") from error
    return made / file.name


_PAIRED_HERE = """
# WHAT IS SYNTHETIC HERE: nobody counted these people on these streets. The streets are Helsinki's, the counts are
# Auckland's, and a seed pairs them. Replace both by your own, with sensors at their true places, and nothing is."""
_PAIRED = """
# WHAT IS SYNTHETIC HERE: a seed pairs sensors with streets. Say where the sensors stand, below or in a file beside the
# counts (docs/counts.md), and nothing is."""
_STANDING = """
# Nothing is synthetic here: the sensors stand on the streets at which they were counted."""
_SENSORS = """
[place.crowd_source.sensors]
# Where the sensors stand: "name, as in the counts" = [latitude, longitude], in degrees, at most 250 m from a street.
# "paired" draws a street for a sensor: such a pairing is SYNTHETIC, and so are the crowds that follow from it.
# By default the sensors stand where the counts know that they stand, if that is in this town. Otherwise they are these
# with Auckland's counts, and all that were counted, "paired", with your own."""
_KNOWN = """
# The sensors stand where the counts know that they stand: {standing} of {counted} in this town. To say it otherwise:
# [place.crowd_source.sensors]
# "name, as in the counts" = [60.1699, 24.9384]  # latitude and longitude in degrees; or "paired" with a drawn street"""


def template(name: str, beginning: Beginning = Beginning(), folder: Path = Path()) -> str:
    """The text of a scenario file.

    Parameters
    ----------
    name
        Of the scenario.
    beginning
        Its streets and counts; by default central Helsinki with Auckland's counts.
    folder
        Where the file is to stand, from which it names its files.

    Returns
    -------
    text
        With every field, and what may be changed.
    """
    default = beginning == Beginning()
    if beginning.standing:
        synthetic, pairing = _STANDING, "at their true places"
        sensors = _KNOWN.format(standing=beginning.standing, counted=beginning.counted)
    else:
        synthetic, pairing = _PAIRED_HERE if default else _PAIRED, "a synthetic pairing"
        names = [json.dumps(sensor.name, ensure_ascii=False) for sensor in beginning.sensors]
        width = max(map(len, names))
        sensors = "\n".join([_SENSORS, *(f'{quoted:{width}} = "paired"' for quoted in names)])
    whose = {"helsinki": "central Helsinki", "auckland": "Auckland"}
    streets, counts = (whose.get(file, Path(file).name) for file in (beginning.streets, beginning.counts))
    zone = json.dumps(beginning.timezone)
    values = {
        "name": name,
        "synthetic": synthetic.strip(),
        "summary": json.dumps(f"{streets} with counts of {counts}, {pairing}", ensure_ascii=False),
        "streets": _from(beginning.streets, "helsinki", folder),
        "counts": _from(beginning.counts, "auckland", folder),
        "timezone": f'# timezone = "{HELSINKI_TIMEZONE}"  # by default not known'
        if zone == "null"
        else f"timezone = {zone}",
        "fitted": ", ".join(beginning.fitted),
        "tested": ", ".join(beginning.tested),
        "sensors": sensors.strip(),
    }
    text = Template(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")).substitute(values)
    return _with_layout(text, beginning.layout)


def _with_layout(text: str, layout: Layout) -> str:
    """Say in the text of a scenario file what counts do not say themselves, in place of the examples in comments."""
    table = "[place.crowd_source.columns]"
    said: dict[str, object] = {name: value for name in ("date_format", "decimal") if (value := getattr(layout, name))}
    said |= {name: names if name in SEVERAL else names[0] for name, names in layout.named.items()}
    for name, value in said.items():
        line = f"{name} = {json.dumps(value, ensure_ascii=False)}"
        text = re.sub(rf"(?m)^# {name} = .*$", lambda _, line=line: line, text, count=1)  # type: ignore[misc]
    return text.replace(f"# {table}", table, 1) if layout.named else text


def _from(file: str, built_in: str, folder: Path) -> str:
    """A file as a scenario file in a folder names it."""
    named = file if file == built_in else Path(os.path.relpath(file, folder)).as_posix()
    return json.dumps(named, ensure_ascii=False)
