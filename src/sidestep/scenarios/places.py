"""Where people walk, as plain values: grids, which are drawn from a seed, and venues, which are real places."""

import math
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from sidestep.crowds.count_files import positions_path
from sidestep.crowds.counts import TEST, TRAIN
from sidestep.crowds.layouts import Layout
from sidestep.network.grid import LENGTHS
from sidestep.scenarios import values
from sidestep.scenarios.spec import Spec

MOST_CYCLE, MOST_GAP = 600.0, 20.0  # s
MOST_IN_GAP = 4  # vehicles; the mean wait grows exponentially with it, and would soon break FIFO
ROOT_3 = math.sqrt(3)  # with multiples of it and of the golden ratio, pairs fill a square evenly


class RushHours(Spec):
    """Crowds of a grid that come and go, street by street (:class:`sidestep.crowds.rush.RushFlow`)."""

    amplitude: values.Range = (0.2, 0.8)
    """Lowest and highest amplitude of a street's wave in the logarithm of volume, drawn uniformly."""
    period: values.Positive = 240 * 60.0
    """Seconds from one rush hour to the next."""
    phi: values.Phi = 0.9
    """Coefficient of the AR(1) noise, from slot to slot."""
    sigma: values.NonNegative = 0.4
    """Standard deviation of the noise in the logarithm of volume."""
    shifting: bool = False
    """Whether the crowded nodes are drawn anew for every future."""


class Grid(Spec):
    """A square grid of streets, and crowds on them, both drawn from a seed. The defaults are the paper's."""

    kind: Literal["grid"] = "grid"
    side: values.Side = 6
    """Nodes along one side."""
    lengths: values.PositiveRange = LENGTHS
    """Shortest and longest street in metres, drawn uniformly."""
    volumes: values.PositiveRange = (200.0, 1000.0)
    """Fewest and most persons on a segment at clock 0, drawn uniformly."""
    crowded_nodes: Annotated[int, Field(ge=0)] = 0
    """Nodes all of whose segments are crowded (the paper: "several"); never the first or the last one."""
    crowded_volume: tuple[values.Positive, values.NonNegative] = (5000.0, math.sqrt(1000.0))
    """Mean and standard deviation of the persons on a crowded segment."""
    rush: RushHours | None = None
    """How crowds come and go; by default they follow the paper's ARIMA model."""
    training_maps: Annotated[int, Field(ge=0)] = 0
    """Other maps of this side to learn on; 0 learns the map itself."""
    larger: tuple[values.Side, ...] = ()
    """Sides of further maps: maps take ``side`` and these in turn."""

    called: ClassVar[str] = "a grid"
    # Where a venue answers otherwise.
    streets: ClassVar[str] = ""
    files: ClassVar[tuple[str, ...]] = ()
    origins: ClassVar[tuple[values.Waypoint, ...]] = ()
    destinations: ClassVar[tuple[values.Waypoint, ...]] = ()
    anywhere: ClassVar[bool] = False
    interpolated: ClassVar[bool] = False
    certain: ClassVar[bool] = False
    attribution: ClassVar[str] = ""
    synthetic: ClassVar[str] = "streets and crowds drawn from a seed"

    _spare_two = values.across(
        "crowded_nodes",
        lambda crowded, grid: crowded <= grid["side"] ** 2 - 2,
        "must leave two nodes of the grid uncrowded",
    )
    _elsewhere = values.across(
        "larger",
        lambda sides, grid: not sides or grid["training_maps"],
        "must have training_maps to learn on, which have one size",
    )

    @property
    def nodes(self) -> int:
        """Nodes of the first map."""
        return self.side**2

    @property
    def across(self) -> float:
        """Metres from corner to corner along streets of mean length, on the first map."""
        return (self.side - 1) * sum(self.lengths)

    @property
    def sides(self) -> tuple[int, ...]:
        """Sides of the maps, in turn."""
        return (self.side, *self.larger)

    @property
    def crowd_model(self) -> str:
        """The model that moves the crowds."""
        return "arima" if self.rush is None else "rush"

    def departure_hours(self, number: int, first: int = 0) -> list[float]:
        """Hours of the week at clock 0, of which crowds of grids know nothing."""
        return [0.0 for _ in range(first, first + number)]


class Sensor(Spec):
    """A place where people are counted."""

    name: str
    """As in the table of counts."""
    place: values.Degrees | None = None
    """Latitude and longitude in degrees; without them it is paired with a street drawn from a seed."""


_distinct_names = values.rule(lambda found: len({one.name for one in found}) == len(found), "must have different names")


