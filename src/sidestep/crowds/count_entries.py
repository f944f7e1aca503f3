"""Counts of the rows of long and wide tables alike: of which sensor, and of which part of it, such as a direction."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from sidestep.crowds.cell_numbers import counts_in, marks_of
from sidestep.crowds.column_roles import Roles
from sidestep.crowds.layouts import Layout
from sidestep.crowds.sheets import Cells, Sheet

LARGEST_COUNT = 1e6  # persons past one sensor; more is a wrong column, an identifier or a time stamp

Rows = Int[np.ndarray, " row"]


@dataclass(frozen=True, eq=False)
class Entries:
    """Counts of all rows; a sensor may be counted in several parts, such as its directions."""

    row: Rows
    part: Rows
    value: Float[np.ndarray, " entry"]
    sensor_of: Int[np.ndarray, " part"]
    """The sensor that each part belongs to."""
    sensors: tuple[str, ...]


def read_entries(sheet: Sheet, roles: Roles, layout: Layout) -> tuple[Entries, tuple[str, ...]]:
    """Read all counts.

    Parameters
    ----------
    sheet, roles, layout
        The file, which of its columns is for what, and what is said of it.

    Returns
    -------
    entries, understood
        The counts, and how their numbers are written, in words.

    Raises
    ------
    SidestepError
        Of the sheet's type: cells that are no counts, sensors without a name.
    """
    columns = tuple(name for parts in roles.counts.values() for name in parts)
    cells = sheet.read(*columns)
    marks = marks_of(sheet, cells, layout.decimal)
    values = [counts_in(sheet, name, cells[name], marks, LARGEST_COUNT) for name in columns]
    rows = len(sheet.lines)
    if roles.sensor or "" in roles.counts:
        part, sensor_of, sensors = _parts(sheet, roles)
        several = len(sensor_of)
        parts = [part + several * number for number in range(len(columns))]
        sensor_of = np.tile(sensor_of, len(columns))
    else:
        parts = [np.full(rows, number) for number in range(len(columns))]
        sensors = tuple(roles.counts)
        sensor_of = np.repeat(np.arange(len(sensors)), [len(each) for each in roles.counts.values()])
    row = np.tile(np.arange(rows), len(columns))
    return Entries(row, np.concatenate(parts), np.concatenate(values), sensor_of, sensors), marks.understood


def _parts(sheet: Sheet, roles: Roles) -> tuple[Rows, Int[np.ndarray, " part"], tuple[str, ...]]:
    """Tell the parts of a long table apart.

    Returns
    -------
    part, sensor_of, sensors
        The part of each row, the sensor of each part, and the names of the sensors.
    """
    rows = len(sheet.lines)
    told = sheet.read(*roles.sensor, *([roles.direction] if roles.direction else []))
    for name in roles.sensor:
        empty = np.array([not text for text in told[name].texts])
        sheet.refuse_any(name, told[name], empty[told[name].code], "is no name of a sensor")
    if roles.sensor:
        number, sensors = _sensors([told[name] for name in roles.sensor])
    else:
        number, sensors = np.zeros(rows, np.int64), (Path(sheet.source).stem,)
    direction = told[roles.direction].code if roles.direction else np.zeros(rows, np.int64)
    several = int(direction.max(initial=0)) + 1
    pairs, part = np.unique(number * several + direction, return_inverse=True)
    return part, pairs // several, sensors


def _sensors(told: list[Cells]) -> tuple[Rows, tuple[str, ...]]:
    """Tell sensors apart: by their number, where they have one, so that a sensor with a new name stays the same.

    Returns
    -------
    sensor, sensors
        The sensor of each row, and the last name of each sensor; with its number, where two have one name.
    """
    *names, last = told
    if not names:
        return last.code, last.texts
    name_of = dict(zip(last.code.tolist(), names[0].code.tolist(), strict=True))
    called = [names[0].texts[name_of[number]] for number in range(len(last.texts))]
    labels = [
        f"{name} ({number})" if called.count(name) > 1 else name
        for name, number in zip(called, last.texts, strict=True)
    ]
    return last.code, tuple(labels)
