"""What objectives make of a crossing, by hand; travel time is their neutral element."""

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.walking.objective import PENALTY_SECONDS, TravelTime, WeightedObjective
from sidestep.walking.speed_laws import FREE_SPEED

SECONDS, METRES, EXPOSURE, DENSITY = (jnp.array(each, float) for each in ([100, 50], [120, 60], [200, 0], [2, 0]))
HORIZON = jnp.float32(3600)


def unasked() -> None:
    raise AssertionError("time alone needs no crowds")


def test_time_alone_works_out_nothing_else() -> None:
    objective = TravelTime()
    crossed = objective.crossing(SECONDS, METRES, unasked, unasked)
    assert (crossed.seconds is SECONDS, crossed.cost is SECONDS, crossed.measures) == (True, True, {})
    assert (objective.needs_density, objective.measures, objective.jumps) == (False, (), False)
    assert objective.penalty == objective.too_dense(unasked) == 0
    assert objective.waiting(SECONDS, unasked) is SECONDS


def test_time_alone_is_what_the_clock_says() -> None:
    objective = TravelTime()
    crossed = objective.crossing(SECONDS, METRES, unasked, unasked)
    assert objective.step_cost(crossed, METRES) is METRES
    assert objective.walk_cost(SECONDS, METRES, jnp.array([True, False]), HORIZON) is METRES


def test_a_weighted_sum_by_hand() -> None:
    objective = WeightedObjective(time=0.5, distance=0.1, exposure=2.0, max_density=1.5)
    # .5 * 100 + .1 * 120 + 2 * 200 = 462 s; above 1.5 persons/m² also 3600 s at free speed among as many
    fine = PENALTY_SECONDS * (0.5 + 0.1 * FREE_SPEED + 2 * 1.5)
    assert float(objective.penalty) == pytest.approx(fine)
    crossed = objective.crossing(SECONDS, METRES, lambda: EXPOSURE, lambda: DENSITY)
    np.testing.assert_allclose(crossed.cost, [462 + fine, 31])
    assert tuple(crossed.measures) == objective.measures
    assert {name: found.tolist() for name, found in crossed.measures.items()} == {
        "metres": [120, 60],
        "exposure": [200, 0],
        "too_dense": [1, 0],
    }
    assert objective.step_cost(crossed, SECONDS) is crossed.cost
    # Waiting 100 s among 2 persons/m², 50 s alone.
    np.testing.assert_allclose(objective.waiting(SECONDS, lambda: DENSITY), [100 * (0.5 + 2 * 2), 50 * 0.5])
    # Walks that do not arrive cost the horizon more.
    np.testing.assert_allclose(
        objective.walk_cost(crossed.cost, SECONDS, jnp.array([False, True]), HORIZON), [462 + fine + 3600, 31]
    )


def test_without_a_maximum_nowhere_is_too_dense() -> None:
    objective = WeightedObjective(exposure=1.0)
    assert (objective.jumps, objective.penalty) == (False, 0)
    assert objective.too_dense(lambda: DENSITY).tolist() == [0, 0]
    assert WeightedObjective(max_density=2.5).jumps


def test_measured_time_costs_the_same() -> None:
    measured = TravelTime().measured()
    crossed = measured.crossing(SECONDS, METRES, lambda: EXPOSURE, lambda: DENSITY)
    assert crossed.cost.tolist() == SECONDS.tolist()
    assert measured.measured() is measured
