"""Kinds of values that specs hold, with their rules."""

from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag, field_validator

from sidestep.crowds.wall_time import TimezoneError, timezone_of
from sidestep.scenarios.spec import shown


def rule(holds: Callable[[Any], bool], must: str) -> AfterValidator:
    """A rule of a field's values.

    Parameters
    ----------
    holds
        Whether a value keeps it.
    must
        The rule, as a sentence goes on that begins with the field.

    Returns
    -------
    AfterValidator
        For the field's annotation.
    """
    return AfterValidator(lambda value: _refuse_unless(holds(value), value, must))


def across(field: str, holds: Callable[[Any, dict[str, Any]], bool], must: str) -> Any:
    """A rule of a field that depends on fields before it.

    Parameters
    ----------
    field
        Its name.
    holds
        Whether a value keeps the rule, given the fields before it by their names. It is not asked where one of those
        that it looks at is wrong itself.
    must
        The rule, as a sentence goes on that begins with the field.

    Returns
    -------
    Any
        A validator, to be a member of the spec.
    """

    def check(value: Any, info: Any) -> Any:
        try:
            held = holds(value, info.data)
        except KeyError:
            return value
        return _refuse_unless(held, value, must)

    return field_validator(field)(check)


def _refuse_unless(held: object, value: Any, must: str) -> Any:
    if not held:
        raise ValueError(f"{must}, not {shown(value)}")
    return value


def _hour(text: str) -> str:
    """A day, or an hour of it, in one spelling."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"must be days such as 2025-03-10, not {shown(text)}") from error
    if time.tzinfo is not None or (time.minute, time.second, time.microsecond) != (0, 0, 0):
        raise ValueError(f"must be days or full hours of local wall time, without an offset, not {shown(text)}")
    return time.isoformat(timespec="hours") if time.hour else time.date().isoformat()


def _timezone(name: str) -> str:
    try:
        return timezone_of(name).key
    except TimezoneError as error:
        raise ValueError(str(error).removeprefix("timezone ")) from error


def _sort_of_waypoint(value: object) -> str | None:
    return "degrees" if isinstance(value, tuple | list) else "crossing" if isinstance(value, int) else None


distinct = rule(lambda values: len(set(values)) == len(values), "must all be different")
_in_order = rule(lambda pair: pair[0] <= pair[1], "must be two numbers in order")
_before = rule(lambda pair: pair[0] < pair[1], "must begin before it ends")

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Phi = Annotated[float, Field(ge=0, lt=1)]
Side = Annotated[int, Field(ge=2, le=1_000)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]
Seed = Annotated[int, Field(ge=0, lt=2**63)]
PositiveRange = Annotated[tuple[Positive, Positive], _in_order]
Range = Annotated[tuple[NonNegative, NonNegative], _in_order]
Remark = Annotated[str, rule(str.isprintable, "must be one line of printable text")]
Line = Annotated[Remark, Field(pattern=r"\S")]
Timezone = Annotated[str, AfterValidator(_timezone)]
"""IANA name, such as Europe/Helsinki."""
Days = Annotated[tuple[Annotated[int, Field(ge=0, le=6)], ...], Field(min_length=1), distinct]
"""Of the week; 0 is Monday."""
Hour = Annotated[int, Field(ge=0, le=24)]
Hours = Annotated[tuple[Hour, Hour], _before]
"""Of the day: the first, and the one after the last."""
_Text = Annotated[str, AfterValidator(_hour)]
Period = Annotated[tuple[_Text, _Text], _before]
"""First day or hour, and the one after the last, in local wall time."""
Degrees = Annotated[
    tuple[float, float],
    rule(
        lambda place: abs(place[0]) <= 90 and abs(place[1]) <= 180,
        "must be degrees of latitude (-90 to 90), then of longitude",
    ),
]
"""Latitude and longitude."""
Waypoint = Annotated[
    Annotated[int, Field(ge=0), Tag("crossing")] | Annotated[Degrees, Tag("degrees")],
    Discriminator(
        _sort_of_waypoint,
        custom_error_type="waypoint",
        custom_error_message="must hold numbers of crossings, counted from 0, or pairs of latitude and longitude",
    ),
]
"""A crossing: its number, or latitude and longitude in degrees of a place near it."""
Waypoints = Annotated[tuple[Waypoint, ...], distinct]
