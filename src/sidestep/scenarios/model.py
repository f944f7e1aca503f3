"""Which problems there are, by name: streets, crowds, speed law, walks."""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from sidestep.crowds.base import SLOT_SECONDS
from sidestep.crowds.counts import TEST, TRAIN
from sidestep.environment.types import LEVELS, Information, RewardWeights
from sidestep.errors import SidestepError
from sidestep.network.grid import LENGTHS
from sidestep.walking.crossing_time import CROSSING_RULES, CrossingRule
from sidestep.walking.objective import WeightedObjective
from sidestep.walking.speed_laws import Aoki, SpeedLaw, Weidmann

Flows = Literal["arima", "forecast"]
Law = Literal["power", "power-capped", "weidmann"]
LAWS: dict[str, SpeedLaw] = {"power": Aoki(capped=False), "power-capped": Aoki(capped=True), "weidmann": Weidmann()}


class ScenarioError(SidestepError):
    """A scenario that is unknown or cannot be: says what is wrong."""


@dataclass(frozen=True)
class RushHours:
    """How crowds come and go, street by street (:class:`sidestep.crowds.rush.RushFlow`)."""

    amplitude: tuple[float, float] = (0.2, 0.8)  # of the logarithm of volume, uniform per street
    period: float = 240 * 60.0  # s
    memory: float = 0.9  # of the noise, from slot to slot
    deviation: float = 0.4  # of the logarithm
    shifting: bool = False  # crowded nodes are drawn anew for every walk

    def __post_init__(self) -> None:
        low, high = self.amplitude
        if not (0 <= low <= high < math.inf and 0 < self.period < math.inf):
            raise ScenarioError(
                f"rush hours need amplitudes in order and a positive period, not {low}, {high} and {self.period}"
            )
        if not (0 <= self.memory < 1 and 0 <= self.deviation < math.inf):
            raise ScenarioError(
                f"noise needs a memory from 0 to below 1 and a deviation, not {self.memory} and {self.deviation}"
            )


DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")


@dataclass(frozen=True)
class Sensor:
    """Where something is counted."""

    name: str  # as in the table of counts
    place: tuple[float, float] | None = None  # latitude and longitude in degrees; None pairs it with some street


@dataclass(frozen=True)
class Light:
    """A traffic light whose timing is known."""

    name: str
    place: tuple[float, float]  # latitude and longitude in degrees; it stands on the street that is nearest
    cycle: float  # s from one green to the next
    green: float  # s of each cycle in which walkers may go
    offset: float  # s after those of offset 0 at which it turns green

    def __post_init__(self) -> None:
        _check_timing(self.cycle, self.green)
        if not 0 <= self.offset < self.cycle:
            raise ScenarioError(f"offset must be seconds of the {self.cycle:g} of a cycle, not {self.offset:g}")


def _check_timing(cycle: float, green: float) -> None:
    if not 0 < cycle <= LONGEST_CYCLE:
        raise ScenarioError(f"cycle must be seconds above 0 and up to {LONGEST_CYCLE:g}, not {cycle:g}")
    if not 0 < green <= cycle:
        raise ScenarioError(f"green must be seconds of the {cycle:g} of a cycle, not {green:g}")


@dataclass(frozen=True)
class Traffic:
    """Vehicles that walkers wait for (:class:`sidestep.walking.waits.Waits`), wherever a street crosses traffic.

    OpenStreetMap knows where there are lights, but not how they are timed.
    """

    cycle: float = 90.0  # s from one green to the next, of all lights but those that are known
    green: float = 30.0  # s of each cycle in which walkers may go
    seed: int = 0  # draws the offset of each light: when in the cycle it turns green
    vehicles: float = 500.0  # an hour on each street crossed without lights, in the busiest hour of the day
    critical_gap: float = 8.0  # s between two vehicles in which walkers cross
    lights: tuple[Light, ...] = ()  # those whose timing is known

    def __post_init__(self) -> None:
        _check_timing(self.cycle, self.green)
        if self.seed < 0:
            raise ScenarioError(f"seed must be 0 or more, not {self.seed}")
        if not 0 < self.critical_gap <= LONGEST_GAP:
            raise ScenarioError(
                f"critical_gap must be seconds above 0 and up to {LONGEST_GAP:g}, not {self.critical_gap:g}"
            )
        most = MOST_IN_GAP * 3600 / self.critical_gap
        if not 0 <= self.vehicles <= most:
            raise ScenarioError(
                f"vehicles must be between 0 and {most:,.0f} an hour, {MOST_IN_GAP} in each gap of "
                f"{self.critical_gap:g} s, not {self.vehicles:g}"
            )


