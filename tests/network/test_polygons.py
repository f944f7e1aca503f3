"""Areas to avoid: what is a polygon, and which streets cross one."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sidestep.network.contours import ring_area
from sidestep.network.formats import load_helsinki
from sidestep.network.geodesy import Projection
from sidestep.network.polygons import PolygonError, in_degrees, read_polygons
from sidestep.network.snapping import Snapper, split_streets

WEST, SOUTH, EAST, NORTH = 24.940, 60.168, 24.944, 60.170
RING = [[WEST, SOUTH], [EAST, SOUTH], [EAST, NORTH], [WEST, NORTH], [WEST, SOUTH]]
POLYGON = {"type": "Polygon", "coordinates": [RING]}
HOLE = [[24.941, 60.1685], [24.941, 60.1695], [24.943, 60.1695], [24.943, 60.1685], [24.941, 60.1685]]


def collection(*geometries: object) -> dict:
    features = [{"type": "Feature", "properties": {}, "geometry": each} for each in geometries]
    return {"type": "FeatureCollection", "features": features}


@pytest.mark.parametrize(
    "content",
    [
        POLYGON,
        {"type": "MultiPolygon", "coordinates": [[RING]]},
        {"type": "Feature", "geometry": POLYGON},
        collection(POLYGON, POLYGON),
        {"type": "GeometryCollection", "geometries": [POLYGON]},
    ],
)
def test_polygons_come_in_many_wrappings(content: dict, tmp_path) -> None:
    town = load_helsinki()
    file = tmp_path / "area.geojson"
    file.write_text(json.dumps(content))
    for given in (content, file, str(file)):
        area = read_polygons(given, town)
        assert area.contains(np.array([[24.942, 60.169], [24.945, 60.169]])).tolist() == [True, False]


def test_holes_are_no_part_of_an_area() -> None:
    triangle = [[24.9432, 60.1685], [24.9432, 60.1695], [24.9438, 60.1685], [24.9432, 60.1685]]
    area = read_polygons({"type": "Polygon", "coordinates": [RING, HOLE, triangle]}, load_helsinki())
    places = np.array([[24.942, 60.169], [24.9433, 60.1686], [24.9405, 60.1682]])
    assert area.contains(places).tolist() == [False, False, True]
    assert [len(ring) for ring in area.rings[0]] == [5, 5, 4]


def test_streets_that_lead_through_an_area_cross_it() -> None:
    town = load_helsinki()
    streets = split_streets(town, [])
    crossed = read_polygons(POLYGON, town).crossed(streets)
    for segment in range(0, streets.network.segments, 97):
        inside = ((streets.course(segment) > (WEST, SOUTH)) & (streets.course(segment) < (EAST, NORTH))).all(axis=1)
        assert crossed[segment] or not inside.any()
    assert 0 < crossed.sum() < len(crossed) / 2


def test_only_the_piece_inside_an_area_crosses_it() -> None:
    town = load_helsinki()
    street = int(np.argmax(town.length))
    course = town.course(street)
    latitude, longitude = course[len(course) // 2][::-1]
    streets = split_streets(town, [Snapper(town).nearest(float(latitude), float(longitude))])
    pieces = np.flatnonzero((streets.street == street) & (streets.fraction < 1))
    west, south = course[0] - 1e-5
    ring = [[west, south], [west + 2e-5, south], [west + 2e-5, south + 2e-5], [west, south + 2e-5], [west, south]]
    crossed = read_polygons({"type": "Polygon", "coordinates": [ring]}, town).crossed(streets)
    begins = np.minimum(streets.begin, streets.end)[pieces] == 0
    assert len(pieces) >= 2
    assert crossed[pieces].tolist() == begins.tolist()


def open_ring(ring: list) -> dict:
    return {"type": "Polygon", "coordinates": [ring]}


@pytest.mark.parametrize(
    "content",
    [
        {"type": "Point", "coordinates": [24.94, 60.17]},
        {"type": "LineString", "coordinates": RING},
        {"type": "FeatureCollection", "features": []},
        {"type": "FeatureCollection"},
        {"type": "Polygon", "coordinates": []},
        {"type": "Polygon"},
        {"type": "MultiPolygon", "coordinates": [3]},
        {"type": "Feature", "geometry": None},
        {},
        open_ring(RING[:-1]),
        open_ring(RING[:3]),
        open_ring([RING[0], RING[2], RING[1], RING[3], RING[0]]),  # crosses itself
        open_ring([*RING[:2], ["24.94", 60.17], *RING[2:]]),
        open_ring([*RING[:2], [float("nan"), 60.17], *RING[2:]]),
        open_ring([*RING[:2], [10**400, 60.17], *RING[2:]]),
        open_ring([[2776000 + x, 8437000 + y] for x, y in RING]),  # metres
        open_ring(["here"]),
    ],
)
def test_what_is_no_polygon(content: dict, tmp_path) -> None:
    with pytest.raises(PolygonError) as caught:
        read_polygons(content, load_helsinki())
    assert "\n" not in str(caught.value)
    (tmp_path / "area.geojson").write_text(json.dumps(content))
    with pytest.raises(PolygonError):
        read_polygons(tmp_path / "area.geojson", load_helsinki())


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", "\x00", "[" * 100_000])
def test_what_is_no_geojson(text: str, tmp_path) -> None:
    (tmp_path / "area.geojson").write_text(text)
    with pytest.raises(PolygonError):
        read_polygons(tmp_path / "area.geojson", load_helsinki())
    with pytest.raises(PolygonError):
        read_polygons(tmp_path / "none.geojson", load_helsinki())


def test_latitude_and_longitude_swapped() -> None:
    swapped = [[latitude, longitude] for longitude, latitude in RING]
    with pytest.raises(PolygonError, match="swapped"):
        read_polygons(open_ring(swapped), load_helsinki())
    # an area elsewhere is just elsewhere
    elsewhere = read_polygons(open_ring([[x + 1, y] for x, y in RING]), load_helsinki())
    assert not elsewhere.crossed(split_streets(load_helsinki(), [])).any()


def test_towns_on_the_antimeridian() -> None:
    town, turn = load_helsinki(), np.array([180 - (WEST + EAST) / 2, 0.0])
    ring = np.array(RING) + turn  # from below 180 degrees to above
    sides = [np.clip(ring, (-np.inf, -90), (180, 90)), np.clip(ring, (180, -90), (np.inf, 90)) - (360, 0)]
    there = replace(town, place=_turned(town.place + turn), points=_turned(town.points + turn))
    plain = read_polygons({"type": "Polygon", "coordinates": [RING]}, town)
    expected = plain.crossed(split_streets(town, []))
    for coordinates in ([[side.tolist()] for side in sides], [[_turned(ring).tolist()]]):  # split, or not
        area = read_polygons({"type": "MultiPolygon", "coordinates": coordinates}, there)
        np.testing.assert_array_equal(area.crossed(split_streets(there, [])), expected)
        np.testing.assert_array_equal(area.contains(there.place), plain.contains(town.place))
        longitudes = [np.array(outer)[:, 0] for outer, *_ in area.rings]  # split, whatever was given
        assert [np.abs(each).max() for each in longitudes] == [180, 180]
        assert max(map(np.ptp, longitudes)) < EAST - WEST


def _turned(lonlat: np.ndarray) -> np.ndarray:
    return np.where(lonlat > 180, lonlat - 360, lonlat)


def test_polygons_are_split_at_the_antimeridian() -> None:
    plane = Projection(np.array([179.999, 0.0]), np.array([100_000.0, 100_000.0]))
    outer = 1000 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    triangle = np.array([[600.0, 600], [600, 800], [800, 600], [600, 600]])
    rings = [outer, outer[::-1] / 2, triangle]
    found = in_degrees([rings], plane)
    areas = []
    for polygon in found:
        longitudes = np.array(polygon[0])[:, 0]
        assert np.ptp(longitudes) < 0.02
        assert np.abs(longitudes).max() == 180
        areas.append(sum(ring_area(np.array(ring)) for ring in polygon))
    assert ring_area(np.array(found[0][0])) > 0
    assert sum(areas) == pytest.approx((3e6 - 2e4) / 1e5**2)
    assert min(areas) > 0
    away = Projection(np.array([24.9, 60.0]), plane.scale)
    ((again, hole, _),) = in_degrees([rings], away)
    np.testing.assert_allclose((np.array(again) - away.centre) * away.scale, outer, atol=0.02)
    assert len(hole) == 5
