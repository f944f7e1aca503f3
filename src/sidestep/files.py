"""Writing results, whole or not at all, and reading files that may be damaged."""

import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from sidestep.errors import SidestepError

LARGEST = 2**31  # bytes that one file may unpack to; a town of a million streets takes a tenth of it


class OutputError(SidestepError):
    """A place that cannot be written to."""


def output_folder(path: Path) -> Path:
    """Make sure, before long work begins, that a folder exists and takes files."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / f".writable-{os.getpid()}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"cannot write to the output folder {path}: {reason(error)}") from error
    return path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside ``path``; it gets its real name only if nothing goes wrong."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {reason(error)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


@contextmanager
def reading(path: Path, error: type[SidestepError], holds: str) -> Iterator[BinaryIO]:
    """Open a file of numbers or XML; whatever a damaged one makes its reader say becomes one sentence of this kind.

    ``holds`` completes "is damaged or holds no …".
    """
    try:
        with path.open("rb") as file:
            yield file
    except error as found:
        raise error(f"{path}: {' '.join(str(found).split())}") from found
    # A syntax error is what XML's reader calls a damaged file.
    except (zipfile.BadZipFile, zlib.error, SyntaxError, EOFError, LookupError, TypeError, ValueError) as found:
        said = " ".join(str(found).split()) or type(found).__name__
        raise error(f"{path} is damaged or holds no {holds}: {said:.200}") from found
    except (AttributeError, OverflowError, MemoryError, NotImplementedError, RuntimeError) as found:
        raise error(f"{path} is damaged or holds no {holds}: {type(found).__name__}") from found
    except OSError as found:
        raise error(f"cannot read {path}: {reason(found)}") from found


def check_unpacked(file: BinaryIO, error: type[SidestepError]) -> None:
    """Refuse an archive that would fill the memory; the file is then at its beginning again."""
    with zipfile.ZipFile(file) as packed:
        if sum(entry.file_size for entry in packed.infolist()) > LARGEST:
            raise error(f"it unpacks to more than {LARGEST >> 30} GiB")
    file.seek(0)


def reason(error: OSError) -> str:
    """Why the system refused, in a few words for the end of a sentence."""
    return (error.strerror or str(error)).lower()
