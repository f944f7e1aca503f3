"""Routes in words: where to turn, onto which street, through how dense a crowd."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypedDict

import numpy as np
from jaxtyping import Float

from sidestep.network.town import EARTH_RADIUS

SIGHT = 15.0
"""Metres along a street from a crossing over which its direction is taken."""

TURNS = ((20.0, "straight on"), (60.0, "bear"), (120.0, "turn"), (165.0, "sharp"), (math.inf, "turn round"))
"""The word for a turn, by its largest angle in degrees."""

CROWDING = ((0.31, "free"), (0.72, "busy"), (2.17, "dense"), (math.inf, "jammed"))
"""The word for a density, by its upper limit in persons/m².

Fruin's levels of service for walkways (J. J. Fruin, Pedestrian Planning and Design, 1971): A is free, B and C are busy,
D and E dense, F jammed.
"""

_COMPASS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_KINDS = {
    "living_street": "living street",
    "pedestrian": "pedestrian street",
    "residential": "residential street",
    "service": "service road",
    "unclassified": "small road",
}


class StepJson(TypedDict):
    """One line of the directions."""

    turn: str
    street: str
    first_leg: int
    """Its first leg, counted from 0."""
    metres: float
    minutes: float
    density: float
    """Expected persons/m², averaged over the time."""
    crowding: str


class LegJson(TypedDict):
    """One segment."""

    segment: int
    street: int | None
    """None on grids, as are name, kind and coordinates."""
    name: str | None
    """Empty where the street has none."""
    kind: str | None
    label: str
    """The name, or the kind."""
    metres: float
    minutes: float
    density: float
    """Expected persons/m² as its middle is reached."""
    coordinates: list[list[float]] | None
    """Longitude and latitude, degrees."""


@dataclass(frozen=True, eq=False)
class StreetPiece:
    """The street that a segment belongs to. On grids streets have no numbers, names and coordinates."""

    street: int | None = None
    """Number of the street in its town."""

    name: str | None = None
    """Empty where the street has none."""

    kind: str | None = None
    """The value of OpenStreetMap's key ``highway``."""

    course: Float[np.ndarray, "point 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    """Longitude and latitude in degrees, in the direction of walking; empty on grids."""

    @property
    def label(self) -> str:
        """What people call the street: its name, or its kind."""
        kind = self.kind or ""
        return self.name or _KINDS.get(kind, kind.replace("_", " "))


@dataclass(frozen=True, eq=False)
class Leg:
    """One segment of a route, from one node to the next, if crowds are as expected."""

    segment: int
    piece: StreetPiece

    metres: float
    """Length."""

    minutes: float
    """Time with the wait before it."""

    density: float
    """Persons/m² as its middle is reached."""

    exposure: float = 0.0
    """Crowd met, person·s/m²."""

    too_dense: bool = False
    """Whether it is entered above the objective's maximum density."""

    def to_json(self) -> LegJson:
        """Ready for ``json.dumps``; coordinates to about a centimetre."""
        return {
            "segment": self.segment,
            "street": self.piece.street,
            "name": self.piece.name,
            "kind": self.piece.kind,
            "label": self.piece.label,
            "metres": self.metres,
            "minutes": self.minutes,
            "density": self.density,
            "coordinates": np.round(self.piece.course, 7).tolist() or None,
        }


@dataclass(frozen=True)
class Step:
    """Legs along streets of one name."""

    turn: str
    """What to do where the step begins."""

    first_leg: int
    """Number of its first leg, counted from 0."""

    legs: tuple[Leg, ...]

    @property
    def street(self) -> str:
        """What people call the street."""
        return self.legs[0].piece.label

    @property
    def metres(self) -> float:
        """Length."""
        return sum(leg.metres for leg in self.legs)

    @property
    def minutes(self) -> float:
        """Expected time."""
        return sum(leg.minutes for leg in self.legs)

    @property
    def density(self) -> float:
        """Expected persons/m², averaged over the time on the way."""
        return mean_density(self.legs)

    def to_json(self) -> StepJson:
        """Ready for ``json.dumps``."""
        return {
            "turn": self.turn,
            "street": self.street,
            "first_leg": self.first_leg,
            "metres": self.metres,
            "minutes": self.minutes,
            "density": self.density,
            "crowding": crowding_word(self.density),
        }


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
    word = next(word for limit, word in TURNS if abs(angle) <= limit)
    if word in ("straight on", "turn round"):
        return word
    side = "right" if angle > 0 else "left"
    return f"sharp {side}" if word == "sharp" else f"{word} {side}"


def compass_word(bearing: float) -> str:
    """The nearest of eight directions to a bearing in degrees."""
    return _COMPASS[round(bearing / 45) % 8]


def bearings(course: Float[np.ndarray, "point 2"]) -> tuple[float, float]:
    """Bearings, in degrees clockwise from north, in which a course of longitudes and latitudes begins and ends.

    They are taken over ``SIGHT`` metres, since the last steps onto a crossing may lead anywhere.
    """
    scale = np.radians(EARTH_RADIUS) * np.array([np.cos(np.radians(course[:, 1].mean())), 1.0])
    place = (course - course[0]) * scale
    along = np.append(0.0, np.linalg.norm(np.diff(place, axis=0), axis=1).cumsum())

    def at(metres: float) -> np.ndarray:
        return np.array([np.interp(metres, along, column) for column in place.T])

    return _bearing(at(SIGHT) - at(0.0)), _bearing(at(along[-1]) - at(along[-1] - SIGHT))


def _bearing(step: Float[np.ndarray, "2"]) -> float:
    return float(np.degrees(np.arctan2(step[0], step[1]))) % 360


def directions(legs: Sequence[Leg]) -> tuple[Step, ...]:
    """Turn by turn: streets of one name are joined, and unnamed ones of one kind where they lead straight on."""
    steps: list[Step] = []
    ended = 0.0
    for number, leg in enumerate(legs):
        begins, ends = bearings(leg.piece.course)
        turn = turn_word(ended, begins) if steps else f"head {compass_word(begins)}"
        if steps and _joins(steps[-1].legs[-1].piece, leg.piece, turn):
            steps[-1] = replace(steps[-1], legs=(*steps[-1].legs, leg))
        else:
            steps.append(Step(turn, number, (leg,)))
        ended = ends
    return tuple(steps)


def _joins(before: StreetPiece, after: StreetPiece, turn: str) -> bool:
    """Whether walkers would say that they are still on the same street."""
    # "Footway" is no name: two of them that meet in a corner are not the same.
    same = before.label == after.label and bool(before.name) == bool(after.name)
    return same and (turn == "straight on" or (bool(after.name) and turn != "turn round"))
