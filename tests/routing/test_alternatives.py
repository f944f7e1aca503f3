"""Alternatives, areas to avoid, and deadlines of routes."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from sidestep.plotting import draw_isochrone, draw_route
from sidestep.routing.alternatives import MOST_COST, MOST_SHARED
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import RouteError
from sidestep.routing.router import Router
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.model import WORDS
from sidestep.scenarios.walkers import Custom

NOON = "2025-05-24T12:30"  # a Saturday
GRID = scenario("rush-16", side=5, crowded_nodes=3, horizon=2 * 3600.0)


@pytest.fixture(scope="module")
def grid() -> Router:
    return Router(GRID, seed=2)


def streets_of(plan: RoutePlan) -> dict[tuple[int, ...], float]:
    """Metres by street of a grid; no two of its streets join the same nodes."""
    ends = zip(plan.nodes, plan.nodes[1:], strict=False)
    return {tuple(sorted(pair)): leg.metres for pair, leg in zip(ends, plan.legs, strict=True)}


def check(plan: RoutePlan, cost: str) -> None:
    """Alternatives differ enough from each better route, and are not much worse."""
    every = [plan, *plan.alternatives]
    costs = [getattr(each, cost) for each in every]
    assert costs == sorted(costs)
    assert costs[-1] <= MOST_COST * costs[0] * (1 + 1e-6)
    for better, other in combinations(every, 2):
        here, there = streets_of(other), streets_of(better)
        shared = sum(metres for street, metres in here.items() if street in there)
        assert shared <= (MOST_SHARED + 1e-6) * min(other.metres, better.metres)
    for other in plan.alternatives:
        assert (other.nodes[0], other.nodes[-1], other.arrives) == (plan.nodes[0], plan.nodes[-1], True)
        assert len(set(other.nodes)) == len(other.nodes)
        assert 0 <= other.shared <= MOST_SHARED


@pytest.mark.parametrize(("origin", "destination"), [(0, 24), (4, 20), (7, 18)])
def test_alternatives_differ_and_cost_little_more(grid, origin: int, destination: int) -> None:
    plan = grid.plan(origin, destination, depart=15, futures=9, alternatives=3)
    check(plan, "cost_minutes")
    assert len(plan.alternatives) == 3
    assert plan.alternatives[0].futures == 9
    alone = grid.plan(origin, destination, depart=15, futures=9)
    assert (plan.nodes, alone.alternatives) == (alone.nodes, ())


def test_the_planner_decides_what_costs_are(grid) -> None:
    check(grid.plan(0, 24, planner="shortest-path", depart=15, futures=9, alternatives=2), "metres")
    shy = Router(GRID.changed(objective=WORDS["exposure"]), seed=2)
    plan = shy.plan(0, 24, depart=15, futures=9, alternatives=2)
    check(plan, "cost_minutes")
    assert plan.cost_minutes != pytest.approx(plan.expected_minutes)
    assert plan.alternatives


def test_parallel_streets_are_different_streets(tiny) -> None:
    # Long Street and Side Lane, the stairs, or Back Road and Side Lane: 300, 300 and 400 m.
    router = Router(tiny.changed(walker=Custom(free_speed=1.34, stairs_up=1.34, stairs_down=1.34)))
    plan = router.plan(0, 4, depart=NOON, futures=3, alternatives=5)
    assert sorted(round(each.metres) for each in (plan, *plan.alternatives)) == [300, 300, 400]
    # Back Road alone is half as long again as Long Street.
    alone = router.plan(0, 1, depart=NOON, futures=3, alternatives=2)
    assert alone.alternatives == ()
    assert "of 2 alternatives" in alone.to_text()
    found = json.loads(json.dumps(plan.to_json(), allow_nan=False))
    assert set(found["alternatives"][0]) < set(found)
    assert [each["properties"]["part"] for each in plan.to_geojson()["features"]].count("alternative") == 2
    assert "Alternative 2, by " in plan.to_text()
    said = {text.get_text() for text in draw_route(plan).axes[0].get_legend().get_texts()}
    assert len(said) == 3


@pytest.mark.parametrize("planner", ["snapshot", "clairvoyant", "greedy-map", "random-walk"])
def test_planners_without_alternatives(grid, planner: str) -> None:
    with pytest.raises(RouteError) as caught:
        grid.plan(0, 24, planner=planner, futures=2, alternatives=1)
    assert caught.value.field == "alternatives"


def box(place, west: float, south: float, east: float, north: float) -> dict:
    corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    return {"type": "Polygon", "coordinates": [[list(place(*corner)[::-1]) for corner in corners]]}


@pytest.mark.parametrize("planner", ["expected", "shortest-path", "snapshot", "clairvoyant", "greedy-map"])
def test_streets_that_are_avoided(router, place, planner: str) -> None:
    plan = router.plan(0, 1, depart=NOON, futures=3, planner=planner, avoid=box(place, 80, -10, 120, 10))
    assert plan.metres == pytest.approx(300, abs=0.1)
    assert {leg.name for leg in plan.legs} == {"Back Road"}
    assert (plan.avoided_streets, plan.arrival_rate) == (1, 1)
    assert plan.baselines["shortest-path"].arrival_rate == 1 if planner != "shortest-path" else True
    assert "1 street crosses the area to avoid" in plan.to_text()


def test_answers_show_the_area_that_is_avoided(router, place) -> None:
    area, small = box(place, 80, -10, 120, 10), box(place, 400, 0, 410, 10)
    both = {"type": "MultiPolygon", "coordinates": [area["coordinates"], small["coordinates"]]}
    plan = router.plan(0, 1, depart=NOON, futures=3, avoid=both)
    reach = router.isochrone(0, minutes=[3], depart=NOON, avoid=both)
    for answer, draw in ((plan, draw_route), (reach, draw_isochrone)):
        (shown,) = (
            each for each in answer.to_geojson()["features"] if each["properties"] == {"part": "avoid", "streets": 1}
        )
        corners = {tuple(point) for rings in shown["geometry"]["coordinates"] for ring in rings for point in ring}
        assert corners == {tuple(point) for ring in area["coordinates"] + small["coordinates"] for point in ring}
        json.dumps(answer.to_json(), allow_nan=False)
        drawn = draw(answer).axes[0]
        (patch,) = (each for each in drawn.patches if each.get_hatch())
        assert patch.get_label() in {text.get_text() for text in drawn.get_legend().get_texts()}
    whole = router.plan(0, 1, depart=NOON, futures=3)
    assert whole.avoided_area is None
    assert draw_route(whole).axes[0].get_legend() is None


def test_squares_do_not_hide_the_map(plan) -> None:
    town = plan.streets.town
    wide = replace(town, width=np.full(town.streets, 50, np.float32))
    square = replace(wide, kind=("area",) * town.streets)
    drawn = [draw_route(replace(plan, streets=replace(plan.streets, town=each))) for each in (wide, square)]
    broad, thin = (set(figure.axes[0].collections[0].get_linewidths()) for figure in drawn)
    assert max(thin) < min(broad)


def test_other_questions_avoid_streets_too(router, place) -> None:
    avoid = box(place, 80, -10, 120, 10)
    assert router.matrix([0], [1], depart=NOON, avoid=avoid).minutes[0][0] == pytest.approx(300 / 1.34 / 60, rel=3e-3)
    assert router.isochrone(0, minutes=[3], depart=NOON, avoid=avoid).areas[0].nodes == 2
    other = router.plan(0, 4, depart=NOON, futures=3, avoid=avoid, alternatives=3)
    assert all(leg.name != "Long Street" for each in (other, *other.alternatives) for leg in each.legs)
    nothing = router.plan(0, 1, depart=NOON, futures=3, avoid=box(place, 20, 20, 30, 30))
    assert (nothing.avoided_streets, nothing.metres) == (0, 200)


@pytest.mark.parametrize(
    ("origin", "corners"),
    [
        (0, (-20, -20, 20, 20)),  # the origin
        ((100, 8), (80, -10, 120, 10)),  # a place that was asked for
        (0, (80, -90, 120, 90)),  # Long Street and Back Road
    ],
)
def test_ends_and_paths_that_are_in_the_way(router, place, origin, corners) -> None:
    with pytest.raises(RouteError) as caught:
        router.plan(origin if isinstance(origin, int) else place(*origin), 1, depart=NOON, avoid=box(place, *corners))
    assert caught.value.field == "avoid"


def test_grids_have_no_areas(grid) -> None:
    with pytest.raises(RouteError) as caught:
        grid.plan(0, 1, avoid={"type": "Polygon", "coordinates": []})
    assert caught.value.field == "avoid"


@pytest.mark.parametrize("confidence", [0.5, 0.9])
def test_the_latest_departure(grid, confidence: float) -> None:
    plan = grid.plan(0, 24, arrive_by=100, confidence=confidence, futures=9)
    departs = plan.departure_minutes
    assert departs + plan.by_minutes == pytest.approx(100)
    assert plan.arrive_by >= confidence
    assert (plan.deadline, plan.confidence) == ("100 min after the start", confidence)
    later = [grid.plan(0, 24, depart=departs + m, by=100 - departs - m, futures=9).arrive_by for m in (1, 2, 5)]
    assert max(later) < confidence
    assert "arrives by 100 min" in plan.to_text()


def test_the_latest_departure_in_a_town(router) -> None:
    # 300 m take 3.7 minutes
    plan = router.plan(0, 4, arrive_by=NOON, futures=7)
    assert (plan.departure, plan.by_minutes, plan.arrive_by) == ("2025-05-24T12:26:00", 4, 1)
    assert plan.deadline == "Saturday 2025-05-24 12:30"
    assert router.plan(0, 4, arrive_by="Sat 12:30", futures=7).departs == "Saturday 12:26"
    surely = router.plan(0, 4, arrive_by="12:30", depart="12:20", confidence=1, futures=7)
    assert (surely.departs, surely.departure) == ("Monday 12:26", None)


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"arrive_by": "12:30", "depart": "12:28"}, "arrive_by"),  # too late to be met
        ({"arrive_by": "12:30", "depart": "12:40"}, "depart"),
        ({"arrive_by": "soon"}, "arrive_by"),
        ({"arrive_by": 30}, "arrive_by"),
        ({"arrive_by": "12:30", "by": 5}, "arrive_by"),
        ({"arrive_by": NOON, "live": "none.csv"}, "live"),
        ({"arrive_by": "12:30", "confidence": 0}, "confidence"),
        ({"arrive_by": "12:30", "confidence": 1.5}, "confidence"),
        ({"confidence": float("nan")}, "confidence"),
        ({"confidence": 0.9}, "confidence"),  # of what?
        ({"confidence": 0.9, "by": 5}, "confidence"),
        ({"alternatives": -1}, "alternatives"),
    ],
)
def test_deadlines_that_cannot_be(router, given: dict, field: str) -> None:
    with pytest.raises(RouteError) as caught:
        router.plan(0, 4, **({"futures": 7} | given))
    assert caught.value.field == field
    assert "\n" not in str(caught.value)


def test_the_earliest_arrival_is_said(grid) -> None:
    with pytest.raises(RouteError, match=r"the earliest arrival is \d+ min after the start") as caught:
        grid.plan(0, 24, arrive_by=3, futures=9)
    assert caught.value.field == "arrive_by"
    earliest = int(np.array(str(caught.value).split(" min after")[-2].split()[-1]))
    assert grid.plan(0, 24, arrive_by=earliest, futures=9).departure_minutes == 0


def test_crowds_before_a_table_are_not_asked_for(hours) -> None:
    # The table begins at noon: nobody departs before.
    with pytest.raises(RouteError) as caught:
        Router(hours()).plan(0, 1, arrive_by="Sat 12:02")
    assert caught.value.field == "arrive_by"
    assert Router(hours()).plan(0, 1, arrive_by="Sat 12:20").departs == "Saturday 12:16"


@pytest.mark.parametrize("planner", ["snapshot", "greedy-map", "clairvoyant"])
def test_all_planners_meet_deadlines(planner: str) -> None:
    router = Router(scenario("rush-16", side=3, crowded_nodes=1, horizon=2 * 3600.0), seed=2)
    plan = router.plan(0, 8, arrive_by=60, planner=planner, futures=9)
    assert plan.planner == planner
    assert plan.arrive_by >= 0.9
