"""Writing results, whole or not at all, and reading files that may be damaged."""

import os
import re
import stat
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache, wraps
from io import FileIO
from pathlib import Path
from time import sleep
from typing import BinaryIO, ParamSpec, TypeVar

from sidestep.errors import SidestepError

if sys.platform != "win32":
    import fcntl

P = ParamSpec("P")
Made = TypeVar("Made")
LARGEST = 2**31  # bytes that one file may unpack to; a town of a million streets takes a tenth of it
_PATIENCE = 0.5  # s; who looks whether a file is held holds it for a moment
# Raised by readers of damaged files: SyntaxError by the XML reader, RuntimeError by osmium.
DAMAGED = (zipfile.BadZipFile, zlib.error, SyntaxError, EOFError, LookupError, TypeError, ValueError, RuntimeError)


class OutputError(SidestepError):
    """A place that cannot be written to."""


def check_above(folder: Path, field: str = "out") -> None:
    """Refuse a folder to write to that lies in folders that are not there: a misspelled one is not made.

    Parameters
    ----------
    folder, field
        The folder, which may be missing itself, and the parameter that it is of.

    Raises
    ------
    OutputError
        With the parameter as its field.
    """
    for above in reversed(folder.parents):
        if not os.path.lexists(above):
            raise OutputError(f"cannot write to {folder}: there is no folder {above}; make it first", field=field)


def output_folder(path: Path, field: str = "out") -> Path:
    """Make sure, before long work begins, that a folder takes files; it is made if only it is missing.

    Parameters
    ----------
    path, field
        The folder, and the parameter that it is of.

    Returns
    -------
    Path
        The same folder.

    Raises
    ------
    OutputError
        With the parameter as its field.
    """
    check_above(path, field)
    try:
        path.mkdir(exist_ok=True)
        probe = path / f".writable-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write to the output folder {path}: {reason(error)}", field=field) from error
    return path


def own_cache(name: str) -> Path:
    """The folder in which something is kept for this user; an :class:`OutputError` where the user has no home."""
    try:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError as error:
        raise OutputError(f"cannot keep {name}: there is no home folder; set XDG_CACHE_HOME") from error
    return Path(home) / "sidestep" / name


def own_data(name: str) -> Path:
    """The folder in which something is kept for this user that must not get lost."""
    try:
        home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    except RuntimeError as error:
        raise OutputError(f"cannot keep {name}: there is no home folder; set XDG_DATA_HOME", field="store") from error
    return Path(home) / "sidestep" / name