class CountColumns(Spec):
    """Columns of a file of counts that are not recognised (:class:`sidestep.crowds.layouts.Layout`)."""

    time: values.Remark = ""
    """Dates with times; or ``date`` and ``hour``."""
    date: values.Remark = ""
    hour: values.Remark = ""
    sensor: values.Remark = ""
    """Names of sensors, in a table with a row for each sensor and time."""
    count: tuple[values.Line, ...] = ()
    """Counts; several columns are summed."""
    direction: values.Remark = ""
    """What tells a sensor's rows of one time apart; they are summed."""
    ignore: tuple[values.Line, ...] = ()
    """Columns without a meaning here."""
    latitude: values.Remark = ""
    """Latitudes of the sensors, in degrees; beside ``longitude``."""
    longitude: values.Remark = ""


class Counters(Spec):
    """Crowds known from counts at sensors (:class:`sidestep.crowds.sensors.SensorFlow`)."""

    kind: Literal["counters"] = "counters"
    file: values.Line = "auckland"
    """The counts that come with the package, or a file of them."""
    columns: CountColumns = CountColumns()
    """Columns of the file that are not recognised."""
    date_format: values.Remark = ""
    """``day-first``, ``month-first`` or a format such as ``%d/%m/%y %H:%M``; by default as the dates tell."""
    decimal: Literal["", ".", ","] = ""
    """Mark before decimals; by default as the numbers tell."""
    sensors: Annotated[tuple[Sensor, ...], _distinct_names] = ()
    """Those to use; by default all that were counted, without places."""
    pairing: values.Seed = 0
    """Seed that draws a street for each sensor without a place."""
    streets_per_sensor: Annotated[int, Field(ge=1, le=100)] = 1
    """Streets that each sensor without a place is paired with; on each of them it has weeks of its own."""
    uneven: values.NonNegative = 0.0
    """Standard deviation of the logarithm of demand from sensor to sensor, drawn anew for every future."""
    reach: values.Positive = 150.0
    """Metres along the streets in which the crowd at a sensor falls to 1/e."""
    fitted: values.Period = TRAIN
    """Days that expected crowds are fitted to."""
    tested: values.Period = TEST
    """Days that walks are tested in."""

    interpolated: ClassVar[bool] = True
    certain: ClassVar[bool] = False
    crowd_model: ClassVar[str] = "sensors"
    demand: ClassVar[str] = "the counts"

    _one_place = values.across(
        "streets_per_sensor",
        lambda streets, given: streets == 1 or all(sensor.place is None for sensor in given["sensors"]),
        "must be 1 where sensors have places of their own",
    )
    _not_fitted = values.across(
        "tested",
        lambda tested, given: max(tested[0], given["fitted"][0]) >= min(tested[1], given["fitted"][1]),
        "must not overlap fitted",
    )

    def layout(self, timezone: str | None) -> Layout:
        """What is said of the file, which is of a place in a timezone."""
        columns = self.columns.model_dump()
        return Layout(**columns, date_format=self.date_format, decimal=self.decimal, timezone=timezone)

    @property
    def files(self) -> tuple[str, ...]:
        """The counts, and where their sensors stand."""
        return () if self.file == "auckland" else (self.file, str(positions_path(Path(self.file))))

    @property
    def attribution(self) -> str:
        """Whose counts they are."""
        known = {"auckland": "Auckland's counts (Heart of the City Auckland, CC BY 4.0)"}
        return known.get(self.file, f"counts of {Path(self.file).name}")

    @property
    def synthetic(self) -> str:
        """What is invented about them; "" where nothing is."""
        paired = not self.sensors or any(sensor.place is None for sensor in self.sensors)
        return "sensors paired with streets by a seed" if paired else ""


class CrowdTable(Spec):
    """Crowds known from a table of all segments (:class:`sidestep.crowds.table_flow.TableFlow`)."""

    kind: Literal["crowd_table"] = "crowd_table"
    file: values.Line
    """A table made by ``sidestep counts import``, .npz."""
    noise: tuple[values.Phi, values.NonNegative] = (0.9, 0.0)
    """AR(1) noise around the table, in the logarithm of volume: coefficient from slot to slot, standard deviation."""

    interpolated: ClassVar[bool] = False
    crowd_model: ClassVar[str] = "table"
    demand: ClassVar[str] = "the table"
    synthetic: ClassVar[str] = ""

    def layout(self, timezone: str | None) -> Layout:
        """What is said of files of counts, of which this is none."""
        return Layout(timezone=timezone)

    @property
    def certain(self) -> bool:
        """Whether all futures are alike."""
        return self.noise[1] == 0

    @property
    def files(self) -> tuple[str, ...]:
        """The table."""
        return (self.file,)

    @property
    def attribution(self) -> str:
        """Whose crowds they are."""
        return f"table {Path(self.file).name}"


_Cycle = Annotated[float, Field(gt=0, le=MOST_CYCLE)]


class _Timing(Spec):
    """When a traffic light is green."""

    cycle: _Cycle
    """Seconds from one green to the next."""
    green: values.Positive
    """Seconds of each cycle in which people may walk."""

    _within = values.across("green", lambda green, given: green <= given["cycle"], "must be at most one cycle")


