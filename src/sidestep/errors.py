"""Errors that a user's input causes: one sentence for people, exit status 2 on the command line."""

import difflib
from collections.abc import Sequence

MOST_LISTED = 16  # names in one sentence


class SidestepError(ValueError):
    """Bad input. The message is one sentence that says what is wrong, where, and what to do about it.

    Parameters
    ----------
    message
        The sentence.
    field
        Name of the option, field or column at fault, where one is; nested fields are joined by dots.
    line
        Line of the file at fault, counted from 1, where it is known.
    """

    def __init__(self, message: str, *, field: str | None = None, line: int | None = None) -> None:
        super().__init__(message)
        self.field = field
        self.line = line


class SidestepWarning(UserWarning):
    """What a user should know although the work goes on, in one sentence; on the command line on standard error."""


def hint(name: object, known: Sequence[str], other: str = "") -> str:
    """What may have been meant by a name that is not known, for the end of a sentence.

    Parameters
    ----------
    name
        The name.
    known
        Those that are.
    other
        What may be given beside the known names, such as "a file".

    Returns
    -------
    str
        From a semicolon or nothing on; nothing is to follow.
    """
    close = difflib.get_close_matches(str(name).lower(), known, n=1)
    if close:
        return f"; did you mean {close[0]}{other and f', or {other}'}?"
    listed = [*known] if len(known) <= MOST_LISTED else []
    choices = [*listed, other] if other else listed
    if len(choices) < 2:
        return f"; it must be {choices[0]}" if choices else ""
    return f"; choose from {', '.join(choices[:-1])} or {choices[-1]}"
