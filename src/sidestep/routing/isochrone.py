"""How far one gets in some minutes, by expected times or through simulated futures."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sidestep.network.town import Town
from sidestep.planners.base import Planner
from sidestep.routing.facts import End, SceneFacts, collection, without_map
from sidestep.routing.formats import feature, table
from sidestep.routing.located import Located
from sidestep.routing.request import RouteError, check_minutes, on_map
from sidestep.routing.trees import MINUTE, NAMES, Paths, minutes_or_none


@dataclass(frozen=True, kw_only=True)
class ReachedArea:
    """What is reached within some minutes."""

    minutes: float

    share: float | None
    """Of the futures in which every part of it is reached at least; None if crowds are as expected."""

    nodes: int
    """Number of crossings that are reached."""

    kilometres: float | None
    """Of streets that are reached; None on grids."""

    hectares: float | None
    """Size of the area; None on grids."""

    polygons: list[list[list[list[float]]]] | None
    """Of each polygon its outer ring and its holes, as lists of longitude and latitude; None on grids."""

    @property
    def called(self) -> str:
        """For people."""
        return f"{self.minutes:g} min" + ("" if self.share is None else f", in {100 * self.share:.0f} % of futures")


@dataclass(frozen=True, kw_only=True)
class Isochrone(SceneFacts):
    """How far one gets in some minutes.

    Examples
    --------
    >>> import sidestep
    >>> router = sidestep.Router(sidestep.scenario("paper-congested", side=3, crowded_nodes=1))
    >>> reach = router.isochrone(0, minutes=[5, 10, 1000])
    >>> [(area.minutes, area.nodes) for area in reach.areas][-1]
    (1000, 9)
    """

    origin: End
    planner: str
    """Name of the planner whose paths are walked."""

    futures: int | None
    """Number of simulated futures; None if crowds are as expected."""

    areas: Sequence[ReachedArea]
    """The fewest minutes first, and for each of them the larger share of the futures last."""

    arrivals: dict[str, list[float | None]]
    """Minutes to each node, by its number, ``expected`` or ``p50`` and ``p90``; None where no path leads."""

    town: Town | None = field(compare=False, repr=False)
    """For pictures; None on grids."""

    def to_json(self) -> dict[str, Any]:
        """Everything but the map, ready for ``json.dumps``."""
        return without_map(self, "town")

    def to_geojson(self) -> dict[str, Any]:
        """A GeoJSON feature collection (RFC 7946): an area for each limit, the largest first, and the origin.

        Returns
        -------
        dict
            Ready for ``json.dumps``; coordinates are longitudes and latitudes in degrees.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        on_map(self.town)
        said = {"scenario": self.scenario, "departs": self.departs, "planner": self.planner, "futures": self.futures}
        areas = []
        for area in reversed(self.areas):
            known = {name: value for name, value in vars(area).items() if name != "polygons"}
            areas.append(feature("MultiPolygon", area.polygons or [], part="area", **known, **said))
        origin = [self.origin.longitude, self.origin.latitude]
        return collection(self, [*areas, feature("Point", origin, part="origin", asked=self.origin.asked)])

    def to_text(self) -> str:
        """Sizes for people; on grids, which nodes are reached."""
        crowds = "if crowds are as expected" if self.futures is None else f"in {self.futures} simulated futures"
        if self.town is None:
            lines = table(("", ">nodes"), [(area.called, str(area.nodes)) for area in self.areas])
        else:
            rows = [
                (area.called, f"{area.kilometres:,.1f}", f"{area.hectares:,.0f}", f"{area.nodes:,}")
                for area in self.areas
            ]
            lines = table(("", ">km of streets", ">hectares", ">crossings"), rows)
        head = f"Within reach of {self.origin.asked}, departing {self.departs}, {crowds}:"
        return "\n".join([head, "", *lines, "", *self.notes()]) + "\n"


def isochrone(located: Located, planner: Planner, minutes: Sequence[float], futures: int | None) -> Isochrone:
    """Work out how far one gets.

    Parameters
    ----------
    located
        With the origin as its only end.
    planner
        ``expected`` or ``shortest-path``: whose paths are walked.
    minutes
        Minutes of walking.
    futures
        How many to simulate; None: crowds are as expected.

    Returns
    -------
    Isochrone
        An area for each of the minutes, and with futures two.

    Raises
    ------
    RouteError
        Minutes that are none, or more than the horizon (field ``minutes``); a departure so late that the crowds of
        these minutes are not known (``depart``).
    """
    most = located.scenario.horizon / MINUTE
    for each in minutes:
        check_minutes("minutes", each)
        if each > most:
            raise RouteError(f"walks are given up after {most:g} minutes; ask for fewer than {each:g}", field="minutes")
    if not minutes:
        raise RouteError("give at least one number of minutes", field="minutes")
    located.check_covered(MINUTE * max(minutes))
    paths = Paths(located, planner, futures)
    reach, limits = paths.reach(located.ends[0].node), sorted(set(minutes))
    shares = paths.shares[-2:]  # without the expected crowds where futures are asked about
    seconds = np.array([MINUTE * limit for limit in limits])
    outlines = located.outlines([reach.on_segments(share) for share in shares], seconds)
    areas = []
    for number, limit in enumerate(limits):
        for share, outline in zip(shares, outlines, strict=True):
            within = int((reach.seconds[share][: located.nodes] <= MINUTE * limit).sum())
            areas.append(ReachedArea(minutes=limit, share=share, nodes=within, **outline[number]._asdict()))
    return Isochrone(
        **vars(located.facts),
        origin=located.named_ends[0],
        planner=planner.name,
        futures=futures,
        areas=tuple(areas),
        arrivals={
            name: minutes_or_none(reach.seconds[share][: located.nodes])
            for share, name in NAMES.items()
            if share in paths.shares
        },
        town=located.town,
    )