LONGEST_CYCLE, LONGEST_GAP = 600.0, 20.0  # s
MOST_IN_GAP = 4  # vehicles; the mean wait grows exponentially with it, and would soon break FIFO
MOST_WEIGHT = 100.0  # of anything in an objective; sums of larger ones are lost in single precision

Place = int | tuple[float, float]
"""A crossing: its number, or latitude and longitude in degrees of a place near it."""


@dataclass(frozen=True)
class Venue:
    """A real place: streets from a map, crowds from counts (:class:`sidestep.crowds.sensors.SensorFlow`)."""

    streets: str = "helsinki"  # the town that comes with the package, or a file
    counts: str = "auckland"  # the counts that come with the package, or a file; .npz is a table of crowds
    sensors: tuple[Sensor, ...] = ()  # by default all that were counted, without places
    pairing: int = 0  # seed that pairs sensors without a place with streets
    places: int = 1  # streets that each sensor without a place is paired with, each with weeks of its own
    crowding: float = 1.0  # demand over that which was counted
    uneven: float = 0.0  # standard deviation of the logarithm of demand from place to place, drawn for every future
    reach: float = 150.0  # m along the streets in which the crowd at a sensor falls to 1/e
    days: tuple[int, ...] = (0, 1, 2, 3, 4, 5, 6)  # on which people walk; 0 is Monday
    hours: tuple[int, int] = (10, 20)  # between which they set out
    fitted: tuple[str, str] = TRAIN  # first day or hour that crowds are fitted to, and the one past the last
    tested: tuple[str, str] = TEST  # the same of the weeks that walks are tested in
    noise: tuple[float, float] = (0.9, 0.0)  # of a table's crowds: memory from slot to slot, deviation of the logarithm
    origins: tuple[Place, ...] = ()  # where walks begin; by default at any crossing
    destinations: tuple[Place, ...] = ()  # where they end
    traffic: Traffic | None = None  # that walkers wait for; None: they never do

    def __post_init__(self) -> None:
        self._check_source()
        self._check_periods()
        for name in ("crowding", "reach"):
            if not 0 < getattr(self, name) < math.inf:
                raise ScenarioError(f"{name} must be a positive number, not {getattr(self, name)}")
        if not 0 <= self.uneven < math.inf:
            raise ScenarioError(f"uneven must be a deviation of 0 or more, not {self.uneven}")
        if not self.days or not set(self.days) <= set(range(7)):
            raise ScenarioError(f"days must be some of 0 (Monday) to 6 (Sunday), not {', '.join(map(str, self.days))}")
        first, last = self.hours
        if not 0 <= first < last <= 24:
            raise ScenarioError(f"hours must be two of 0 to 24 in order, not {first} and {last}")
        if self.pairing < 0:
            raise ScenarioError(f"pairing must be a seed of 0 or more, not {self.pairing}")
        names = [sensor.name for sensor in self.sensors]
        if len(set(names)) < len(names):
            raise ScenarioError(f"a sensor stands in the list twice: {max(names, key=names.count)!r}")
        for name in ("origins", "destinations"):
            _check_places(name, getattr(self, name))

    def _check_periods(self) -> None:
        try:
            periods = [[np.datetime64(time, "h") for time in period] for period in (self.fitted, self.tested)]
        except ValueError as error:
            raise ScenarioError(f"fitted and tested must be days such as 2025-03-10: {error}") from error
        if max(begin for begin, _ in periods) < min(end for _, end in periods):
            both = (" to ".join(period) for period in (self.tested, self.fitted))
            raise ScenarioError(f"tested must not overlap fitted, but {' and '.join(both)} do")

    def _check_source(self) -> None:
        memory, deviation = self.noise
        if not (0 <= memory < 1 and 0 <= deviation < math.inf):
            raise ScenarioError(f"noise needs a memory from 0 to below 1 and a deviation, not {memory} and {deviation}")
        if self.places < 1:
            raise ScenarioError(f"places must be a number of streets, 1 or more, not {self.places}")
        of_sensors = ("sensors", "pairing", "places", "uneven", "reach", "fitted", "tested")
        of_others = of_sensors if self.tabled else ("noise",)
        for name in of_others:
            if getattr(self, name) != getattr(type(self), name):
                kind = "a table of crowds" if self.tabled else "counts of sensors"
                raise ScenarioError(f"{name} means nothing to {kind}, {self.counts}")

    @property
    def files(self) -> tuple[str, ...]:
        """Where its streets and counts come from; what comes with the package is no file."""
        return self.streets, self.counts

    @property
    def tabled(self) -> bool:
        """Whether crowds come from a table of all segments, not from sensors."""
        return self.counts.lower().endswith(".npz")

    def departure_hours(self, number: int, first: int = 0) -> list[float]:
        """Hours of the week, 0 is Monday 0:00, spread evenly over those in which people set out.

        Minutes are spread by the golden ratio; by that same number each weekday would have minutes of its own.
        """
        every = [24.0 * day + hour for day in sorted(set(self.days)) for hour in range(*self.hours)]
        return [every[int(len(every) * (turn * ROOT_3 % 1))] for turn in range(first, first + number)]


