"""Isochrones, matrices, crowds and departures, on grids and in a small town of which all times are known."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely

from sidestep.errors import SidestepError
from sidestep.plotting import draw_crowds, draw_departures, draw_isochrone, draw_matrix
from sidestep.routing.router import Router
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.model import WORDS
from sidestep.walking.speed_laws import FREE_SPEED

NOON = "Sat 12:30"
SMALL = scenario("rush-16", side=3, crowded_nodes=1, horizon=2 * 3600.0)


@pytest.fixture(scope="module")
def grid() -> Router:
    return Router(SMALL, seed=2)


def walk(metres: float | None) -> float | None:
    """Minutes at free speed."""
    return None if metres is None else pytest.approx(metres / FREE_SPEED / 60, rel=3e-3, abs=2e-3)


def by_stairs(level: float) -> float:
    """Minutes for the 200 m of stairs, at the mean of up and down, and some metres besides."""
    return pytest.approx((200 / 0.65 + level / FREE_SPEED) / 60, rel=3e-3)


def test_minutes_between_places(router, place) -> None:
    found = router.matrix([0, 1, 4, place(100, 0)], [0, 1, 4, 3, 6], depart=NOON)
    metres = [
        [0, 200, 300, 100, None],
        [200, 0, 100, 300, None],  # up Side Lane
        None,  # which leads up alone: the way down is by the stairs
        [100, 100, 200, 200, None],
    ]
    minutes = [
        [walk(each) for each in row] if row else [by_stairs(100), by_stairs(300), 0, by_stairs(0), None]
        for row in metres
    ]
    assert found.minutes == minutes
    assert (found.p50, found.p90, found.futures) == (None, None, None)
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["minutes"][0][4] is None
    lines = found.to_csv().splitlines()
    assert lines[0] == "origin,destination,minutes"
    assert lines[5] == "crossing 0,crossing 6,"
    assert len(lines) == 1 + 4 * 5
    assert "none" in found.to_text()
    assert draw_matrix(found).axes[0].images


def test_the_text_of_a_matrix_fits_a_terminal(router, place) -> None:
    few, many = [0, 1, place(100, 0)], [place(10 * number, 0) for number in range(1, 15)]
    for origins, destinations in ((few, None), (many, None), (few, many), (many, few)):
        found = router.matrix(origins, destinations, depart=NOON)
        text = found.to_text().split("\n", 1)[1].split("\n\nCrowds are")[0]
        assert max(map(len, text.splitlines())) <= 80
        for each in (*found.origins, *found.destinations):
            assert each.asked in text
        for row in found.minutes:
            assert all(f"{minutes:.1f}" in text for minutes in row)
    long = replace(found.origins[0], label="x" * 200)
    labelled = replace(found, origins=(long,) * 14, destinations=(long,) * 14, minutes=[[1.0] * 14] * 14)
    assert "xxxxx" in labelled.to_text()
    assert max(map(len, labelled.to_text().splitlines()[1:20])) <= 80


def test_a_matrix_agrees_with_routes(grid) -> None:
    found = grid.matrix([0, 4], [8, 1], depart=15, futures=9)
    for row, origin in enumerate((0, 4)):
        for column, destination in enumerate((8, 1)):
            plan = grid.plan(origin, destination, depart=15, futures=9)
            times = (found.minutes[row][column], found.p50[row][column], found.p90[row][column])
            assert times == pytest.approx((plan.expected_minutes, plan.median_minutes, plan.p90_minutes), abs=2e-3)
    by_length = grid.matrix([0], [8], depart=15, planner="shortest-path")
    plan = grid.plan(0, 8, depart=15, planner="shortest-path", futures=9)
    assert by_length.minutes[0][0] == pytest.approx(plan.expected_minutes, abs=2e-3)


def test_files_of_places(router, tmp_path) -> None:
    file = tmp_path / "places.csv"
    file.write_text('latitude,longitude,name\n0,0,"corner, west",more\n\n# none\n4\n')
    found = router.matrix(file, depart=NOON)
    assert [end.node for end in found.origins] == [0, 4]
    assert [end.called for end in found.destinations] == ["corner, west", "crossing 4"]
    assert '"corner, west",crossing 4,' in found.to_csv()
    file.write_text("0,,corner\n4,,\n")
    assert [end.called for end in router.matrix(file, depart=NOON).origins] == ["corner", "crossing 4"]
    assert found.minutes == [[0, walk(300)], [by_stairs(100), 0]]
    file.write_text(f"0\n1,,{'x' * 200_000}\n")
    with pytest.raises(SidestepError) as caught:
        router.matrix(file, depart=NOON)
    assert (caught.value.field, caught.value.line) == ("origins", 2)
    # No place; outside the town; no crossing of it; without its longitude.
    for wrong in ("here", "48,11,Munich", "99,,", "91,0", "60.17"):
        file.write_text(f"0\n# then\n{wrong}\n")
        with pytest.raises(SidestepError) as caught:
            router.matrix([0], file, depart=NOON)
        assert (caught.value.field, caught.value.line) == ("destinations", 3)
        assert str(caught.value).count(file.name) == 1


def test_nodes_of_files_on_a_grid(grid, tmp_path) -> None:
    file = tmp_path / "nodes.csv"
    file.write_text("4,,middle\n8\n")
    found = grid.matrix(file, [0], depart=15)
    assert [end.called for end in found.origins] == ["middle", "node 8"]
    for wrong in ("9", "0,0"):
        file.write_text(f"0\n{wrong}\n")
        with pytest.raises(SidestepError) as caught:
            grid.matrix(file, depart=15)
        assert (caught.value.field, caught.value.line) == ("origins", 2)


def area_of(polygons: list) -> shapely.Geometry:
    return shapely.MultiPolygon([(outer, holes) for outer, *holes in polygons])


def test_what_is_reached(router, place) -> None:
    reach = router.isochrone(0, minutes=[5, 1], depart=NOON)
    near, far = reach.areas
    assert [(area.minutes, area.share, area.nodes) for area in reach.areas] == [(1, None, 1), (5, None, 5)]
    assert reach.arrivals["expected"][:5] == [walk(metres) for metres in (0, 200, 300, 100, 300)]
    assert reach.arrivals["expected"][6] is None
    # up to 80.4 m along Long Street, Back Road and the footway
    assert near.kilometres == pytest.approx(3 * 0.0804, rel=0.15)
    inner, outer = area_of(near.polygons), area_of(far.polygons)
    assert inner.is_valid
    assert outer.is_valid
    assert outer.covers(inner)
    for x, y, inside in ((70, 0, inner), (0, 70, inner), (199, 0, outer), (290, 0, outer), (150, 100, outer)):
        assert inside.contains(shapely.Point(*place(x, y)[::-1]))
    for x, y, outside in ((130, 0, inner), (60, 60, inner), (150, 50, outer), (50, 300, outer)):
        assert not outside.contains(shapely.Point(*place(x, y)[::-1]))
    found = json.loads(json.dumps(reach.to_geojson(), allow_nan=False))
    assert [each["geometry"]["type"] for each in found["features"]] == ["MultiPolygon", "MultiPolygon", "Point"]
    assert [each["properties"].get("minutes") for each in found["features"]] == [5, 1, None]
    assert found["attribution"] == "© nobody & sons, ODbL 1.0"
    assert shapely.LinearRing(far.polygons[0][0]).is_ccw
    assert draw_isochrone(reach).axes


def test_what_is_reached_in_most_futures_is_reached_in_half(hours, place) -> None:
    router = Router(hours(noise=(0.5, 0.8)))
    reach = router.isochrone(place(100, 0), minutes=[2, 4], depart="Sat 12:00", futures=20)
    half, most = (np.array(reach.arrivals[name][:6], float) for name in ("p50", "p90"))
    assert (half <= most).all()
    assert (half < most).any()
    for pale, dark in (reach.areas[:2], reach.areas[2:]):
        assert (pale.share, dark.share) == (0.5, 0.9)
        assert pale.minutes == dark.minutes
        assert area_of(pale.polygons).buffer(1e-6).covers(area_of(dark.polygons))
    assert reach.to_text().count("% of futures") == 4


def test_nodes_that_are_reached_on_a_grid(grid) -> None:
    reach = grid.isochrone(4, minutes=[10_000 / 100, 1e-3], depart=15)
    assert [area.nodes for area in reach.areas] == [1, 9]
    assert reach.areas[0].polygons is None
    assert len(reach.arrivals["expected"]) == 9
    for write in (reach.to_geojson, lambda: draw_isochrone(reach)):
        with pytest.raises(SidestepError) as caught:
            write()
        assert caught.value.field == "format"


def test_an_objective_decides_the_paths(hours) -> None:
    # Long Street is so crowded at noon that the way round by Back Road takes less time, but not fewer metres.
    problem = hours()
    assert Router(problem).matrix([0], [1], depart="Sat 12:00").minutes[0][0] == walk(300)
    shortest = Router(problem.changed(objective=WORDS["distance"])).matrix([0], [1], depart="Sat 12:00")
    plan = Router(problem.changed(objective=WORDS["distance"])).plan(0, 1, depart="Sat 12:00")
    assert plan.metres == 200
    assert shortest.minutes[0][0] == pytest.approx(plan.expected_minutes, rel=1e-3)


def test_crowds_on_all_streets(router) -> None:
    crowds = router.crowds(at=NOON)
    quay = crowds.streets[5]
    assert (quay.name, quay.crowding, quay.nodes) == ("Quay", "busy", (2, 5))
    assert quay.density == pytest.approx(0.5, abs=0.01)
    assert crowds.streets[6].crowding == "free"
    found = json.loads(json.dumps(crowds.to_geojson(), allow_nan=False))
    assert len(found["features"]) == 8
    assert found["features"][5]["properties"]["crowding"] == "busy"
    assert "Quay" in crowds.to_text()
    assert draw_crowds(crowds).axes


def test_crowds_of_a_grid(grid) -> None:
    crowds = grid.crowds(at=30)
    assert len(crowds.streets) == 24
    assert json.dumps(crowds.to_json(), allow_nan=False)
    with pytest.raises(SidestepError) as caught:
        draw_crowds(crowds)
    assert caught.value.field == "format"


def test_crowds_of_a_table_by_the_hour(hours) -> None:
    router = Router(hours())
    assert router.crowds("Sat 12:30").streets[0].density == pytest.approx(4.0, rel=1e-3)
    assert router.crowds("13:30").streets[0].density < 0.01


def test_when_to_set_out(hours) -> None:
    # Long Street is slow until one o'clock.
    window = Router(hours()).when(0, 1, depart="12:30", until="13:10", step=20)
    assert [each.departs for each in window.departures] == [f"Saturday {at}" for at in ("12:30", "12:50", "13:10")]
    assert window.best.departs == "Saturday 13:10"
    assert window.best.p90_minutes == walk(200)
    assert window.departures[0].median_minutes == walk(300)  # by Back Road
    assert window.to_json()["best"]["departure_minutes"] == 40
    assert "best" in window.to_text()
    (axes,) = draw_departures(window).axes
    assert axes.lines[0].get_xdata().tolist() == [0, 20, 40]
    assert "Saturday 12:30 to 13:10" in axes.get_title(loc="left")


def test_windows_in_words(hours) -> None:
    window = Router(hours()).when(0, 1, depart="12:30", until="13:10", step=20)
    for first, last, words in (
        ("Friday 23:00", "Saturday 1:00", "Friday 23:00 to Saturday 1:00"),
        ("Saturday 2025-05-24 12:30", "Saturday 2025-05-24 13:30", "Saturday 2025-05-24 12:30 to 13:30"),
        ("0 min after the start", "120 min after the start", "0 to 120 min after the start"),
        ("as the table begins", "as the table begins", "as the table begins"),
    ):
        ends = [replace(window.departures[0], departs=each) for each in (first, last)]
        assert replace(window, departures=ends).span == words
    assert replace(window, departures=window.departures[:1]).span == "Saturday 12:30"


def test_windows_that_outlast_a_table(hours) -> None:
    router = Router(hours())  # from noon to two o'clock
    for given in ({"depart": "12:30", "until": "14:00"}, {"depart": "13:00"}):  # the last is at 15:00
        with pytest.raises(SidestepError) as caught:
            router.when(0, 1, **given)
        assert caught.value.field == "until"


def test_walks_that_outlast_the_crowds() -> None:
    router = Router(scenario("paper-congested", side=3, crowded_nodes=1))
    late = 24 * 60 - 1
    for ask, field in (
        (lambda: router.plan(0, 1, depart=late), "depart"),
        (lambda: router.when(0, 1, depart=late, until=late, futures=1), "depart"),
        (lambda: router.when(0, 1, depart=late - 300, until=late, step=300, futures=1), "until"),
        (lambda: router.isochrone(0, minutes=[0.5, 5], depart=late), "depart"),
        (lambda: router.matrix([0, 1], depart=late), "depart"),
    ):
        with pytest.raises(SidestepError) as caught:
            ask()
        assert caught.value.field == field
    assert router.isochrone(0, minutes=[0.5], depart=late).areas[0].nodes == 1


@pytest.mark.parametrize(
    ("method", "given", "field"),
    [
        ("when", {"until": 5, "depart": 10}, "until"),
        ("when", {"depart": 0, "until": 100, "step": 0.1}, "step"),
        ("when", {"step": 0}, "step"),
        ("when", {"futures": 0}, "futures"),
        ("when", {"until": "soon"}, "until"),
        ("isochrone", {"minutes": []}, "minutes"),
        ("isochrone", {"minutes": [5, -1]}, "minutes"),
        ("isochrone", {"minutes": [float("nan")]}, "minutes"),
        ("isochrone", {"minutes": [1e6]}, "minutes"),
        ("isochrone", {"origin": 9}, "origin"),
        ("isochrone", {"planner": "snapshot"}, "planner"),
        ("isochrone", {"planner": "astar"}, "planner"),
        ("isochrone", {"avoid": {"type": "Polygon"}}, "avoid"),
        ("matrix", {"origins": []}, "origins"),
        ("matrix", {"origins": [0], "destinations": [99]}, "destinations"),
        ("matrix", {"origins": ["here"]}, "origins"),
        ("matrix", {"origins": "no/such/file"}, "origins"),
        ("matrix", {"origins": [0] * 1001}, "origins"),
        ("matrix", {"origins": [0], "planner": "clairvoyant"}, "planner"),
        ("matrix", {"origins": [0], "futures": -1}, "futures"),
        ("crowds", {"at": "noon"}, "at"),
        ("crowds", {"at": 1e6}, "at"),
        ("crowds", {"live": "none.csv"}, "live"),
    ],
)
def test_what_nobody_can_ask_for(grid, method: str, given: dict, field: str) -> None:
    with pytest.raises(SidestepError) as caught:
        getattr(grid, method)(**given)
    assert caught.value.field == field
    assert "\n" not in str(caught.value)
