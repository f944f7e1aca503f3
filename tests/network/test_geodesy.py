"""Distances on the globe, and a plane about a place."""

import numpy as np
import pytest

from sidestep.network.geodesy import (
    EARTH_RADIUS,
    Projection,
    course_lengths,
    heading,
    line_geometry,
    metres_between,
    split_at_antimeridian,
)

QUARTER = np.pi / 2 * EARTH_RADIUS  # of the equator, and of a meridian


def test_distances_on_the_globe() -> None:
    found = metres_between(np.array([[0.0, 0], [10, 0]]), np.array([[90.0, 0], [10, 90]]))
    np.testing.assert_allclose(found, [QUARTER, QUARTER])


@pytest.mark.parametrize("bearing", [0.0, 37.5, 90.0, 180.0, 269.9, 359.0])
@pytest.mark.parametrize("longitude", [24.94, 179.999, -179.999])
def test_the_way_to_a_place_near_by(bearing: float, longitude: float) -> None:
    start, metres = np.array([longitude, 60.17]), 250.0
    there = metres * np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
    end = Projection.of(start[None]).unproject(there)
    found, length = heading(start.tolist(), end.tolist())
    assert (found - bearing + 180) % 360 == pytest.approx(180, abs=0.01)
    assert length == pytest.approx(metres_between(start[None], end[None])[0], rel=1e-4)


def test_lengths_of_courses() -> None:
    points = np.array([[0.0, 0], [90, 0], [10, 0], [10, 45], [10, 90]])
    np.testing.assert_allclose(course_lengths(points, np.array([0, 2, 5])), [QUARTER, QUARTER])
    assert course_lengths(points, np.array([0])).tolist() == []


def test_a_plane_about_the_middle() -> None:
    plane = Projection.of(np.array([[24.0, 59.9], [24.2, 60.1], [24.1, 60.0]]))
    np.testing.assert_allclose(plane.centre, [24.1, 60.0])
    # A hundredth of a degree is 1111.95 m; to the east that times cos 60 deg = 1/2.
    np.testing.assert_allclose(plane.project(np.array([24.11, 60.01])), [555.98, 1111.95], atol=0.01)
    lonlat = np.array([[24.03, 59.95], [24.2, 60.2]])
    np.testing.assert_allclose(plane.unproject(plane.project(lonlat)), lonlat, rtol=1e-15)


def test_the_plane_spans_the_antimeridian() -> None:
    east, west = 179.9995, -179.9985  # 0.002° apart
    lonlat = np.array([[east, -16.8], [west, -16.8], [east, -16.79]])
    plane = Projection.of(lonlat)
    xy = plane.project(lonlat)
    assert xy[1, 0] - xy[0, 0] == pytest.approx(metres_between(lonlat[:1], lonlat[1:2])[0], rel=1e-4)
    np.testing.assert_allclose(plane.unproject(xy), lonlat, atol=1e-12)
    assert -180 <= plane.centre[0] <= 180


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ([[179.0, 10.0], [179.5, 11.0]], [[[179.0, 10.0], [179.5, 11.0]]]),
        ([[179.0, 10.0], [-179.0, 12.0]], [[[179.0, 10.0], [180.0, 11.0]], [[-180.0, 11.0], [-179.0, 12.0]]]),
        ([[-179.0, 10.0], [178.0, 13.0]], [[[-179.0, 10.0], [-180.0, 11.0]], [[180.0, 11.0], [178.0, 13.0]]]),
        (
            [[178.0, 0.0], [180.0, 1.0], [-179.0, 2.0]],
            [[[178.0, 0.0], [180.0, 1.0]], [[-180.0, 1.0], [-179.0, 2.0]]],
        ),
        ([[178.0, 0.0], [-180.0, 1.0], [-179.0, 2.0]], [[[178.0, 0.0], [180.0, 1.0]], [[-180.0, 1.0], [-179.0, 2.0]]]),
    ],
)
def test_lines_are_split_at_the_antimeridian(line, parts) -> None:
    assert split_at_antimeridian(line) == parts
    kind = line_geometry(line)["type"]
    assert kind == ("MultiLineString" if len(parts) > 1 else "LineString")
