"""Where the sensors of a file of counts are, and counts as a file that explains itself."""

import csv
from pathlib import Path
from reprlib import repr as quoted
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from sidestep.crowds.column_names import LATITUDES, LONGITUDES, SENSORS, plain
from sidestep.crowds.column_roles import Roles, place_in, roles_of
from sidestep.crowds.layouts import RECOGNISED
from sidestep.crowds.sheets import Cells, Sheet, open_sheet
from sidestep.errors import SidestepError
from sidestep.files import OutputError, check_apart, whole_file

if TYPE_CHECKING:
    from sidestep.crowds.counts import CountTable

SUFFIX, POSITIONS = ".csv", ".positions.csv"
SAME_PLACE = 0.001
"""Degrees within which a sensor stands in one place, about 100 m."""


def positions_path(path: Path) -> Path:
    """The file beside a file of counts that has the positions of its sensors: NAME.positions.csv beside NAME.csv."""
    return path.with_name(f"{path.stem}{POSITIONS}")


def positions_beside(
    path: Path, sensors: tuple[str, ...], error: type[SidestepError]
) -> Float[np.ndarray, "sensor 2"] | None:
    """Read where the sensors of a file of counts are.

    Parameters
    ----------
    path
        The file of counts.
    sensors
        Their names, which the file of positions must have; it may have others.
    error
        Type of the errors.

    Returns
    -------
    positions
        Latitude and longitude in degrees; None where there is no file of positions.

    Raises
    ------
    SidestepError
        Of type ``error``: a file that is not readable, lacks a column or a sensor, or has degrees that are none.
    """
    beside = positions_path(path)
    if not path.stem or not beside.is_file():
        return None
    known = frozenset(SENSORS) | LATITUDES | LONGITUDES
    sheet = open_sheet(beside, error, lambda name: plain(name) in known)
    found = [
        next((name for name in sheet.names if plain(name) in names), None) for names in (SENSORS, LATITUDES, LONGITUDES)
    ]
    name, *degrees = found
    if name is None or None in degrees:
        raise error(f"{beside}: needs the columns sensor, latitude and longitude", field="sensor")
    columns = [str(each) for each in degrees]
    cells, every = sheet.read(name, *columns), np.ones(len(sheet.lines), bool)
    names = cells[name].values(str, object).tolist()
    latitude, longitude = (_degrees(sheet, each, cells[each], axis, every) for axis, each in enumerate(columns))
    place = dict(zip(names, np.stack([latitude, longitude], axis=1), strict=True))
    for sensor in sensors:
        if sensor not in place:
            raise error(f"{beside}: the sensor {quoted(sensor)} of {path.name} is missing", field=sensor)
    return np.array([place[sensor] for sensor in sensors])


def positions_within(
    sheet: Sheet, place: tuple[str, ...], sensor: Int[np.ndarray, " row"], sensors: tuple[str, ...]
) -> Float[np.ndarray, "sensor 2"] | None:
    """Read where sensors are from columns of the counts themselves.

    Parameters
    ----------
    sheet
        The file of counts.
    place
        Columns of latitudes and longitudes, or the one that has both; none: positions are not known.
    sensor, sensors
        The sensor of each row, and the names of all.

    Returns
    -------
    positions
        Latitude and longitude in degrees; None where no row has them.

    Raises
    ------
    SidestepError
        Of the sheet's type: degrees that are none, a sensor without a place beside others with one, and a sensor in two
        places.
    """
    if not place:
        return None
    columns, cells = (place[0], place[-1]), sheet.read(*place)
    filled = np.logical_and.reduce([each.values(bool, np.bool_) for each in cells.values()])
    if not filled.any():
        return None
    there = [_degrees(sheet, name, cells[name], axis, filled) for axis, name in enumerate(columns)]
    found = np.stack(there, axis=1)
    hint = f"leave its place out by --columns ignore={'+'.join(place)}, and name places in a file beside the counts"
    positions = np.full((len(sensors), 2), np.nan)
    positions[sensor[filled]] = found[filled]
    if np.isnan(positions).any():
        name = sensors[int(np.argmax(np.isnan(positions[:, 0])))]
        raise sheet.error(f"{sheet.source}: the sensor {quoted(name)} has no place; {hint}", field=place[0])
    moved = filled & (np.abs(found - positions[sensor]) > SAME_PLACE).any(axis=1)
    if moved.any():
        row = int(np.argmax(moved))
        raise sheet.refuse(row, place[0], f"the sensor {quoted(sensors[sensor[row]])} stands in two places; {hint}")
    return positions


