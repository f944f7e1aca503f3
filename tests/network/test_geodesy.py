"""Distances on the globe, and a plane about a place."""

import numpy as np

from sidestep.network.geodesy import EARTH_RADIUS, Projection, course_lengths, metres_between

QUARTER = np.pi / 2 * EARTH_RADIUS  # of the equator, and of a meridian


def test_distances_on_the_globe() -> None:
    found = metres_between(np.array([[0.0, 0], [10, 0]]), np.array([[90.0, 0], [10, 90]]))
    np.testing.assert_allclose(found, [QUARTER, QUARTER])


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
