"""Towns in files: .npz, GraphML and GeoJSON."""

import json
import math
import warnings
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sidestep.arguments import PATH, checked, instance
from sidestep.files import check_unpacked, reading, whole_file
from sidestep.network.geodesy import line_geometry
from sidestep.network.graphml import read_graphml, write_graphml
from sidestep.network.town import ARRAYS, USUAL, WORDS, Town, TownError

FORMAT = 2
"""Version of our .npz files; counts up when what they hold changes. Version 1 lacks what ``USUAL`` has."""


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
    if suffix not in _WRITERS:
        raise TownError(f"{path} names no format for streets; its name must end in {', '.join(_WRITERS)}")
    return suffix


@checked(TownError, town=instance(Town, "a town, such as sidestep.load_helsinki()"), path=PATH)
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
    write = _WRITERS[check_suffix(path)]
    with whole_file(path) as temporary, temporary.open("wb") as file:
        write(town, file)


@checked(TownError, path=PATH)
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
    (2519, '© OpenStreetMap contributors, ODbL 1.0')
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
    (1284, 2519, 110.2)
    """
    with resources.as_file(resources.files("sidestep.network") / "helsinki.npz") as path:
        return load_town(path)


def _write_npz(town: Town, file: BinaryIO) -> None:
    columns = {"format": np.array(FORMAT), **{name: getattr(town, name) for name in ARRAYS}}
    for name in WORDS:  # stored as numbers into a vocabulary
        words, code = np.unique(np.array(getattr(town, name), np.str_), return_inverse=True)
        columns |= {f"{name}s": words, name: code.astype(np.int32)}
    np.savez_compressed(file, allow_pickle=False, **columns, attribution=np.array(town.attribution))


def _read_npz(file: BinaryIO) -> Town:
    check_unpacked(file, TownError)
    with np.load(file, allow_pickle=False) as columns:
        if "format" not in columns:
            raise TownError("it is not a Sidestep town", field="format")
        if columns["format"].shape or columns["format"] not in (1, FORMAT):
            raise TownError(
                f"it has town format {columns['format']!s:.20}, and this version reads 1 to {FORMAT}", field="format"
            )
        older = USUAL if columns["format"] == 1 else {}
        streets = len(columns["tail"])
        found: dict[str, Any] = {name: (value,) * streets for name, value in older.items()}
        for name, (kind, row) in ARRAYS.items():
            array = np.array(found[name], kind) if name in found else columns[name]
            found[name] = array
            if array.dtype != kind or array.ndim != 1 + len(row) or array.shape[1:] != row:
                raise TownError(f"{name} is {array.dtype} of shape {array.shape}", field=name)
        texts = [name for name in WORDS if name not in older]
        found |= {name: _decoded(columns[f"{name}s"], columns[name], name) for name in texts}
        return Town(**found, attribution=str(columns["attribution"]))


def _decoded(vocabulary: np.ndarray, code: np.ndarray, column: str) -> tuple[str, ...]:
    if vocabulary.dtype.kind != "U" or code.dtype.kind != "i" or vocabulary.ndim != 1 or code.ndim != 1:
        raise TownError(f"{column} is not text", field=column)
    if len(code) and (code.min() < 0 or code.max() >= len(vocabulary)):
        raise TownError(f"{column} has a number without a text", field=column)
    words = vocabulary.tolist()
    return tuple(words[number] for number in code.tolist())


def _write_geojson(town: Town, file: BinaryIO) -> None:
    text = json.dumps(_features(town), ensure_ascii=False, separators=(",", ":"), allow_nan=False) + "\n"
    file.write(text.encode())


def _features(town: Town) -> dict[str, object]:
    """Build GeoJSON (RFC 7946): a line a street, in two parts where it crosses the antimeridian."""
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
        "opening": town.opening,
        "restricted": town.restricted.tolist(),
        "incline": [None if math.isnan(rise) else round(rise, 4) for rise in town.incline.tolist()],
        "kerb": [round(metres, 3) for metres in town.kerb.tolist()],
    }
    features = [
        {
            "type": "Feature",
            "id": street,
            "properties": dict(zip(columns, row, strict=True)),
            "geometry": line_geometry(points[first[street] : first[street + 1]]),
        }
        for street, row in enumerate(zip(*columns.values(), strict=True))
    ]
    return {"type": "FeatureCollection", "attribution": town.attribution, "features": features}


_WRITERS = {".npz": _write_npz, ".graphml": write_graphml, ".geojson": _write_geojson}
"""What writes the format that each ending of a file name stands for."""
