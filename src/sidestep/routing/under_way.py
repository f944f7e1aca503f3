"""Walks under way as plain objects: what is kept of a walk from one report to the next, and what a walker is told."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from sidestep.routing.directions import Leg, crowding_word
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import Place, RouteError

DENSE = ("dense", "jammed")
"""Words of crowds that walkers are told of."""


@dataclass(frozen=True, kw_only=True)
class Ahead:
    """A crowd that is seen on a street that leaves the crossing ahead; or on any, by the number of its segment."""

    density: float
    """Persons/m²."""

    bearing: float | None = None
    """Degrees clockwise from north, in which the street leaves the crossing."""

    segment: int | None = None
    """As in :attr:`sidestep.routing.directions.Leg.segment`."""


@dataclass(frozen=True)
class Sighting:
    """A crowd that a walker saw."""

    street: int
    """Number of the street; on grids of the pair of nodes."""

    density: float
    """Persons/m²."""

    clock: float
    """When, in s since the departure."""


@dataclass(frozen=True, kw_only=True)
class WalkUnderWay:
    """What must be known of a walk to go on with it; clocks are seconds since the departure."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    scenario: str
    """Name of the scenario."""

    origin: Place | None
    """Where the walk began, as it was asked for."""

    destination: Place | None
    """Where it ends, as it was asked for."""

    planner: str
    """Who decides."""

    futures: int
    """Number of futures that the rest of the walk is simulated in."""

    avoid: dict[str, Any] | None
    """The area to avoid, as GeoJSON."""

    crowds_at: str | float | None
    """Departure that clock 0 of the crowds is, or on grids that of the walk."""

    crowds_from: float
    """Clock 0 of the crowds."""

    begins: Place | None
    """Where the present route begins: at the origin, or where the walker was when it had left the one before."""

    rerouted: bool = False
    """Whether the walker has left a route."""

    segments: tuple[int, ...] = ()
    """The rest of the route, beginning with the segment that the walker is on."""

    along: float = 0.0
    """Metres walked on that segment."""

    nodes: tuple[int, ...] = ()
    """Nodes left before the segment that the walker is on, one after the other. Of those in the middle of streets only
    the one where the present route begins is among them."""

    remembered: tuple[float, ...] = ()
    """What the planner remembers of each of these nodes, then of those where the segments begin, as of when the walk
    leaves them; empty where it remembers nothing of nodes."""

    metres: float = 0.0
    """Metres walked along routes."""

    clock: float = 0.0
    """Of the last report."""

    sightings: tuple[Sighting, ...] = ()
    """Crowds that were seen, and are not forgotten."""

    arrived: bool = False

    arrival: float | None = None
    """When the walk arrives if crowds are as expected; None where it does not."""

    p50: float = 0.0
    """When it arrives in half of the futures; one that does not arrive counts as the horizon."""

    p90: float = 0.0
    """When it arrives in 90 % of them."""

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for ``json.dumps``."""
        return asdict(self)

    @classmethod
    def from_json(cls, state: Mapping[str, Any]) -> "WalkUnderWay":
        """Read what :meth:`to_json` gave.

        Parameters
        ----------
        state
            Also with lists where it had tuples.

        Returns
        -------
        WalkUnderWay
            The same walk.

        Raises
        ------
        RouteError
            Anything else (field ``walk``).
        """
        try:
            return _WALK.validate_python(state)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(map(str, fault["loc"]))
            raise RouteError(f"this is no walk under way: {where}: {fault['msg']}", field="walk") from error


_WALK = TypeAdapter(WalkUnderWay)


@dataclass(frozen=True, kw_only=True)
class NextTurn:
    """What to do at the next crossing."""

    turn: str
    """Such as "turn left", or "arrive"."""

    metres: float
    """From the position to the crossing."""

    node: int | None
    """Number of the crossing; None in the middle of a street."""

    latitude: float | None
    """Of the crossing, degrees; None on grids."""

    longitude: float | None
    """Of the crossing, degrees; None on grids."""

    segment: int | None
    """The segment to take; None where the walk arrives."""

    street: str
    """What people call its street."""

    bearing: float
    """In which it leaves the crossing, degrees clockwise from north."""

    bearing_before: float | None
    """In which the walker comes to the crossing; None where it stands there."""


@dataclass(frozen=True, kw_only=True)
class CrowdAhead:
    """A dense crowd on the way."""

    leg: Leg
    """The street that it is on."""

    crowding: str
    """A word for its density: "dense" or "jammed"."""

    metres: float
    """From the position to where the street begins."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What a walker is told."""

    next: NextTurn | None
    """None once the walk has arrived."""

    plan: RoutePlan | None
    """The rest of the route, from the position on; its times are minutes from now. None once the walk has arrived."""

    seconds: float
    """Until the walk arrives if crowds are as expected; the horizon where it does not."""

    p50: float
    """Seconds until it arrives in half of the futures; one that does not arrive counts as the horizon."""

    p90: float
    """The same in 90 % of them."""

    arrives: str | None
    """Local time of the arrival if crowds are as expected, ISO 8601, or in words where there is no date; None where the
    walk does not arrive."""

    changed: bool
    """Whether the route is another one than before."""

    why: str | None
    """One sentence, where it is."""

    arrived: bool

    seen: bool
    """Whether the crowd on a street from the crossing at which the walker decides next was seen lately; else all crowds
    there are those that are expected."""

    left_route: bool
    """Whether the walker was found to have left its route."""

    metres_away: float | None
    """From the position to its place on the street; None without a position."""

    @property
    def crowd_ahead(self) -> CrowdAhead | None:
        """The first dense crowd on the rest of the route; None where there is none."""
        metres = 0.0
        for leg in [] if self.plan is None else self.plan.legs:
            if (word := crowding_word(leg.density)) in DENSE:
                return CrowdAhead(leg=leg, crowding=word, metres=metres)
            metres += leg.metres
        return None

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for ``json.dumps``."""
        found = asdict(replace(self, plan=None))
        found["plan"] = None if self.plan is None else self.plan.to_json()
        return found
