"""Lines below a header that are no rows of its table: units, totals, and remarks about where it comes from."""

import re
from collections.abc import Sequence
from functools import lru_cache

from sidestep.crowds.column_names import TOTAL_LINES, plain

_NUMBER_OR_TIME = re.compile(
    r"[-+]?[\d.,' \u00a0\u202f]*\d|.*\d{4}.*\d.*|\d{1,2}[./-]\d{1,2}[./-]\d{2}.*|\d{1,2}[:.]\d{2}.*"
)
_TIME = re.compile(r".*(?:\d{4}[-/.]\d{1,2}[-/.]\d|\d[-/.]\d{1,2}[-/.]\d|(?:19|20)\d{6}|\d:\d\d|\d[ -]?[^\W\d]{3}).*")


@lru_cache(maxsize=65536)  # tables repeat the same few numbers and names
def like_data(cell: str) -> bool:
    """Whether a cell has a number, a date or a time of the day, and is no name."""
    return _NUMBER_OR_TIME.fullmatch(cell) is not None


def like_time(cell: str) -> bool:
    """Whether a cell has a date or a time of the day."""
    return _TIME.fullmatch(cell) is not None


def is_aside(cells: Sequence[str]) -> bool:
    """Tell whether a line is about the table and not one of its rows.

    Parameters
    ----------
    cells
        Of the line, at least one of them with something in it.

    Returns
    -------
    bool
        Whether it has neither numbers nor times, or has sums or means but no time.
    """
    first, last = cells[0], cells[-1]
    if first[:1].isdigit():  # most rows of most files
        return False
    if _begins_totals(first or next(filter(None, cells))):
        return not any(map(like_time, cells))
    if last.isdigit():  # most others
        return False
    return not any(map(like_data, reversed(cells)))


@lru_cache(maxsize=65536)
def _begins_totals(cell: str) -> bool:
    return plain(cell) in TOTAL_LINES
