"""Routes in words: where to turn, onto which street, and how dense the crowd is."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sidestep.crowds.profile import day_and_time
from sidestep.network.geodesy import Projection
from sidestep.network.tags import ACROSS, AREA

SIGHT = 15.0
"""Metres along a street from a crossing over which its direction is taken."""

INTERRUPTION = 20.0
"""Metres below which a piece of another street, straight on between two of one name, is part of that street."""

TURNS = ((20.0, "straight on"), (60.0, "bear {}"), (120.0, "turn {}"), (165.0, "sharp {}"), (math.inf, "turn round"))
"""Words for a turn, by its largest angle in degrees; ``{}`` is the side."""

CROWDING = ((0.31, "free"), (0.72, "busy"), (2.17, "dense"), (math.inf, "jammed"))
"""The word for a density, by its upper limit in persons/m².

Fruin's levels of service for walkways (J. J. Fruin, Pedestrian Planning and Design, 1971): A is free, B and C are busy,
D and E dense, F jammed.
"""

_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_KINDS = {
    AREA: "square",
    "pedestrian": "pedestrian street",
    "residential": "residential street",
    "service": "service road",
    "unclassified": "small road",
}


@dataclass(frozen=True, kw_only=True)
class Leg:
    """One segment of a route, from one node to the next, if crowds are as expected."""

    segment: int
    """Number of the segment; the pieces of split streets come after the segments of the town."""

    metres: float
    """Length."""

    minutes: float
    """Time, with the wait before it."""

    opens: str | None = None
    """Time of day at which the street opens, where walkers wait before it until then."""

    minutes_until_open: float = 0.0
    """Minutes of that wait."""

    density: float
    """Persons/m² as its middle is reached."""

    exposure: float
    """Crowd met, person·s/m²."""

    too_dense: bool
    """Whether it is entered above the objective's maximum density."""

    street: int | None = None
    """Number of the street in its town; None on grids."""

    name: str | None = None
    """Name of the street, empty where it has none; None on grids."""

    kind: str | None = None
    """The value of OpenStreetMap's key ``highway``, "platform" or "pier", and "area" for the way across a square or
    another area; None on grids."""

    coordinates: list[list[float]] | None = None
    """Longitude and latitude, degrees, to about a centimetre; None on grids."""

    @property
    def label(self) -> str:
        """What people call the street."""
        return street_label(self.name, self.kind)


@dataclass(frozen=True, kw_only=True)
class Step:
    """Legs along streets of one name: one line of the directions."""

    turn: str
    """What to do where it begins: "wait until 06:00, then turn left" where the street is shut till then."""

    street: str
    """What people call the street."""

    first_leg: int
    """Number of its first leg, counted from 0."""

    metres: float
    """Length."""

    minutes: float
    """Expected time."""

    density: float
    """Expected persons/m², averaged over the time on the way."""

    crowding: str
    """A word for the density."""

    bearing_before: float | None
    """In which walkers come to where it begins, in degrees clockwise from north; None for the first."""

    bearing_after: float
    """In which it leads on from there."""


def street_label(name: str | None, kind: str | None) -> str:
    """What people call a street: its name, or its kind; empty on grids."""
    return name or _KINDS.get(kind or "", (kind or "").replace("_", " "))


def mean_density(legs: Sequence[Leg]) -> float:
    """Persons/m² around a walker, averaged over the time on the way."""
    minutes = sum(leg.minutes for leg in legs)
    return sum(leg.density * leg.minutes for leg in legs) / minutes if minutes else 0.0


def crowding_word(density: float) -> str:
    """The word for a density in persons/m² (see ``CROWDING``)."""
    return next(word for limit, word in CROWDING if density < limit)


def turn_word(before: float, after: float) -> str:
    """The word for a turn from one bearing to another, in degrees clockwise from north."""
    angle = (after - before + 180) % 360 - 180
    words = next(words for limit, words in TURNS if abs(angle) <= limit)
    return words.format("right" if angle > 0 else "left")


def compass_word(bearing: float) -> str:
    """The nearest of eight directions to a bearing in degrees."""
    return _COMPASS[round(bearing / 45) % 8]


