"""Plans as JSON, text, GeoJSON and GPX, and as pictures."""

import json
import re
from dataclasses import replace
from datetime import datetime
from xml.etree import ElementTree as ET

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.network.geodesy import metres_between
from sidestep.plotting import draw_route
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import RouteError
from sidestep.routing.router import Router
from sidestep.scenarios.builtin import scenario
from sidestep.walking.speed_laws import FREE_SPEED, Weidmann

NOON = "2025-05-24T12:30"  # a Saturday
DEGREE = 111_195.08  # m, on the equator in both directions


@pytest.fixture(scope="module")
def grid() -> RoutePlan:
    problem = scenario("rush-16", side=3, crowded_nodes=1, horizon=2 * 3600.0)
    return Router(problem, seed=2).plan(0, 8, depart=15, futures=9, by=60.0)


def test_json_of_a_town(plan) -> None:
    found = plan.to_json()
    quay = 50 / float(Weidmann().speed(jnp.float32(0.5))) / 60
    free = 250 / FREE_SPEED / 60
    assert [(step["turn"], step["street"], step["crowding"], step["first_leg"]) for step in found["steps"]] == [
        ("head east", "Long Street", "free", 0),
        ("turn right", "Quay", "busy", 2),
    ]
    assert [step["metres"] for step in found["steps"]] == pytest.approx([250, 50], abs=0.1)
    assert [step["minutes"] for step in found["steps"]] == pytest.approx([free, quay], rel=2e-3)
    assert [step["density"] for step in found["steps"]] == pytest.approx([0, 0.5], abs=0.01)
    # the partial streets are legs of their own, in between whole ones
    assert [leg["metres"] for leg in found["legs"]] == pytest.approx([150, 100, 50], abs=0.1)
    assert [(leg["street"], leg["name"], leg["kind"]) for leg in found["legs"]] == [
        (0, "Long Street", "footway"),
        (1, "Long Street", "footway"),
        (5, "Quay", "pedestrian"),
    ]
    assert sum(leg["minutes"] for leg in found["legs"]) == pytest.approx(found["expected_minutes"])
    assert found["minutes"][-1] == pytest.approx(found["expected_minutes"])
    assert found["metres"] == pytest.approx(300, abs=0.1)
    assert found["mean_density"] == pytest.approx(0.5 * quay / (free + quay), abs=0.01)
    assert (found["arrives"], found["arrival_rate"], found["arrive_by"], found["futures"]) == (True, 1, 1, 7)
    assert (found["by_minutes"], found["planner"], found["level"], found["objective"]) == (10, "expected", "map", None)
    # counts hardly vary, so every future is as expected
    for minutes in ("median_minutes", "p90_minutes"):
        assert found[minutes] == pytest.approx(found["expected_minutes"], rel=1e-4)
    assert (found["departs"], found["hour_of_week"]) == ("Saturday 2025-05-24 12:30", 5 * 24 + 12.5)
    assert found["origin"]["metres_away"] == pytest.approx(4, abs=0.01)
    assert (found["crowds"], found["synthetic"]) == ("counts of counts.csv", "")
    assert json.loads(json.dumps(found, allow_nan=False))["nodes"] == [None, 1, 2, None]


def test_grids_have_the_same_keys_as_towns(grid, plan) -> None:
    found = grid.to_json()
    assert found.keys() == plan.to_json().keys()
    assert found["legs"][0].keys() == plan.to_json()["legs"][0].keys()
    for key in ("departure", "hour_of_week", "steps", "sensors", "counted_sensors", "objective"):
        assert found[key] is None
    for key in ("street", "name", "kind", "coordinates"):
        assert found["legs"][0][key] is None
    assert (found["origin"]["node"], found["origin"]["latitude"], found["departure_minutes"]) == (0, None, 15)
    assert found["synthetic"]
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("output", [RoutePlan.to_geojson, RoutePlan.to_gpx, draw_route])
def test_grids_have_no_coordinates(grid, output) -> None:
    with pytest.raises(RouteError) as caught:
        output(grid)
    assert caught.value.field == "format"


def test_text_of_a_town(plan) -> None:
    text = plan.to_text()
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert lines[0] == "expected (map), departing Saturday 2025-05-24 12:30, if crowds are as expected:"
    assert re.match(r"0.0000\d,0.0004\d is 4 m from the street", lines[1])
    for line in (
        "street metres minutes crowds persons/m²",
        "head east Long Street 250 3.1 free 0.00",
        "turn right Quay 50 0.6 busy 0.50",
        "arrive",
        "In 7 simulated futures: median 3.8 min, 90 % within 3.8 min, 100.0 % arrive",
        "Arrives within 10 min with probability 1.00",
        "Crowds are those that are expected at this hour of the week, whatever the date.",
        "Streets: © nobody & sons, ODbL 1.0. Crowds: counts of counts.csv.",
    ):
        assert line in lines
    for part in (
        "300 m, 3.8 min; crowds on the way: free, 0.09 persons/m²",
        "shortest-path in the same futures: median 3.8 min",
        "snapshot in the same futures",
    ):
        assert part in text
    invented = replace(plan, synthetic="demand 120 × the counts").to_text()
    assert invented.endswith(" Crowds: counts of counts.csv. Synthetic: demand 120 × the counts.\n")


