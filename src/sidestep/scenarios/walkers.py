"""Who walks: different age groups and different types of people, and a delivery robot. docs/walkers.md has the sources.

Speeds are horizontal ones, in m/s. Every number may be changed.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import BeforeValidator, Field

from sidestep.errors import hint
from sidestep.network.town import Town
from sidestep.scenarios import values
from sidestep.scenarios.spec import ScenarioError, Spec, shown
from sidestep.walking.profile import lift_waits, own_law, paces, passable
from sidestep.walking.speed_laws import FREE_SPEED, LAWS, Law, SpeedLaw

SLOWEST, FASTEST = 0.1, 10.0  # m/s
Speed = Annotated[float, Field(ge=SLOWEST, le=FASTEST)]
Kind = Literal["adult", "older", "child", "wheelchair", "robot", "custom"]


class Walker(Spec):
    """What a walker is like. The defaults are those of an average adult."""

    kind: Kind
    free_speed: Speed = FREE_SPEED
    """On an empty level street. It scales the law of speed: at all densities alike."""
    law: Law | None = None
    """Speed by density; by default the scenario's."""
    crowd_factor: Annotated[float, Field(ge=0.01, le=100)] = 1.0
    """How many times as dense crowds are to this walker, who slows down accordingly."""
    stairs: bool = True
    """Whether stairs are taken."""
    stairs_up: Speed | None = None
    """Up stairs; by default as much slower than on level ground as an adult is."""
    stairs_down: Speed | None = None
    """Down stairs; likewise."""
    lifts: bool = True
    """Whether lifts are taken."""
    lift_wait: Annotated[float, Field(ge=0, le=3600)] = 60.0
    """Seconds that a lift takes: to come, to open and close its doors twice, and to go."""
    least_width: values.NonNegative = 0.0
    """Metres of the narrowest street that is taken."""
    highest_kerb: values.NonNegative | None = None
    """Metres of the highest kerb that is taken; by default any."""
    steepest: values.Positive | None = None
    """Largest rise or fall for each metre of a street other than stairs; by default any."""

    @property
    def called(self) -> str:
        return f"walker {self.kind}"

    def speed_law(self, law: Law) -> SpeedLaw:
        """Speed by density of this walker, where ``law`` is the scenario's."""
        return own_law(LAWS[self.law or law], self.free_speed, self.crowd_factor)

    def passable(self, town: Town) -> Bool[np.ndarray, " street"]:
        """Which streets of a town this walker takes."""
        limits = ("stairs", "lifts", "least_width", "highest_kerb", "steepest")
        return passable(town, **{name: getattr(self, name) for name in limits})

    def paces(self, town: Town) -> Float32[np.ndarray, " segment"] | None:
        """Speed on each segment of a town over that on level ground; None where there are no stairs."""
        return paces(town, self.free_speed, self.stairs_up, self.stairs_down)

    def lift_waits(self, town: Town) -> Float32[np.ndarray, " segment"] | None:
        """Seconds that lifts take, before each segment of a town; None where there are none."""
        return lift_waits(town, self.lift_wait)

    def in_words(self) -> str:
        """Its kind and numbers, for people."""
        return walker_in_words(self.model_dump())

    @property
    def remark(self) -> str:
        """A line about it for results; "" for the adult that walks where nothing else is said."""
        return "" if self == Adult() else f"walker: {self.in_words()}"

    def to_json(self) -> dict[str, Any] | None:
        """Its numbers; None for the adult that walks where nothing else is said."""
        return None if self == Adult() else self.model_dump()


class Adult(Walker):
    """The average adult (Weidmann 1993)."""

    kind: Literal["adult"] = "adult"


class Older(Walker):
    """Older than 65: the mean of 326 people at crossings (Gates et al. 2006)."""

    kind: Literal["older"] = "older"
    free_speed: Speed = 1.16


class Child(Walker):
    """Five to six years old (Fang et al. 2019)."""

    kind: Literal["child"] = "child"
    free_speed: Speed = 0.81
    stairs_down: Speed | None = 0.63


class Wheelchair(Walker):
    """In a manual wheelchair, without help: the mean of 52 people (Tolerico et al. 2007)."""

    kind: Literal["wheelchair"] = "wheelchair"
    free_speed: Speed = 0.79
    stairs: bool = False
    least_width: values.NonNegative = 0.9
    highest_kerb: values.NonNegative | None = 0.03
    steepest: values.Positive | None = 0.06


