"""Tables of counts that take long to read and repair are kept in the user's cache as they were repaired."""

import hashlib
import json
import os
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import astuple
from pathlib import Path

import numpy as np

from sidestep.crowds.counts import CountTable
from sidestep.crowds.repairs import Repair
from sidestep.files import OutputError, whole_file
from sidestep.kept_programs import cache_folder


def kept_table(read: Callable[[], CountTable], *depends: str) -> CountTable:
    """Read a table, or what was kept of it when it was read before.

    Parameters
    ----------
    read
        Reads and repairs it.
    *depends
        What it depends on beside the source of this package, such as the version of the data.

    Returns
    -------
    CountTable
        The same to the bit.
    """
    if (folder := cache_folder()) is None:
        return read()
    digest = hashlib.sha256(repr(depends).encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    file = folder / f"{digest.hexdigest()[:40]}.npz"
    with suppress(
        OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile
    ):  # none is there, or a damaged one
        return _load(file)
    table = read()
    with suppress(OSError, OutputError):
        _save(file, table)
    return table


def _save(file: Path, table: CountTable) -> None:
    said = json.dumps([table.sensors, list(map(astuple, table.repairs)), table.source, table.understood])
    placed = {} if table.positions is None else {"positions": table.positions}
    with whole_file(file) as temporary, temporary.open("wb") as opened:
        np.savez(opened, times=table.times, counts=table.counts, said=np.array(said), **placed)  # type: ignore[arg-type]


def _load(file: Path) -> CountTable:
    os.utime(file)  # those unused for longest are deleted first
    with file.open("rb") as opened, np.load(opened, allow_pickle=False) as kept:
        sensors, repairs, source, understood = json.loads(str(kept["said"]))
        return CountTable(
            kept["times"],
            tuple(sensors),
            kept["counts"],
            kept.get("positions"),
            tuple(Repair(*repair) for repair in repairs),
            source,
            tuple(understood),
        )
