"""Files of TOML that people write: read as specs take them, and refused with the line of each mistake."""

import os
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

from sidestep.files import reason
from sidestep.scenarios.spec import Fault, SpecError
from sidestep.scenarios.toml_lines import line_of

LARGEST = 1 << 16  # bytes and
MOST_LINES = 2_000  # lines of a file; more is none that people write
_LINE_OF_ERROR = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")
Refused = TypeVar("Refused", bound=SpecError)


def read_toml(path: Path, holds: str, error: type[SpecError]) -> tuple[str, dict[str, Any]]:
    """Read a file of TOML.

    Parameters
    ----------
    path
        The file.
    holds
        What it should hold, such as "scenario".
    error
        The kind of error.

    Returns
    -------
    text, values
        The file as it is, and what it says, with tuples for lists.

    Raises
    ------
    SpecError
        A file that cannot be read, is too large, or is no TOML; of the kind ``error``.
    """
    text = _text(path, holds, error)
    return text, _tuples(_parsed(path, text, error))


def refusal(path: Path, text: str, found: Iterable[Fault], error: type[Refused]) -> Refused:
    """The error that tells the mistakes in a file.

    Parameters
    ----------
    path, text
        The file.
    found
        One mistake or more.
    error
        The kind of error.

    Returns
    -------
    SpecError
        About the first mistake, with its field and line; ``others`` has those after it.
    """
    first, *others = sorted((_located(path, text, fault, error) for fault in found), key=lambda each: each.line or 0)
    more = f" ({len(others)} more mistake{'s' * (len(others) > 1)} in this file)" if others else ""
    refused = error(f"{first}{more}", field=first.field, line=first.line)
    refused.others = tuple(others)
    return refused


def _text(path: Path, holds: str, error: type[SpecError]) -> str:
    if os.path.isdir(path):  # noqa: PTH112 - Path.is_dir raises where a name is too long
        raise error(f"{path} is a folder; name the file in it, such as {path / holds}.toml")
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
    except (OSError, ValueError) as found:  # ValueError: a path with a null character
        said = reason(found) if isinstance(found, OSError) else str(found)
        raise error(f"cannot read the {holds} {str(path)!r:.300}: {said}") from found
    if len(content) > LARGEST or content.count(b"\n") > MOST_LINES:
        raise error(f"{path}: more than {LARGEST >> 10} KiB or {MOST_LINES:,} lines are no {holds}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as found:
        line = content[: found.start].count(b"\n") + 1
        raise error(f"{path}: line {line}: not a text file (UTF-8)", line=line) from found
    if not text.strip():
        raise error(f"{path}: the file is empty")
    return text


def _parsed(path: Path, text: str, error: type[SpecError]) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError as found:
        raise error(f"{path}: brackets are nested too deeply") from found
    except tomllib.TOMLDecodeError as found:
        said, line = str(found), text.rstrip("\n").count("\n") + 1
        if place := _LINE_OF_ERROR.search(said):
            said, line = said[: place.start()], min(int(place[1] or line), line)
        said = f"{said[:1].lower()}{said[1:]:.200}"
        raise error(f"{path}: line {line}: not TOML: {said}", line=line) from found
    except ValueError as found:  # a number of thousands of digits
        raise error(f"{path}: not TOML: {str(found)[:200]}") from found


def _tuples(value: Any) -> Any:
    """Lists, which may change, as tuples, which specs hold."""
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _located(path: Path, text: str, fault: Fault, error: type[Refused]) -> Refused:
    """A mistake with its file and line."""
    line, sentence = line_of(text, fault.path), " ".join(fault.sentence.split())
    return error(f"{path}: line {line}: {sentence}", field=".".join(fault.path), line=line)