def opening_word(hour: float, clock: float, shut: float) -> str | None:
    """Say when a street opens.

    Parameters
    ----------
    hour
        Hour of the week at clock 0, 0 is Monday 0:00.
    clock, shut
        When a walker comes there, and seconds until the street opens.

    Returns
    -------
    str or None
        Time of day, with the day of the week where that is a day away or more; None where the street is open.
    """
    if shut <= 0:
        return None
    opens = day_and_time(hour + (clock + shut) / 3600)
    return opens.split()[-1] if shut < 24 * 3600 else opens


def bearings(course: Float[np.ndarray, "point 2"]) -> tuple[float, float]:
    """Bearings in which a course begins and ends.

    They are taken over ``SIGHT`` metres, since the last steps onto a crossing may lead anywhere.

    Parameters
    ----------
    course
        Longitudes and latitudes in degrees.

    Returns
    -------
    float, float
        Degrees clockwise from north.
    """
    return plane_bearings(Projection.of(course).project(course))


def plane_bearings(place: Float[np.ndarray, "point 2"]) -> tuple[float, float]:
    """Bearings of a course as of :func:`bearings`, given its x (east) and y (north) in m."""
    along = np.append(0.0, np.linalg.norm(np.diff(place, axis=0), axis=1).cumsum())

    at = np.array([0.0, SIGHT, along[-1] - SIGHT, along[-1]])
    (east, other_east), (north, other_north) = (np.diff(np.interp(at, along, column))[::2] for column in place.T)
    begins, ends = np.degrees(np.arctan2((east, other_east), (north, other_north))).tolist()
    return begins % 360, ends % 360


def directions(legs: Sequence[Leg], headings: Sequence[tuple[float, float]] | None = None) -> list[Step]:
    """Turn by turn.

    Streets of one name are one line, with the few metres of another street that may lie between them, and so are a
    square, and streets of one kind that lead straight on. A wait begins another line.

    Parameters
    ----------
    legs
        Of a route in a town.
    headings
        In which bearings each of them begins and ends, if they are known already.

    Returns
    -------
    list of Step
        The lines, in the order of the route.
    """
    headings = [bearings(np.array(leg.coordinates)) for leg in legs] if headings is None else headings
    groups: list[tuple[str, int, list[Leg]]] = []
    for number, (leg, (begins, _)) in enumerate(zip(legs, headings, strict=True)):
        turn = turn_word(headings[number - 1][1], begins) if groups else f"head {compass_word(begins)}"
        if leg.opens is not None:
            groups.append((f"wait until {leg.opens}, then {turn}", number, [leg]))
        elif groups and _joins(legs[number - 1], leg, turn):
            groups[-1][2].append(leg)
        elif len(groups) > 1 and _resumes(groups[-2][2][-1], groups[-1][2], leg, (groups[-1][0], turn)):
            *_, between = groups.pop()
            groups[-1][2].extend([*between, leg])
        else:
            groups.append((turn, number, [leg]))
    return [
        Step(
            turn=turn,
            street=joined[0].label,
            first_leg=number,
            metres=sum(leg.metres for leg in joined),
            minutes=sum(leg.minutes for leg in joined),
            density=mean_density(joined),
            crowding=crowding_word(mean_density(joined)),
            bearing_before=headings[number - 1][1] if number else None,
            bearing_after=headings[number][0],
        )
        for turn, number, joined in groups
    ]


def _joins(before: Leg, after: Leg, turn: str) -> bool:
    """Whether walkers would say that they are still on the same street."""
    # "Footway" is no name: two of them that meet in a corner are not the same. Of a square people see all at once.
    same = before.label == after.label and bool(before.name) == bool(after.name)
    one = bool(after.name) or after.kind in ACROSS
    return same and (_leads_on(before, after, turn) or (one and turn != "turn round"))


def _resumes(before: Leg, between: Sequence[Leg], after: Leg, turns: tuple[str, str]) -> bool:
    """Whether a street goes on behind a short piece of another one, given the turns onto that and from it."""
    same = bool(after.name) and before.name == after.name and sum(leg.metres for leg in between) < INTERRUPTION
    return same and _leads_on(before, between[0], turns[0]) and _leads_on(between[-1], after, turns[1])


def _leads_on(before: Leg, after: Leg, turn: str) -> bool:
    # Over so few metres a bend is no turn.
    bend = turn.startswith("bear") and min(before.metres, after.metres) < SIGHT
    return turn == "straight on" or bend
