"""On which line of a TOML document something stands, for messages: Python's reader does not say."""

import re
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from functools import lru_cache
from typing import Any

_NOT_PLAIN = re.compile(r""""(?:\\.|[^"\\])*"|'[^']*'|#.*""")  # texts and comments


def line_of(text: str, keys: tuple[str, ...]) -> int:
    """The line, from 1, of the statement that gives a value, or else of what is nearest around it.

    Parameters
    ----------
    text
        A whole document that can be read.
    keys
        Where the value stands: names of tables, then its own.

    Returns
    -------
    int
        1 where none of the tables is there either.
    """
    return max(_statements(text), key=lambda statement: _depth(statement[1], statement[2], keys))[0]


def _depth(header: list[str], values: object, keys: tuple[str, ...]) -> int:
    """How many of the keys lead on to something in the values of a statement, which stands under a header."""
    for depth, key in enumerate(keys):
        if depth < len(header):
            if key != header[depth]:
                return depth
        elif isinstance(values, dict) and key in values:
            values = values[key]
        else:
            return depth
    return len(keys)


@lru_cache(maxsize=1)  # a document may have many mistakes
def _statements(text: str) -> list[tuple[int, list[str], dict[str, Any]]]:
    """Each statement's line, the name of the table that it stands under, and what it gives.

    A statement is the fewest lines that can be read by themselves, so whatever TOML allows is understood: dotted and
    quoted keys, tables in braces, values over several lines.

    Returns
    -------
    list[tuple[int, list[str], dict[str, Any]]]
        From the top of the document to its end.
    """
    lines, start = text.replace("\r\n", "\n").split("\n"), 0
    header: list[str] = []
    found = []
    while start < len(lines):
        end, values = _shortest(lines, start)
        if lines[start].lstrip().startswith("["):
            header, values = _named(values), {}
        found.append((start + 1, header, values))
        start = end
    return found


def _shortest(lines: list[str], start: int) -> tuple[int, dict[str, Any]]:
    """Where a statement ends, and what it gives."""
    for end in _ends(lines, start):
        with suppress(ValueError):
            return end, tomllib.loads("\n".join(lines[start:end]))
    return len(lines), {}


def _ends(lines: list[str], start: int) -> Iterator[int]:
    """Lines before which a statement may end: first those where all its brackets are closed."""
    opened, unlikely = 0, []
    for end in range(start + 1, len(lines) + 1):
        # Without counting brackets, long lists would be read once for every line of theirs.
        plain = _NOT_PLAIN.sub("", lines[end - 1])
        opened += plain.count("[") - plain.count("]")
        if opened > 0 and end > start + 1:
            unlikely.append(end)
        else:
            yield end
    yield from unlikely  # some brackets may stand in a text of several lines


def _named(values: Any) -> list[str]:
    """The name of the table in a header that was read by itself."""
    name = []
    while values:
        if isinstance(values, dict):
            name.append(next(iter(values)))
        (values,) = values.values() if isinstance(values, dict) else values
    return name
