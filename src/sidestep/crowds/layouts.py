"""What people say of a file of counts that it does not say itself: names of columns, forms of dates and numbers."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Literal

from sidestep.errors import SidestepError


@dataclass(frozen=True)
class Layout:
    """What is said of a file of counts that it does not say itself; what is empty is recognised."""

    time: str = ""
    """Column of dates with times; or ``date`` and ``hour``."""
    date: str = ""
    """Column of dates, beside ``hour``."""
    hour: str = ""
    """Column of times of the day."""
    sensor: str = ""
    """Column of the sensors' names; without it each column of counts is a sensor."""
    count: tuple[str, ...] = ()
    """Columns of counts beside ``sensor``; several are summed."""
    direction: str = ""
    """Column that tells a sensor's rows of one time apart; they are summed."""
    ignore: tuple[str, ...] = ()
    """Columns without a meaning here."""
    latitude: str = ""
    """Column of the sensors' latitudes, in degrees; beside ``longitude``."""
    longitude: str = ""
    """Column of their longitudes."""
    date_format: str = ""
    """``day-first``, ``month-first``, or a format such as ``%d/%m/%y %H:%M``."""
    decimal: Literal["", ".", ","] = ""
    """Mark before the decimals."""
    timezone: str | None = None
    """IANA name of the place's timezone."""

    @property
    def named(self) -> dict[str, tuple[str, ...]]:
        """The columns that are named, by what they are for."""
        said = {key: getattr(self, key) for key in COLUMNS}
        return {key: (value,) if isinstance(value, str) else value for key, value in said.items() if value}

    def check_needed(self, *, timezone: bool = False) -> None:
        """Refuse what is said of the counts that come with the package, which are known.

        Parameters
        ----------
        timezone
            Whether the timezone is said of the counts alone, not of a place.

        Raises
        ------
        SidestepError
            Anything is said; ``field`` is ``columns``, ``date_format``, ``decimal`` or ``timezone``.
        """
        said: dict[str, object] = {"columns": self.named, "date_format": self.date_format, "decimal": self.decimal}
        if timezone:
            said["timezone"] = self.timezone is not None
        for field, value in said.items():
            if value:
                option = f"--{field.replace('_', '-')}"
                raise SidestepError(f"{option} is about a file of counts; name the file, or leave it out", field=field)


RECOGNISED = Layout()
COLUMNS = tuple(field.name for field in fields(Layout) if field.name not in ("date_format", "decimal", "timezone"))
"""The fields that name columns."""
SEVERAL = ("count", "ignore")
"""Those of them that may name several."""


def read_columns(options: Iterable[str]) -> dict[str, str | tuple[str, ...]]:
    """Read names of columns as people write them.

    Parameters
    ----------
    options
        Such as ``time=When,sensor=Where,count=In+Out``; names may have commas in them.

    Returns
    -------
    dict[str, str | tuple[str, ...]]
        Fields of a :class:`Layout`.

    Raises
    ------
    SidestepError
        Another form, or the same field twice; ``field`` is ``columns``.
    """
    found: dict[str, str | tuple[str, ...]] = {}
    keys = "|".join(COLUMNS)
    for option in options:
        for part in re.split(rf",(?=\s*(?:{keys})\s*=)", option):
            key, equals, name = (each.strip() for each in part.partition("="))
            if not (equals and name) or key not in COLUMNS or key in found:
                said = f"--columns must be {'=…, '.join(COLUMNS)}=…, each once at most, such as time=When,sensor=Where"
                raise SidestepError(f"{said},count=In+Out, not {part.strip()!r:.80}", field="columns")
            found[key] = (name,) if key in SEVERAL else name
    return found