def _degrees(
    sheet: Sheet, column: str, cells: Cells, axis: int, filled: Bool[np.ndarray, " row"]
) -> Float[np.ndarray, " row"]:
    """Degrees of latitude (axis 0) or longitude (axis 1) in a column, in rows that are filled; of a pair its part."""
    most = (90.0, 180.0)[axis]

    def number(text: str) -> float:
        both = place_in(text)
        try:
            if both is not None:
                return float(both[axis])
            return float(text if sheet.delimiter == "," else text.replace(",", "."))
        except ValueError:
            return np.nan

    values = cells.values(number, np.float64)
    wrong = filled & ~(np.abs(values) <= most)
    hint = "; latitude and longitude may be swapped" if axis == 0 else ""
    sheet.refuse_any(column, cells, wrong, f"is not between -{most:g} and {most:g} degrees{hint}")
    return values


def save_counts(table: "CountTable", path: Path) -> None:
    """Write counts as CSV: ``time``, then a column for each sensor; an empty cell is a missing count.

    Where names of sensors would be taken for something else, such as directions, there is a row for each sensor and
    hour instead. Where positions are known, they are written beside it. :func:`sidestep.crowds.counts.read_counts`
    reads all of this as it was.

    Parameters
    ----------
    table
        The counts.
    path
        The file, which ends in .csv.

    Raises
    ------
    OutputError
        Another ending, or that of positions; a place that cannot be written to; a file of positions beside it, if these
        counts have none.
    """
    check_suffix(path)
    beside = positions_path(path)
    if table.positions is None and beside.exists():
        said = f"{beside} would be read as the positions of these sensors, which are not known"
        raise OutputError(f"{said}; remove it, or give the counts another name", field="out")
    with whole_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        rows = zip(np.datetime_as_string(table.times, "m"), table.counts.tolist(), strict=True)
        texts = ((time, ["" if count != count else f"{count:.15g}" for count in counts]) for time, counts in rows)  # noqa: PLR0124 - NaN
        if _are_columns(table.sensors):
            writer.writerow(["time", *table.sensors])
            writer.writerows([time, *counts] for time, counts in texts)
        else:
            writer.writerow(["time", "sensor", "count"])
            writer.writerows(
                (time, *each) for time, counts in texts for each in zip(table.sensors, counts, strict=True)
            )
    if table.positions is not None:
        with whole_file(beside) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["sensor", "latitude", "longitude"])
            writer.writerows(
                [name, *place] for name, place in zip(table.sensors, table.positions.tolist(), strict=True)
            )


def _are_columns(sensors: tuple[str, ...]) -> bool:
    """Whether a reader takes columns of these names for sensors, each for one of its own."""
    names = ("time", *sensors)
    if len(set(names)) < len(names) or any(name != " ".join(name.split()) for name in sensors):
        return False
    first = {"time": "2024-01-01T00:00", **dict.fromkeys(sensors, "1")}
    sheet = Sheet("", names, ",", 0, 0, np.zeros(0, np.int64), "", len(names), first, OutputError)
    try:
        return roles_of(sheet, RECOGNISED) == Roles(("time",), (), {name: (name,) for name in sensors})
    except OutputError:
        return False


def check_out(path: Path, read: Path | None) -> None:
    """Refuse to write counts over those that are read, or over the positions of their sensors.

    Parameters
    ----------
    path
        The file for the counts; positions may be written beside it.
    read
        The file that is read; None for the counts that come with the package.

    Raises
    ------
    OutputError
        Such a file, or a name that no counts may have (field ``out``).
    """
    check_suffix(path)
    if read is not None:
        for out in (path, positions_path(path)):
            check_apart(out, (read, positions_path(read)))


def check_suffix(path: Path) -> None:
    """Refuse a name for counts that does not end in .csv, or is one for positions."""
    if path.name.lower().endswith(POSITIONS):
        raise OutputError(f"{path}: names that end in {POSITIONS} are for positions; give counts another", field="out")
    if path.suffix.lower() != SUFFIX:
        raise OutputError(f"{path}: give counts a name that ends in {SUFFIX}", field="out")