def private_folder(path: Path) -> Path:
    """Make sure that a folder is its user's, and that nobody else can write to it; it is made if it is missing.

    Parameters
    ----------
    path
        The folder; no link to one.

    Returns
    -------
    Path
        The same folder.

    Raises
    ------
    OutputError
        It cannot be made, is somebody else's, or others may write to it.
    """
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = path.lstat()
    except OSError as error:
        raise OutputError(f"cannot make the folder {path}: {reason(error)}") from error
    ours = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    if not (stat.S_ISDIR(found.st_mode) and ours and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
        raise OutputError(f"{path} must be a folder of your own, no link, that nobody else may write to; remove it")
    return path


def check_apart(out: Path, read: Iterable[str | Path | None], option: str = "out") -> None:
    """Refuse to write to a file that is read, whatever name it goes by.

    Parameters
    ----------
    out
        The file to write to.
    read
        Files that are read, and folders of such; None and names of files that do not exist count for nothing.
    option
        What names the file to write to.

    Raises
    ------
    OutputError
        One of them, also as a link; the field is the option.
    """
    for each in (Path(name) for name in read if name is not None):
        for file in each.iterdir() if each.is_dir() else (each,):
            if _same(out, file):
                raise OutputError(
                    f"--{option.replace('_', '-')} must be another file than {file}, which is read and stays as it is",
                    field=option,
                )


def _same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except (OSError, ValueError):  # ValueError: a name with a null character
        return False


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path``; it gets its real name only if nothing goes wrong. Links stay links."""
    target = Path(os.path.realpath(path))
    if target.exists() and not (target.is_file() or target.is_dir()):
        raise OutputError(f"cannot write {path}: it is a device or a pipe, not a file")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def remove_unfinished(folder: Path, names: str) -> None:
    """Remove what processes that were killed in :func:`whole_file` left of files with such names, such as ``*.eqx``."""
    for left in folder.glob(f".{names}.*.part"):
        left.unlink(missing_ok=True)


@contextmanager
def only_one(path: Path, refusal: SidestepError | None = None) -> Iterator[FileIO]:
    """Hold a file that one process at a time can hold, also of another machine that has the same folder.

    The lock is the system's and goes with the process, however that ends.

    Parameters
    ----------
    path
        The file; it is made, and stays.
    refusal
        Raised where another process holds it; None waits until that lets go.

    Yields
    ------
    io.FileIO
        The file, open to be written to at its end; :func:`append` does so.

    Raises
    ------
    SidestepError
        Another process holds the file.
    OutputError
        The file cannot be written, with the field ``out``.
    """
    try:
        file = FileIO(path, "a")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}", field="out") from error
    with file:
        waited = 0.0
        while not locked(file):
            if refusal is not None and waited >= _PATIENCE:
                raise refusal
            sleep(_PATIENCE / 10)
            waited += _PATIENCE / 10
        yield file


def locked(file: FileIO, *, alone: bool = True) -> bool:
    """Lock a file until it is closed, and say whether that was possible.

    Parameters
    ----------
    file
        An open file.
    alone
        Keep all others out, and not only those who want it alone.

    Returns
    -------
    bool
        False where another process holds it. Where there are no locks, everybody may have it.
    """
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def append(file: FileIO, text: bytes) -> None:
    """Write at a file's end; an :class:`OutputError` with the field ``out`` where the disk is full."""
    try:
        while text:  # where the disk is nearly full, a part is written before the rest is refused
            text = text[file.write(text) :]
    except OSError as error:
        raise OutputError(f"cannot write {file.name}: {reason(error)}", field="out") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def reading(path: Path, error: type[SidestepError], holds: str) -> Iterator[BinaryIO]:
    """Open a file of numbers or XML; whatever a damaged one makes its reader say becomes one sentence of this kind.

    Parameters
    ----------
    path
        The file.
    error
        The kind of error.
    holds
        Completes "is damaged or holds no …".

    Yields
    ------
    BinaryIO
        The open file.

    Raises
    ------
    SidestepError
        Of the kind ``error``, with the line where the reader names one.
    """
    try:
        with path.open("rb") as file:
            yield file
    except error as found:
        raise error(f"{path}: {' '.join(str(found).split())}", field=found.field, line=found.line) from found
    except DAMAGED as found:
        said = " ".join(str(found).split()) or type(found).__name__
        line = re.search(r"\bline (\d+)", said)
        raise error(f"{path} is damaged or holds no {holds}: {said:.200}", line=line and int(line[1])) from found
    except (AttributeError, OverflowError, MemoryError) as found:
        raise error(f"{path} is damaged or holds no {holds}: {type(found).__name__}") from found
    except OSError as found:
        raise error(f"cannot read {path}: {reason(found)}") from found


def check_unpacked(file: BinaryIO, error: type[SidestepError]) -> None:
    """Refuse an archive that would fill the memory; the file is then at its beginning again."""
    with zipfile.ZipFile(file) as packed:
        if sum(entry.file_size for entry in packed.infolist()) > LARGEST:
            raise error(f"it unpacks to more than {LARGEST >> 30} GiB")
    file.seek(0)


def cached_by_files(
    named: Callable[..., tuple[str, ...]], most: int = 4
) -> Callable[[Callable[P, Made]], Callable[P, Made]]:
    """Keep what a function makes of its arguments for as long as the files that are named in them stay as they are.

    Parameters
    ----------
    named
        Picks the names out of the arguments. A name need not be that of a file: then there is nothing that could
        change.
    most
        How many results are kept.

    Returns
    -------
    Callable
        A decorator of the function.
    """

    def keeping(function: Callable[P, Made]) -> Callable[P, Made]:
        @lru_cache(maxsize=most)
        def kept(_now: object, *args: P.args, **kwargs: P.kwargs) -> Made:
            return function(*args, **kwargs)

        @wraps(function)
        def made(*args: P.args, **kwargs: P.kwargs) -> Made:
            return kept(stamps(named(*args, **kwargs)), *args, **kwargs)  # type: ignore[arg-type]

        return made

    return keeping


def stamps(files: tuple[str, ...]) -> tuple[tuple[int, int] | None, ...]:
    """When each file was written last, in nanoseconds, and how large it is; None where there is none."""
    return tuple(map(_written, files))


def _written(file: str) -> tuple[int, int] | None:
    """When a file was written last, in nanoseconds, and how large it is; None where there is none."""
    try:
        found = Path(file).stat()
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size


def reason(error: OSError) -> str:
    """Why the system refused, in a few words for the end of a sentence."""
    return (error.strerror or str(error)).lower()