def test_text_of_a_grid(grid) -> None:
    lines = [" ".join(line.split()) for line in grid.to_text().splitlines()]
    assert lines[0] == "expected (map), departing 15 min after the start, if crowds are as expected:"
    assert lines[1:4] == ["", "node minutes", "0 0.0"]
    assert lines[3 + len(grid.legs)] == f"8 {grid.expected_minutes:.1f}"
    assert lines[-1] == (
        "Streets: a grid of random lengths. Crowds: simulated. Synthetic: streets and crowds drawn from a seed."
    )


def test_text_of_walks_that_end_early(plan) -> None:
    lost = replace(
        plan, arrives=False, too_dense=2, futures=1, arrive_by=None, objective={"time": 1.0, "max_density": 4.0}
    )
    text = lost.to_text()
    assert "keeping low 1 x s, avoiding streets above 4 persons/m²," in text
    assert "min without arriving; " in text
    assert "\n2 of its streets are entered above the density" in text
    assert "In 1 simulated future: " in text
    assert "probability" not in text
    assert "\narrive\n" not in text


def test_geojson(plan) -> None:
    found = json.loads(json.dumps(plan.to_geojson()))
    assert (found["type"], found["attribution"]) == ("FeatureCollection", "© nobody & sons, ODbL 1.0")
    assert (found["crowds"], found["synthetic"]) == ("counts of counts.csv", "")
    assert "crs" not in found
    kinds = [(feature["properties"]["part"], feature["geometry"]["type"]) for feature in found["features"]]
    assert kinds == [
        ("route", "LineString"), ("leg", "LineString"), ("leg", "LineString"), ("leg", "LineString"),
        ("origin", "Point"), ("destination", "Point"),
    ]  # fmt: skip
    assert all(set(feature) == {"type", "properties", "geometry"} for feature in found["features"])
    route, *legs, origin, destination = (feature["geometry"]["coordinates"] for feature in found["features"])
    # longitude first
    assert np.array(origin) * DEGREE == pytest.approx([50, 0], abs=0.02)
    assert np.array(destination) * DEGREE == pytest.approx([300, -50], abs=0.02)
    assert np.array(route) * DEGREE == pytest.approx(np.array([[50, 0], [200, 0], [300, 0], [300, -50]]), abs=0.02)
    assert [leg[-1] for leg in legs[:-1]] == [leg[0] for leg in legs[1:]]
    assert all(number == round(number, 7) for point in route for number in point)
    whole = found["features"][0]["properties"]
    assert whole["metres"] == pytest.approx(300, abs=0.1)
    assert (whole["by_minutes"], whole["arrive_by"]) == (10, 1)
    streets = [feature["properties"]["street"] for feature in found["features"][1:4]]
    assert streets == ["Long Street", "Long Street", "Quay"]


GPX = "{http://www.topografix.com/GPX/1/1}"
ORDER = {  # of the schema; what is not listed may not occur
    "gpx": ("metadata", "wpt", "rte", "trk", "extensions"),
    "metadata": ("name", "desc", "author", "copyright", "link", "time", "keywords", "bounds", "extensions"),
    "copyright": ("year", "license"),
    "rte": ("name", "cmt", "desc", "src", "link", "number", "type", "extensions", "rtept"),
    "trk": ("name", "cmt", "desc", "src", "link", "number", "type", "extensions", "trkseg"),
    "trkseg": ("trkpt", "extensions"),
    "rtept": ("ele", "time", "magvar", "geoidheight", "name", "cmt", "desc"),
    "trkpt": ("ele", "time", "magvar", "geoidheight", "name", "cmt", "desc"),
}


def check_order(element: ET.Element) -> None:
    tag = element.tag.removeprefix(GPX)
    children = [child.tag.removeprefix(GPX) for child in element]
    assert [*children] == sorted(children, key=ORDER.get(tag, ()).index)
    for child in element:
        assert child.tag.startswith(GPX)
        check_order(child)