class Robot(Walker):
    """A delivery robot that yields to people, and so is slower already where there are few."""

    kind: Literal["robot"] = "robot"
    free_speed: Speed = 1.79
    crowd_factor: Annotated[float, Field(ge=0.01, le=100)] = 4.0
    stairs: bool = False
    lifts: bool = False
    least_width: values.NonNegative = 0.8
    highest_kerb: values.NonNegative | None = 0.03
    steepest: values.Positive | None = 0.1


class Custom(Walker):
    """Anybody else: an adult whose free speed has to be said."""

    kind: Literal["custom"] = "custom"
    free_speed: Speed


WALKERS: dict[str, type[Walker]] = {
    "adult": Adult, "older": Older, "child": Child, "wheelchair": Wheelchair, "robot": Robot, "custom": Custom,
}  # fmt: skip
ADULT = Adult()


def _by_kind(value: object) -> object:
    return {"kind": value} if isinstance(value, str) else value


AnyWalker: TypeAlias = Annotated[
    Adult | Older | Child | Wheelchair | Robot | Custom, Field(discriminator="kind"), BeforeValidator(_by_kind)
]
"""One of them, or its kind alone."""


def read_walkers(text: str, own: Walker = ADULT) -> tuple[Walker, ...]:
    """Read walkers as people write them, such as ``adult,wheelchair`` or ``older,free_speed=1.0,stairs=false``.

    Parameters
    ----------
    text
        Kinds of walkers, separated by commas; after each, fields that it has otherwise.
    own
        The scenario's walker, which its kind means.

    Returns
    -------
    tuple[Walker, ...]
        At least one, all different.

    Raises
    ------
    ScenarioError
        Unknown kinds and fields, wrong values, the same walker twice; ``field`` is ``walker`` or the walker's field.
    """
    found = tuple(_walker(kind, changes, own) for kind, changes in _statements(text))
    if len(set(found)) < len(found):
        raise ScenarioError(f"walker must name different walkers, not {shown(text)}", field="walker")
    return found


def _statements(text: str) -> Iterator[tuple[str, dict[str, str]]]:
    """The kinds in a text, each with what is said of it."""
    said: list[tuple[str, dict[str, str]]] = []
    for part in text.split(","):
        name, equals, value = (each.strip() for each in part.partition("="))
        if not equals:
            said.append((name, {}))
        elif not said or name in said[-1][1] or not value:
            example = "adult,wheelchair or older,free_speed=1.0"
            raise ScenarioError(f"walker must be such as {example}, not {shown(text)}", field="walker")
        else:
            said[-1][1][name] = value
    yield from said


def _walker(kind: str, changes: dict[str, str], own: Walker) -> Walker:
    if kind not in WALKERS:
        raise ScenarioError(f"walker {shown(kind)} is unknown{hint(kind, list(WALKERS))}", field="walker")
    given = {name: _value(value) for name, value in changes.items()}
    try:
        return own.changed(**given) if kind == own.kind else WALKERS[kind](**given)
    except ScenarioError as error:
        raise ScenarioError(f"walker {kind}: {error}", field=error.field) from error


def _value(text: str) -> object:
    """A field's value from text, as a scenario file would have it."""
    if text.lower() in ("true", "yes", "false", "no"):
        return text.lower() in ("true", "yes")
    try:
        return float(text)
    except ValueError:
        return text


def walker_in_words(walker: dict[str, Any]) -> str:
    """A walker's numbers, by name, for people."""
    limits = (
        (not walker["stairs"], "no stairs"),
        (not walker["lifts"], "no lifts"),
        (walker["crowd_factor"] != 1, "crowds count {crowd_factor:g} times"),
        (walker["least_width"], "at least {least_width:g} m wide"),
        (walker["highest_kerb"] is not None, "kerbs up to {highest_kerb:g} m"),
        (walker["steepest"] is not None, f"inclines up to {100 * (walker['steepest'] or 0):.3g} %"),
    )
    said = "; ".join(["{free_speed:g} m/s", *(words for applies, words in limits if applies)])
    left_out = "; {streets_left_out:,} of {streets:,} streets are left out" if walker.get("streets_left_out") else ""
    return f"{{kind}} ({said}{left_out})".format_map(walker)
