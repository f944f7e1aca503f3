"""A walk in words: which way to turn, onto which street, through how dense a crowd."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sidestep.network.geodesy import EARTH_RADIUS

SIGHT = 15.0  # m along a street from a crossing that tell in which direction it leads
TURNS = ((20.0, "straight on"), (60.0, "bear"), (120.0, "turn"), (165.0, "sharp"), (math.inf, "turn round"))
"""Up to how many degrees a turn is called what."""

# After Fruin's levels of service for walkways (1971): A is free, B and C are busy, D and E dense, F jammed.
CROWDING = ((0.31, "free"), (0.72, "busy"), (2.17, "dense"), (math.inf, "jammed"))
"""Below how many persons/m² a street is called what."""

_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_KINDS = {
    "living_street": "living street",
    "pedestrian": "pedestrian street",
    "residential": "residential street",
    "service": "service road",
    "unclassified": "small road",
}


@dataclass(frozen=True, eq=False)
class Leg:
    """One street, or a part of it, from one crossing to the next."""

    street: int
    name: str  # "" where it has none
    kind: str
    metres: float
    minutes: float
    entered: float  # minutes after the departure
    density: float  # persons/m² that are expected on it
    exposure: float  # crowd met, person·s/m²
    too_dense: bool  # whether it is entered above the maximum density
    course: Float[np.ndarray, "point 2"]  # longitude and latitude in the direction of walking

    @property
    def label(self) -> str:
        """What the street is called: its name, or its kind."""
        return self.name or _KINDS.get(self.kind, self.kind.replace("_", " "))


@dataclass(frozen=True)
class Step:
    """Streets of one name, one after the other."""

    turn: str  # what to do where it begins
    street: str
    legs: tuple[Leg, ...]

    @property
    def metres(self) -> float:
        """Length."""
        return sum(leg.metres for leg in self.legs)

    @property
    def minutes(self) -> float:
        """Time that is expected."""
        return sum(leg.minutes for leg in self.legs)

    @property
    def density(self) -> float:
        """Persons/m² that are expected, averaged over the time on the way."""
        return mean_density(self.legs)


def mean_density(legs: Sequence[Leg]) -> float:
    """Persons/m² around a walker, averaged over the time on the way."""
    minutes = sum(leg.minutes for leg in legs)
    return sum(leg.density * leg.minutes for leg in legs) / minutes if minutes else 0.0


def crowding_word(density: float) -> str:
    """What a density in persons/m² is called (see ``CROWDING``)."""
    return next(word for limit, word in CROWDING if density < limit)


def turn_word(before: float, after: float) -> str:
    """What to do between two bearings, in degrees from north clockwise."""
    angle = (after - before + 180) % 360 - 180
    word = next(word for limit, word in TURNS if abs(angle) <= limit)
    if word in ("straight on", "turn round"):
        return word
    side = "right" if angle > 0 else "left"
    return f"sharp {side}" if word == "sharp" else f"{word} {side}"


def compass_word(bearing: float) -> str:
    """The nearest of eight directions to a bearing in degrees."""
    return _COMPASS[round(bearing / 45) % 8]


def bearings(course: Float[np.ndarray, "point 2"]) -> tuple[float, float]:
    """Degrees from north in which a course of longitudes and latitudes begins, and in which it ends.

    What counts is the direction over ``SIGHT`` metres: the last steps onto a crossing may lead anywhere.
    """
    scale = np.radians(EARTH_RADIUS) * np.array([np.cos(np.radians(course[:, 1].mean())), 1.0])
    place = (course - course[0]) * scale
    along = np.append(0.0, np.linalg.norm(np.diff(place, axis=0), axis=1).cumsum())

    def at(metres: float) -> np.ndarray:
        return np.array([np.interp(metres, along, column) for column in place.T])

    return _bearing(at(SIGHT) - at(0.0)), _bearing(at(along[-1]) - at(along[-1] - SIGHT))


def _bearing(step: Float[np.ndarray, "2"]) -> float:
    return float(np.degrees(np.arctan2(step[0], step[1]))) % 360


def directions(legs: Sequence[Leg]) -> list[Step]:
    """Turn by turn: streets of one name are joined, and unnamed ones of one kind where they lead straight on."""
    steps: list[Step] = []
    ended = 0.0
    for leg in legs:
        begins, ends = bearings(leg.course)
        turn = turn_word(ended, begins) if steps else f"head {compass_word(begins)}"
        last = steps[-1] if steps else None
        # "Footway" is no name: two of them that meet in a corner are not the same.
        same = last is not None and last.street == leg.label and bool(last.legs[-1].name) == bool(leg.name)
        if last is not None and same and (turn == "straight on" or (leg.name and turn != "turn round")):
            steps[-1] = Step(last.turn, last.street, (*last.legs, leg))
        else:
            steps.append(Step(turn, leg.label, (leg,)))
        ended = ends
    return steps