def _check_places(name: str, places: tuple[Place, ...]) -> None:
    for place in places:
        if isinstance(place, int):
            if place < 0:
                raise ScenarioError(f"{name} must be crossings, numbered from 0, not {place}")
        elif not (abs(place[0]) <= 90 and abs(place[1]) <= 180):
            raise ScenarioError(
                f"{name} must be degrees of latitude (-90 to 90), then of longitude, not {place[0]:g}, {place[1]:g}"
            )
    if len(set(places)) < len(places):
        raise ScenarioError(f"{name} must all be different, but {max(places, key=places.count)} is there twice")


ROOT_3 = math.sqrt(3)  # with multiples of both, pairs fill a square evenly


@dataclass(frozen=True)
class Scenario:
    """A whole problem. The defaults are the paper's (section V-A), or stand for what it leaves open."""

    name: str
    summary: str
    side: int = 6  # nodes along one side of the grid
    lengths: tuple[float, float] = LENGTHS  # m, uniform per street
    volumes: tuple[float, float] = (200.0, 1000.0)  # persons at clock 0, uniform per segment
    crowded_nodes: int = 0  # the paper: "several"; origin and destination are never among them
    crowded_volume: tuple[float, float] = (5000.0, math.sqrt(1000.0))  # mean and standard deviation, persons
    flows: Flows = "arima"  # with the model's noise, or its forecast only
    slot_seconds: float = SLOT_SECONDS
    horizon: float = 24 * 3600.0  # s; a walk that has not arrived counts as this
    law: Law = "power"  # literal: above free speed where there is less than a person per m²
    rule: CrossingRule = "integrated"
    reward: RewardWeights = field(default_factory=RewardWeights)
    objective: WeightedObjective | None = None  # what walkers keep low; None: time
    rush: RushHours | None = None  # instead of the ARIMA model
    venue: Venue | None = None  # instead of a grid and its crowds
    departures: tuple[float, float] = (0.0, 0.0)  # s, earliest and latest
    larger: tuple[int, ...] = ()  # sides of further maps: map number i has the i-th, in turn
    training_maps: int = 0  # other maps to learn on; 0 learns the map itself
    level: Information = "position"  # of the agents that learn it, unless told otherwise
    maps: int = 10  # of a comparison, unless told otherwise
    walks: int = 20  # on each of them

    def __post_init__(self) -> None:
        if self.side < 2:
            raise ScenarioError(f"side must be at least 2 nodes, not {self.side}")
        if not 0 <= self.crowded_nodes <= self.side**2 - 2:
            raise ScenarioError(
                f"crowded nodes must be between 0 and {self.side**2 - 2} on a grid of {self.side} x {self.side}, "
                f"not {self.crowded_nodes}"
            )
        for name, allowed in (
            ("flows", get_args(Flows)),
            ("law", tuple(LAWS)),
            ("rule", CROSSING_RULES),
            ("level", LEVELS),
        ):
            if getattr(self, name) not in allowed:
                raise ScenarioError(f"{name} must be one of {', '.join(allowed)}, not {getattr(self, name)!r}")
        for name, (low, high) in (("lengths", self.lengths), ("volumes", self.volumes)):
            if not (0 < low <= high < math.inf):
                raise ScenarioError(f"{name} must be two positive numbers in order, not {low} and {high}")
        mean, deviation = self.crowded_volume
        if not (0 < mean < math.inf and 0 <= deviation < math.inf):
            raise ScenarioError(f"crowded_volume must be a positive mean and a deviation, not {mean} and {deviation}")
        self._check_walks()
        self._check_venue()
        self._check_objective()
        for name in ("slot_seconds", "horizon"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ScenarioError(f"{name} must be a positive number of seconds, not {getattr(self, name)}")

    def _check_walks(self) -> None:
        earliest, latest = self.departures
        if not 0 <= earliest <= latest < math.inf:
            raise ScenarioError(f"departures must be two times in order, not {earliest} and {latest}")
        if min((self.maps, self.walks, *self.sides)) < 1 or self.training_maps < 0:
            raise ScenarioError("numbers of maps and walks and sides of larger maps must be positive")
        if self.larger and not self.training_maps:
            raise ScenarioError("maps of several sizes need maps of one size to train on: training_maps")

    def _check_venue(self) -> None:
        if self.venue is not None and self.law == "power":
            raise ScenarioError(
                "the law power has no speed where nobody walks, as in parts of a venue; power-capped has one"
            )

    def _check_objective(self) -> None:
        wanted = self.objective
        if wanted is None:
            return
        for name in ("time", "distance", "exposure"):
            if not 0 <= getattr(wanted, name) <= MOST_WEIGHT:
                raise ScenarioError(
                    f"{name} must have a weight between 0 and {MOST_WEIGHT:g}, not {getattr(wanted, name):g}"
                )
        if not wanted.time and not wanted.distance:
            raise ScenarioError("time or distance needs a weight: by exposure alone all empty ways are the same")
        if wanted.max_density is not None and not 0 < wanted.max_density < math.inf:
            raise ScenarioError(f"max_density must be a positive number of persons/m², not {wanted.max_density}")

    @property
    def place(self) -> "Venue | Scenario":
        """Where it plays."""
        return self.venue or self

    def departure_hours(self, number: int, _first: int = 0) -> list[float]:
        """Hours of the week at which people set out; grids know none."""
        return [0.0] * number

    @property
    def crowd_model(self) -> str:
        """What moves the crowds: the model of the counts, rush hours, sensors or a table; or a forecast of these."""
        if self.flows == "forecast":
            return self.flows
        if self.venue is not None:
            return "table" if self.venue.tabled else "sensors"
        return "arima" if self.rush is None else "rush"

    @property
    def sensed(self) -> bool:
        """Whether crowds are known from sensors: walkers then see more, and agents are trained for that."""
        return self.venue is not None and not self.venue.tabled

    @property
    def files(self) -> tuple[str, ...]:
        """Those that its streets and crowds come from."""
        return self.venue.files if self.venue else ()

    @property
    def origin(self) -> int:
        """Where walks on a map of the first size begin: the lower left corner."""
        return 0

    @property
    def destination(self) -> int:
        """Where they end: the upper right corner."""
        return self.side**2 - 1

    @property
    def sides(self) -> tuple[int, ...]:
        """Sides of the maps, in turn."""
        return (self.side, *self.larger)

    @property
    def slots(self) -> int:
        """Slots from the scenario's start to the horizon of the latest departure."""
        return math.ceil((self.departures[1] + self.horizon) / self.slot_seconds)