def test_gpx(plan) -> None:
    assert "probability" not in replace(plan, arrive_by=None).to_gpx()
    text = plan.to_gpx()
    assert "if crowds are as expected. Arrives within 10 min with probability 1.00. Crowds: " in text
    root = ET.fromstring(text)  # noqa: S314
    check_order(root)
    assert (root.tag, root.get("version"), root.get("creator")) == (f"{GPX}gpx", "1.1", "Sidestep")
    copyright_ = root.find(f"{GPX}metadata/{GPX}copyright")
    assert copyright_.get("author") == "© nobody & sons, ODbL 1.0"
    assert copyright_.find(f"{GPX}license").text.startswith("https://opendatacommons.org/")
    bounds = root.find(f"{GPX}metadata/{GPX}bounds")
    assert float(bounds.get("minlat")) * DEGREE == pytest.approx(-50, abs=0.02)
    turns = root.findall(f"{GPX}rte/{GPX}rtept")
    assert [turn.find(f"{GPX}name").text for turn in turns] == ["head east: Long Street", "turn right: Quay", "arrive"]
    track = root.findall(f"{GPX}trk/{GPX}trkseg/{GPX}trkpt")
    places = np.array([[float(point.get("lon")), float(point.get("lat"))] for point in track])
    assert metres_between(places[:-1], places[1:]).sum() == pytest.approx(300, abs=0.1)
    times = [datetime.fromisoformat(point.find(f"{GPX}time").text) for point in track]
    assert times[0] == datetime.fromisoformat(NOON)
    assert times == sorted(times)
    assert (times[-1] - times[0]).total_seconds() == pytest.approx(60 * plan.expected_minutes, abs=1)
    assert re.search(r"local wall time", text)


def test_what_json_gives_can_be_asked_for(router, plan) -> None:
    found = plan.to_json()
    ends = [f"{found[end]['latitude']},{found[end]['longitude']}" for end in ("origin", "destination")]
    assert [found[end]["node"] for end in ("origin", "destination")] == [None, None]
    assert router.plan(*ends, depart=NOON, futures=1).metres == pytest.approx(plan.metres, abs=0.1)
    for node in found["nodes"][1:-1]:
        assert router.plan(node, ends[1], depart=NOON, futures=1).origin.node == node


@pytest.mark.parametrize(("ends", "field"), [((None, 1), "origin"), ((0, None), "destination"), ((), "origin")])
def test_towns_want_both_ends(router, ends, field: str) -> None:
    with pytest.raises(RouteError) as caught:
        router.plan(*ends, depart=NOON)
    assert caught.value.field == field


def test_gpx_has_all_routes(plan) -> None:
    other = replace(plan, shared=0.5, nodes=[7, 8])
    root = ET.fromstring(replace(plan, alternatives=(other, other)).to_gpx())  # noqa: S314
    check_order(root)
    for tag in ("rte", "trk"):
        assert len({each.findtext(f"{GPX}name") for each in root.findall(f"{GPX}{tag}")}) == 3
    points = [len(track.findall(f"{GPX}trkseg/{GPX}trkpt")) for track in root.findall(f"{GPX}trk")]
    assert points == [4, 4, 4]


def test_as_long_is_neither_longer_nor_shorter(plan) -> None:
    baseline = replace(plan.baselines["snapshot"], futures=3, mean_difference_minutes=-0.04)
    assert "on average as long as the route (in these:" in replace(plan, baselines={"snapshot": baseline}).to_text()


def test_fewer_futures_are_compared_with_the_same_of_the_plan(plan) -> None:
    baseline = plan.baselines["snapshot"]
    assert baseline.plan_median_minutes == pytest.approx(plan.median_minutes, rel=1e-4)
    other = replace(baseline, futures=3, plan_median_minutes=98.7, plan_p90_minutes=99.1)
    text = replace(plan, baselines={"snapshot": other}).to_text()
    assert "98.7" in text
    assert "99.1" in text
    same = replace(other, futures=plan.futures)
    assert "98.7" not in replace(plan, baselines={"snapshot": same}).to_text()


def test_gpx_without_a_day_has_no_times(plan) -> None:
    text = replace(plan, departure=None).to_gpx()
    assert "<time>" not in text
    assert "wall time" not in text


def test_gpx_of_odd_names(plan) -> None:
    steps = [replace(step, street="A<&>\x00\ud800\uffffB") for step in plan.steps]
    root = ET.fromstring(replace(plan, steps=steps, attribution="A <\x00& B").to_gpx().encode())  # noqa: S314
    assert root.find(f"{GPX}metadata/{GPX}copyright").get("author") == "A <& B"
    assert root.find(f"{GPX}rte/{GPX}rtept/{GPX}name").text == "head east: A<&>B"


def test_pictures_say_where_the_data_come_from(plan) -> None:
    figure = draw_route(replace(plan, synthetic="demand 120 × the counts"))
    assert figure.get_supxlabel() == (
        "Streets: © nobody & sons, ODbL 1.0\nCrowds: counts of counts.csv\nSynthetic: demand 120 × the counts"
    )
    assert figure.get_suptitle() == ("tiny, Saturday 2025-05-24 12:30: 300 m, 4 min, planned by expected")
