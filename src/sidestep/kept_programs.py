"""Where compiled programs are kept: files in a folder of the user's, and what the name of each says."""

import hashlib
import os
import pickle
import platform
import re
import sys
import warnings
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax

from sidestep.files import OutputError, own_cache, private_folder, whole_file

FOLDER = "SIDESTEP_CACHE"
"""Environment variable that names the folder; empty for none."""
MOST_BYTES = 2**29
"""Of all files in the folder together; those unused for longest go first."""
_LIBRARIES = ("jax", "jaxlib", "equinox", "optax", "numpy")
_OURS = re.compile(r"[0-9a-f]{40}(\.npz)?")  # names of files
_HARMLESS = re.compile("cache|log|traceback|explain")  # in names of flags


def file_of(told: str) -> Path | None:
    """Where a program is kept that depends on what is ``told``, and on what all depend on; None for nowhere."""
    folder = cache_folder()
    if folder is None:
        return None
    return folder / hashlib.sha256(f"{_surroundings()} {told}".encode()).hexdigest()[:40]


_hits = [0]


def hits() -> int:
    """How often JAX has found what was to be compiled in its own cache."""
    return _hits[0]


def _listen(event: str, **_: Any) -> None:
    _hits[0] += event == "/jax/compilation_cache/cache_hits"


jax.monitoring.register_event_listener(_listen)


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
    try:
        folder = Path(named) if named else own_cache("programs")
        return private_folder(folder)
    except OutputError as error:
        warnings.warn(f"compiled programs are not kept: {error}", stacklevel=2)
        return None


def read(file: Path) -> tuple[bytes, Any] | None:
    """Read a program, and shapes and types of what it makes; None where there is none, or a damaged one."""
    try:
        with file.open("rb") as opened:
            if hasattr(os, "getuid") and os.fstat(opened.fileno()).st_uid != os.getuid():
                return None  # somebody put it there before the folder was closed to others
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
        ours = (each for each in file.parent.iterdir() if _OURS.fullmatch(each.name))
        kept = sorted(((each.stat().st_mtime, each.stat().st_size, each) for each in ours), reverse=True)
        size = 0
        for _, bytes_of, each in kept:
            size += bytes_of
            if size > MOST_BYTES:
                each.unlink(missing_ok=True)
