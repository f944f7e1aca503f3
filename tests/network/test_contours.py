"""Areas around the streets that are reached."""

import numpy as np
import pytest

from sidestep.network.contours import BESIDE, CELL, Raster, Samples, ring_area
from sidestep.network.formats import load_helsinki
from sidestep.network.snapping import split_streets


def test_samples_lie_on_their_streets() -> None:
    town = load_helsinki()
    samples = Samples.of(town)
    assert samples.metres.sum() == pytest.approx(town.length.sum(), rel=1e-4)
    for street in range(0, town.streets, 101):
        mine = slice(samples.first[street], samples.first[street + 1])
        course = town.project(town.course(street))
        assert samples.xy[mine][[0, -1]] == pytest.approx(course[[0, -1]], abs=1e-3)
        steps = np.linalg.norm(np.diff(samples.xy[mine], axis=0), axis=1)
        assert steps.max() <= CELL + 1e-6


def test_both_ends_of_a_street_count() -> None:
    town = load_helsinki()
    samples, streets = Samples.of(town), split_streets(town, [])
    begins, seconds = np.full(streets.network.segments, np.inf), np.full(streets.network.segments, 60.0)
    there, back = 0, int(np.flatnonzero(streets.street == 0)[1])
    begins[[there, back]] = 100.0, 120.0
    found = samples.reached(streets, begins, seconds)
    mine = slice(0, samples.first[1])
    along = samples.fraction[mine]
    assert found[mine] == pytest.approx(np.minimum(100 + 60 * along, 120 + 60 * (1 - along)))
    assert np.isinf(found[samples.first[1] :]).all()


def test_a_street_alone_is_a_strip() -> None:
    xy = np.stack([np.arange(0.0, 201.0, CELL), np.zeros(21)], axis=1)
    samples = Samples(xy, xy[:, 0] / 200, np.array([0, 21]), np.full(21, 200 / 21))
    raster = Raster.around(samples, xy)
    field = raster.seconds(np.zeros(21), 1.0)
    ((outer,),) = raster.areas(field, 1e3, 1.0)
    assert ring_area(outer) == pytest.approx(200 * 2 * BESIDE + np.pi * BESIDE**2, rel=0.02)
    # what is beside the street takes time as well
    ((outer,),) = raster.areas(field, 15.0, 1.0)
    assert np.abs(outer[:, 1]).max() == pytest.approx(15, abs=0.1)
    assert raster.areas(field, -1.0, 1.0) == []


def test_a_ring_of_streets_has_a_hole() -> None:
    angle = np.linspace(0, 2 * np.pi, 200)
    xy = 200 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    samples = Samples(xy, angle / (2 * np.pi), np.array([0, 200]), np.ones(200))
    raster = Raster.around(samples, xy)
    ((outer, hole),) = raster.areas(raster.seconds(np.zeros(200), 1.0), 1e3, 1.0)
    assert ring_area(outer) == pytest.approx(np.pi * (200 + BESIDE) ** 2, rel=0.02)
    assert ring_area(hole) == pytest.approx(-np.pi * (200 - BESIDE) ** 2, rel=0.02)  # clockwise
