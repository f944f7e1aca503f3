"""Numbers as publishers write them: with decimal commas, and with marks between thousands."""

import re
from dataclasses import dataclass
from reprlib import repr as quoted

import numpy as np
from jaxtyping import Float

from sidestep.crowds.sheets import Cells, Sheet

MISSING = frozenset(("", "-", "–", "na", "n/a", "#n/a", "#na", "n.a.", "nan", "null", "none"))
"""Cells of hours in which nothing was counted, in lower case."""
_BLANKS = re.compile(r"(?<=\d)[\u00a0\u2009\u202f '’](?=\d{3}(?!\d))")  # between thousands
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d{1,3})?", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class Marks:
    """How a file writes numbers."""

    decimal: str
    """Mark before the decimals, or ""."""
    thousands: str
    understood: tuple[str, ...] = ()


def marks_of(sheet: Sheet, columns: dict[str, Cells], decimal: str) -> Marks:
    """Find how all numbers of a file are written.

    A comma or full stop with three digits after it may stand before decimals or between thousands. Another number of
    digits, a 0 before it, or a number of four digits without it tells; in a file with commas between columns it is as
    in English.

    Parameters
    ----------
    sheet, columns
        The file, and its columns of counts.
    decimal
        The mark before decimals, if it is said; otherwise "".

    Returns
    -------
    Marks
        For :func:`counts_in`.

    Raises
    ------
    SidestepError
        Of the sheet's type: numbers that may be read in two ways.
    """
    if decimal:
        return Marks(decimal, "." if decimal == "," else ",")
    cells = [(name, _BLANKS.sub("", text).lstrip("+-")) for name, each in columns.items() for text in each.texts]
    comma, stop = (_evidence(mark, [text for _, text in cells if mark in text]) for mark in ",.")
    if sheet.delimiter == "," or any(re.fullmatch(r"\d{4,}", text) for _, text in cells):
        # With four digits in a row nothing stands between thousands; a comma in quotes among commas is English.
        english = sheet.delimiter == ","
        comma = ("thousands" if english else "decimal") if comma == "either" else comma
        stop = "decimal" if stop == "either" else stop
    comma = "decimal" if comma == "either" and stop == "thousands" else comma
    stop = "thousands" if stop == "either" and comma == "decimal" else stop
    unclear = "," if comma == "either" else "." if stop == "either" else "both" if comma and comma == stop else ""
    if unclear:
        mark = "," if unclear == "both" else unclear
        name, text = next((name, text) for name, text in cells if mark in text)
        whole, parted = text.replace(mark, ""), text.replace(",", ".")
        may = f"may be {whole} or {parted}" if unclear != "both" else "has a decimal comma, others a full stop"
        hint = "give --decimal '.' or --decimal ','"
        raise sheet.error(f"{sheet.source}: column {quoted(name)}: {quoted(text)} {may}; {hint}", field=name)
    if comma == "decimal":
        return Marks(",", ".", ("decimal commas",))
    if comma:
        return Marks(".", ",", ("commas between thousands",))
    return Marks("", ".", ("full stops between thousands",)) if stop == "thousands" else Marks(".", "")


def _evidence(mark: str, texts: list[str]) -> str:
    """What a mark must be: "decimal", "thousands" or "either"; "" where there is none."""
    other = "," if mark == "." else "."
    kinds = set()
    for text in texts:
        if other in text:
            kinds.add("decimal" if text.rfind(mark) > text.rfind(other) else "thousands")
        elif text.count(mark) > 1:
            kinds.add("thousands")
        elif re.fullmatch(rf"[1-9]\d{{0,2}}\{mark}\d{{3}}", text) is None:
            kinds.add("decimal")
    return "decimal" if "decimal" in kinds else "thousands" if kinds else "either" if texts else ""


def counts_in(sheet: Sheet, name: str, cells: Cells, marks: Marks, largest: float) -> Float[np.ndarray, " row"]:
    """A column of counts.

    Parameters
    ----------
    sheet, name, cells
        The file, and the column.
    marks
        How its numbers are written.
    largest
        No count is larger.

    Returns
    -------
    counts
        From 0 to ``largest``; NaN where nothing was counted.

    Raises
    ------
    SidestepError
        Of the sheet's type: cells that are no numbers, negative or too large.
    """
    values = np.array([_number(text, marks) for text in cells.texts])
    wrong = np.isinf(values)
    sheet.refuse_any(
        name, cells, wrong[cells.code], "is not a number; a column without counts is left out by --columns ignore=…"
    )
    sheet.refuse_any(name, cells, (values < 0)[cells.code], "is negative")
    sheet.refuse_any(name, cells, (values > largest)[cells.code], f"is more than {largest:,.0f} persons")
    return values[cells.code]


def _number(text: str, marks: Marks) -> float:
    """A number; NaN where it is missing, and infinite where it is none."""
    if text.lower() in MISSING:
        return np.nan
    plain = _BLANKS.sub("", text)
    if marks.thousands:
        whole, _, rest = plain.partition(marks.decimal) if marks.decimal else (plain, "", "")
        grouped = re.fullmatch(rf"[-+]?\d{{1,3}}(\{marks.thousands}\d{{3}})+", whole)
        plain = plain.replace(marks.thousands, "") if grouped and marks.thousands not in rest else plain
    if marks.decimal == ",":
        plain = plain.replace(".", " ").replace(",", ".")  # a full stop that is left makes it no number
    return float(plain) if _NUMBER.fullmatch(plain) else np.inf
