"""Where compiled programs are kept: files in a folder of the user's, and what the name of each says."""

import hashlib
import os
import pickle
import platform
import re
import stat
import sys
import warnings
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from sidestep.files import OutputError, whole_file

FOLDER = "SIDESTEP_CACHE"
"""Environment variable that names the folder; empty for none."""
MOST_BYTES = 2**29
"""Of all files in the folder together; those unused for longest go first."""
_LIBRARIES = ("jax", "jaxlib", "equinox", "optax", "numpy")
_HARMLESS = re.compile("cache|log|traceback|explain")  # in names of flags


def file_of(told: str) -> Path | None:
    """Where a program is kept that depends on what is ``told``, and on what all depend on; None for nowhere."""
    folder = cache_folder()
    if folder is None:
        return None
    return folder / hashlib.sha256(f"{_surroundings()} {told}".encode()).hexdigest()[:40]


@cache
def _surroundings() -> str:
    """What all programs depend on: the source, the libraries, the machine, and flags."""
    source, here = hashlib.sha256(), Path(__file__).parent
    for file in sorted(here.rglob("*.py")):
        source.update(f"{file.relative_to(here)} {file.stat().st_size} ".encode() + file.read_bytes())
    device = jax.devices()[0]
    flags = {name: value for name, value in jax.config.values.items() if not _HARMLESS.search(name)}
    told = (
        sys.version,
        [version(library) for library in _LIBRARIES],
        device.device_kind,
        device.client.platform_version,
        jax.device_count(),
        _processor(),
        os.environ.get("XLA_FLAGS"),
        [os.cpu_count(), os.environ.get("PJRT_NPROC")],  # threads that work is divided among
        sorted(flags.items()),
    )
    return f"{source.hexdigest()} {told!r}"


def _processor() -> str:
    """The processor with its features: programs that use them do not run on another."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        return " ".join(dict.fromkeys(line for line in lines if line.startswith(("model name", "flags", "Features"))))
    return platform.processor()


@cache
def cache_folder() -> Path | None:
    """The folder, or None. Reading programs runs what is in them: nobody else may have put them there."""
    named = os.environ.get(FOLDER)
    if named == "":
        return None
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(named) if named else Path(home) / "sidestep" / "programs"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        said = f"{error.strerror or error}"
    else:
        ours = not hasattr(os, "getuid") or found.st_uid == os.getuid()
        if stat.S_ISDIR(found.st_mode) and ours and not found.st_mode & 0o077:
            return folder
        said = "it must be a folder of your own that nobody else may enter (mode 700)"
    warnings.warn(f"compiled programs are not kept in {folder}: {said}", stacklevel=2)
    return None


def read(file: Path) -> tuple[bytes, Any] | None:
    """Read a program, and shapes and types of what it makes; None where there is none, or a damaged one."""
    try:
        with file.open("rb") as opened:
            payload, made = pickle.load(opened)  # noqa: S301 - see cache_folder
        os.utime(file)
    except Exception:  # noqa: BLE001 - whatever a damaged file may bring about
        return None
    return payload, made


def write(file: Path, executable: Any, made: Any) -> None:
    """Keep a program; what cannot be kept is compiled again next time."""
    from jax.experimental import serialize_executable

    with suppress(OutputError, OSError, ValueError, TypeError, jax.errors.JaxRuntimeError, pickle.PicklingError):
        payload = serialize_executable.serialize(executable)[0]
        once_read: object = jax.tree.structure(pickle.loads(pickle.dumps(made)))  # noqa: S301 - our own
        if once_read != jax.tree.structure(made):
            return  # what it makes would be another type, and each call after the next would compile
        with whole_file(file) as temporary:
            temporary.write_bytes(pickle.dumps((payload, made)))
        kept = sorted(
            ((each.stat().st_mtime, each.stat().st_size, each) for each in file.parent.iterdir()), reverse=True
        )
        size = 0
        for _, bytes_of, each in kept:
            size += bytes_of
            if size > MOST_BYTES:
                each.unlink(missing_ok=True)
