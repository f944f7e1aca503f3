"""Stairs, lifts and kerbs from OpenStreetMap's file to the seconds that walkers take: a grid with one way across it."""

from pathlib import Path

import numpy as np
import pytest

from sidestep.network.formats import save_town
from sidestep.network.osm import import_osm
from sidestep.network.town import Town
from sidestep.planners.shortest_path import distances_to
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.walkers import ADULT

LATITUDE, LONGITUDE, NORTH, EAST = 60.17, 24.94, 0.0010792, 0.0021695  # degrees, and those of 120 m
UP, DOWN, UNKNOWN, LEVEL = 0.61, 0.69, 0.65, 1.34
BEGINS, ENDS = 1005, 1010


def grid_with(tags: dict[str, str]) -> str:
    """A grid of 4 x 4 crossings 120 m apart, and a way of these tags from crossing 1005 to 1010: 170 m."""
    place = {row * 4 + column: (row, column) for row in range(4) for column in range(4)} | {16: (1.5, 1.5)}
    foot = {"highway": "footway"}
    rows = [([row * 4 + column for column in range(4)], foot) for row in range(4)]
    columns = [([row * 4 + column for row in range(4)], foot) for column in range(4)]
    lines = ["<osm version='0.6'>"]
    for node, (row, column) in place.items():
        degrees = f"lat='{LATITUDE + row * NORTH:.7f}' lon='{LONGITUDE + column * EAST:.7f}'"
        lines.append(f"<node id='{node + 1000}' {degrees}/>")
    for number, (nodes, of) in enumerate([*rows, *columns, ([5, 16, 10], tags)]):
        through = "".join(f"<nd ref='{node + 1000}'/>" for node in nodes)
        said = "".join(f"<tag k='{key}' v='{value}'/>" for key, value in of.items())
        lines.append(f"<way id='{number + 1}'>{through}{said}</way>")
    return "\n".join([*lines, "</osm>"])


@pytest.fixture
def imported(tmp_path: Path):
    """The town, and the seconds that a walker takes from 1005 to 1010 and back through streets without crowds."""

    def make(walker: str = "adult", **tags: str) -> tuple[Town, float, float]:
        (tmp_path / "grid.osm").write_text(grid_with(tags))
        town, _ = import_osm(tmp_path / "grid.osm")
        save_town(town, tmp_path / "grid.npz")
        sensors = scenario("helsinki").place.crowd_source.sensors[:1]
        problem = scenario("helsinki", streets=str(tmp_path / "grid.npz"), sensors=sensors, streets_per_sensor=1)
        network = draw_map(problem.changed(walker=walker), 0).network
        pace = 1.0 if network.pace is None else np.asarray(network.pace)
        seconds = np.asarray(network.length) / (problem.changed(walker=walker).walker.free_speed * pace)
        begin, end = (int(np.flatnonzero(town.ids == number)[0]) for number in (BEGINS, ENDS))
        return town, *(float(distances_to(network, seconds, to)[origin]) for origin, to in ((begin, end), (end, begin)))

    return make


def test_stairs_are_slower_than_level_ways(imported) -> None:
    # 170 m of stairs take 279 s up and 246 s down, or 261 s; the way round 240 / 1.34 = 179 s.
    town, *seconds = imported(highway="steps", ramp="yes", incline="up", name="Test")
    assert seconds == pytest.approx([240 / LEVEL] * 2, rel=5e-3)
    _, *seconds = imported(highway="footway", name="Test")
    assert seconds == pytest.approx([170 / LEVEL] * 2, rel=5e-3)
    (stairs,) = np.flatnonzero(np.array(town.kind) == "steps")
    rise, pace = float(town.incline[stairs]), ADULT.paces(town)
    assert pace is not None
    speed = UNKNOWN if np.isnan(rise) else UP if rise > 0 else DOWN
    assert LEVEL * pace[stairs] == pytest.approx(speed, rel=1e-5)
    # Towards 1010 the stairs lead up, if the importer knows.
    assert np.isnan(rise) or (rise > 0) == (town.ids[town.tail[stairs]] == BEGINS)


@pytest.mark.parametrize(("walker", "speed"), [("older", 1.16), ("child", 0.81), ("wheelchair", 0.79), ("robot", 1.79)])
def test_who_takes_the_stairs(imported, walker: str, speed: float) -> None:
    town, *seconds = imported(walker, highway="steps")
    assert seconds == pytest.approx([240 / speed] * 2, rel=5e-3)
    assert (scenario("helsinki", walker=walker).walker.passable(town).sum() < town.streets) == (speed in (0.79, 1.79))
