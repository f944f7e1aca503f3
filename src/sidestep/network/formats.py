"""Towns in files: .npz, GraphML and GeoJSON."""

import json
import warnings
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sidestep.files import check_unpacked, reading, whole_file, write_text
from sidestep.network.graphml import read_graphml, write_graphml
from sidestep.network.town import Town, TownError

FORMAT = 1
"""Version of our .npz files; counts up when what they hold changes."""
SUFFIXES = (".npz", ".graphml", ".geojson")
"""Endings of file names, each a format."""

_COLUMNS: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
    "place": (np.float64, (2,)), "ids": (np.int64, ()), "tail": (np.int32, ()), "head": (np.int32, ()),
    "one_way": (np.bool_, ()), "length": (np.float32, ()), "width": (np.float32, ()), "signals": (np.int16, ()),
    "crossings": (np.int16, ()), "points": (np.float64, (2,)), "first": (np.int64, ()),
}  # fmt: skip
"""Type of each array of a town, and the shape of one row."""


def check_suffix(path: Path) -> str:
    """Make sure that a file name's ending names a format.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        The ending in lower case.

    Raises
    ------
    TownError
        No format has this ending.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TownError(f"{path} names no format for streets; its name must end in {', '.join(SUFFIXES)}")
    return suffix


def save_town(town: Town, path: str | Path) -> None:
    """Write a town, whole or not at all, in the format that the ending names: .npz, .graphml or .geojson.

    The same town gives the same bytes.

    Parameters
    ----------
    town
        The streets.
    path
        The file.

    Raises
    ------
    TownError
        Another ending; crossings with the same number, which GraphML has no way to tell apart.
    OutputError
        An unwritable file.
    """
    path = Path(path)
    suffix = check_suffix(path)
    if suffix == ".geojson":
        write_text(path, json.dumps(_features(town), ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n")
        return
    with whole_file(path) as temporary, temporary.open("wb") as file:
        if suffix == ".npz":
            np.savez_compressed(file, allow_pickle=False, **_columns(town))
        else:
            write_graphml(town, file)


def load_town(path: str | Path) -> Town:
    """Read a town from our own format (.npz) or from GraphML, ours or osmnx's.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Town
        The streets.

    Raises
    ------
    TownError
        A file that is missing, unreadable, cut short or without streets; GeoJSON, which is only written.

    Examples
    --------
    >>> import sidestep, tempfile
    >>> from pathlib import Path
    >>> from sidestep.network.formats import save_town
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "helsinki.npz"
    ...     save_town(sidestep.load_helsinki(), path)
    ...     town = sidestep.load_town(path)
    >>> town.streets, town.attribution
    (1707, '© OpenStreetMap contributors, ODbL 1.0')
    """
    path = Path(path)
    suffix = check_suffix(path)
    if suffix == ".geojson":
        raise TownError(f"{path} is GeoJSON, which does not say which streets meet; load .npz or .graphml")
    # The libraries warn about types that a damaged file leaves out; either it can be read all the same, or not.
    with reading(path, TownError, "town") as file, warnings.catch_warnings(action="ignore"):
        return _read_npz(file) if suffix == ".npz" else read_graphml(file)


@lru_cache(maxsize=1)
def load_helsinki() -> Town:
    """Load central Helsinki, which is bundled; it is read once and shared.

    Returns
    -------
    Town
        The streets, made from an OpenStreetMap extract by ``scripts/make_helsinki.py``.

    References
    ----------
    © OpenStreetMap contributors, ODbL 1.0, https://www.openstreetmap.org/copyright.

    Examples
    --------
    >>> import sidestep
    >>> town = sidestep.load_helsinki()
    >>> town.nodes, town.streets, round(town.kilometres, 1)
    (946, 1707, 85.5)
    """
    with resources.as_file(resources.files("sidestep.network") / "helsinki.npz") as path:
        return load_town(path)


def _columns(town: Town) -> dict[str, np.ndarray]:
    names, name = np.unique(np.array(town.name, np.str_), return_inverse=True)
    kinds, kind = np.unique(np.array(town.kind, np.str_), return_inverse=True)
    return {
        "format": np.array(FORMAT),
        **{column: getattr(town, column) for column in _COLUMNS},
        "names": names, "name": name.astype(np.int32), "kinds": kinds, "kind": kind.astype(np.int32),
        "attribution": np.array(town.attribution),
    }  # fmt: skip


def _read_npz(file: BinaryIO) -> Town:
    check_unpacked(file, TownError)
    with np.load(file, allow_pickle=False) as columns:
        if "format" not in columns:
            raise TownError("it is not a Sidestep town", field="format")
        if columns["format"].shape or columns["format"] != FORMAT:
            raise TownError(
                f"it has town format {columns['format']!s:.20}, and this version reads {FORMAT}", field="format"
            )
        arrays: dict[str, Any] = {column: columns[column] for column in _COLUMNS}
        for column, (kind, row) in _COLUMNS.items():
            array = arrays[column]
            if array.dtype != kind or array.ndim != 1 + len(row) or array.shape[1:] != row:
                raise TownError(f"{column} is {array.dtype} of shape {array.shape}", field=column)
        words: dict[str, Any] = {
            column: _decoded(columns[f"{column}s"], columns[column], column) for column in ("name", "kind")
        }
        return Town(**arrays, **words, attribution=str(columns["attribution"]))


def _decoded(vocabulary: np.ndarray, code: np.ndarray, column: str) -> tuple[str, ...]:
    if vocabulary.dtype.kind != "U" or code.dtype.kind != "i" or vocabulary.ndim != 1 or code.ndim != 1:
        raise TownError(f"{column} is not text", field=column)
    if len(code) and (code.min() < 0 or code.max() >= len(vocabulary)):
        raise TownError(f"{column} has a number without a text", field=column)
    words = vocabulary.tolist()
    return tuple(words[number] for number in code.tolist())


def _features(town: Town) -> dict[str, object]:
    """Build GeoJSON (RFC 7946): a line a street."""
    points, first = np.round(town.points, 7).tolist(), town.first.tolist()
    columns: dict[str, Any] = {
        "tail": town.ids[town.tail].tolist(),
        "head": town.ids[town.head].tolist(),
        "one_way": town.one_way.tolist(),
        "length": [round(metres, 2) for metres in town.length.tolist()],
        "width": [round(metres, 2) for metres in town.width.tolist()],
        "kind": town.kind,
        "name": town.name,
        "signals": town.signals.tolist(),
        "crossings": town.crossings.tolist(),
    }
    features = [
        {
            "type": "Feature",
            "id": street,
            "properties": {name: column[street] for name, column in columns.items()},
            "geometry": {"type": "LineString", "coordinates": points[first[street] : first[street + 1]]},
        }
        for street in range(town.streets)
    ]
    return {"type": "FeatureCollection", "attribution": town.attribution, "features": features}