class Light(_Timing):
    """A traffic light whose timing is known."""

    name: str
    place: values.Degrees
    """Latitude and longitude in degrees; the light stands on the nearest street."""
    offset: values.NonNegative
    """Seconds after lights of offset 0 at which it turns green."""

    _before_next = values.across("offset", lambda offset, given: offset < given["cycle"], "must be less than one cycle")


class Traffic(_Timing):
    """Vehicles that walkers wait for (:class:`sidestep.walking.waits.Waits`), where a street crosses traffic.

    OpenStreetMap knows where there are lights, but not how they are timed; ``cycle`` and ``green`` hold for all lights
    whose timing is not known.
    """

    cycle: _Cycle = 90.0
    green: values.Positive = 30.0
    seed: values.Seed = 0
    """Draws the offset of each light: when in the cycle it turns green."""
    critical_gap: Annotated[float, Field(gt=0, le=MOST_GAP)] = 8.0
    """Seconds between two vehicles in which walkers cross."""
    vehicles: values.NonNegative = 500.0
    """Vehicles an hour on each street that is crossed without lights, in the busiest hour of the day."""
    lights: tuple[Light, ...] = ()
    """Those whose timing is known."""

    _gaps = values.across(
        "vehicles",
        lambda vehicles, given: vehicles * given["critical_gap"] <= MOST_IN_GAP * 3600,
        f"must come to at most {MOST_IN_GAP} in each critical_gap",
    )


class Venue(Spec):
    """A real place: streets from a map, crowds from counts or a table."""

    kind: Literal["venue"] = "venue"
    streets: values.Line = "helsinki"
    """The town that comes with the package, or a file of streets."""
    timezone: values.Timezone | None = None
    """What departures with a UTC offset are turned into, and whose clock changes counts have; None: not known."""
    crowd_source: Annotated[Counters | CrowdTable, Field(discriminator="kind")] = Counters()
    """What is known of the crowds."""
    crowding: values.Positive = 1.0
    """Demand over the counts or the table."""
    days: values.Days = (0, 1, 2, 3, 4, 5, 6)
    """On which people walk; 0 is Monday."""
    hours: values.Hours = (10, 20)
    """Hours of the day between which people set out."""
    origins: values.Waypoints = ()
    """Where walks begin; by default at any crossing."""
    destinations: values.Waypoints = ()
    """Where walks end; by default at any crossing."""
    traffic: Traffic | None = None
    """Vehicles that walkers wait for; by default they never wait."""

    inner: ClassVar[str] = "crowd_source"
    called: ClassVar[str] = "a real place"
    anywhere: ClassVar[bool] = True
    training_maps: ClassVar[int] = 0
    nodes: ClassVar[int] = 0  # only its streets know
    across: ClassVar[float] = math.inf  # futures reach as far as walks

    @property
    def files(self) -> tuple[str, ...]:
        """Where streets and crowds come from; those that come with the package are no files."""
        return (*(() if self.streets == "helsinki" else (self.streets,)), *self.crowd_source.files)

    @property
    def crowd_model(self) -> str:
        """The model that moves the crowds."""
        return self.crowd_source.crowd_model

    @property
    def interpolated(self) -> bool:
        """Whether crowds are known from counters: walkers then see more, and agents are trained for that."""
        return self.crowd_source.interpolated

    @property
    def certain(self) -> bool:
        """Whether all futures are alike."""
        return self.crowd_source.certain and self.traffic is None

    @property
    def attribution(self) -> str:
        """Whose crowds they are."""
        return self.crowd_source.attribution

    @property
    def synthetic(self) -> str:
        """What is invented about streets and crowds; "" where nothing is."""
        demand = f"demand {self.crowding:g} × {self.crowd_source.demand} (an invented event day)"
        said = (
            self.crowd_source.synthetic,
            "" if self.crowding == 1 else demand,
            "" if self.traffic is None else "offsets of traffic lights drawn from a seed",
        )
        return "; ".join(filter(None, said))

    @property
    def layout(self) -> Layout:
        """What is said of the place's files of counts, current ones as well."""
        return self.crowd_source.layout(self.timezone)

    @property
    def every_hour(self) -> list[int]:
        """Hours of the week in which people set out; 0 is Monday 0:00."""
        return [24 * day + hour for day in sorted(self.days) for hour in range(*self.hours)]

    def departure_hours(self, number: int, first: int = 0) -> list[float]:
        """Hours of the week, 0 is Monday 0:00, spread evenly over those in which people set out.

        Minutes are spread by the golden ratio; by that same number each weekday would have minutes of its own.

        Returns
        -------
        list[float]
            Hours for walks number ``first`` and after.
        """
        every = self.every_hour
        return [float(every[int(len(every) * (turn * ROOT_3 % 1))]) for turn in range(first, first + number)]


Place = Grid | Venue
