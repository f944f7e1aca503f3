"""Lines below a header that are no rows of its table: units, totals, and remarks about where it comes from."""

import re
from collections.abc import Sequence

from sidestep.crowds.column_names import TOTAL_LINES, plain

_NUMBER_OR_TIME = re.compile(
    r"[-+]?[\d.,' \u00a0\u202f]*\d|.*\d{4}.*\d.*|\d{1,2}[./-]\d{1,2}[./-]\d{2}.*|\d{1,2}[:.]\d{2}.*"
)
_TIME = re.compile(r".*(?:\d{4}[-/.]\d{1,2}[-/.]\d|\d[-/.]\d{1,2}[-/.]\d|(?:19|20)\d{6}|\d:\d\d|\d[ -]?[^\W\d]{3}).*")


def like_data(cell: str) -> bool:
    """Whether a cell is a number, a date or a time of the day, and no name such as "2 High Street"."""
    return _NUMBER_OR_TIME.fullmatch(cell) is not None


def like_time(cell: str) -> bool:
    """Whether a cell may have a date or a time of the day somewhere."""
    return _TIME.fullmatch(cell) is not None


def is_aside(cells: Sequence[str]) -> bool:
    """Tell whether a line is about the table and not one of its rows.

    Parameters
    ----------
    cells
        Of the line, at least one of them with something in it; or none, if they cannot be told apart.

    Returns
    -------
    bool
        Whether it has neither numbers nor times, or has sums or means but no time.
    """
    if plain(next(filter(None, cells), "")) in TOTAL_LINES:
        return not any(map(like_time, cells))
    return bool(cells) and not any(map(like_data, cells))
