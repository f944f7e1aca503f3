"""Who is faster on the level, or on stairs, never arrives later, whatever the map and the crowds."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.crowds.base import FlowField
from sidestep.planners.time_dependent import earliest_arrivals, leaving
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.walking.profile import own_law
from sidestep.walking.speed_field import SpeedField, dense_speeds
from sidestep.walking.speed_laws import Weidmann

GRID = scenario("paper-congested", side=4, crowded_nodes=3, law="weidmann", horizon=12 * 3600.0, slot_seconds=1800.0)
HERE = draw_map(GRID, 0)
SLOTS = 24


def arrivals(free_speed: float, pace: np.ndarray, volume: np.ndarray, crowd_factor: float = 1.0) -> np.ndarray:
    """Earliest clocks at all nodes, from the first one at clock 0."""
    speeds = dense_speeds(
        replace(HERE.network, pace=jnp.asarray(pace, jnp.float32)),
        FlowField(jnp.asarray(volume, jnp.float32)[None], GRID.slot_seconds),
        own_law(Weidmann(), free_speed, crowd_factor),
    )
    return np.asarray(_search(speeds))


@jax.jit
def _search(speeds: SpeedField) -> jax.Array:
    leave = leaving(HERE.network, speeds, jnp.int32(0), "integrated", lambda _segment, clock: jnp.zeros_like(clock))
    return earliest_arrivals(HERE.network, leave, jnp.int32(0), jnp.float32(0))[0]


speed = st.floats(0.1, 5.0)


@settings(max_examples=30)
@given(st.tuples(speed, speed), st.floats(0.1, 1.0), st.floats(1.0, 20.0), st.integers(0, 2**32 - 1))
def test_faster_walkers_never_arrive_later(
    speeds: tuple[float, float], stairs: float, crowd_factor: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    volume = rng.uniform(1, 6000, (SLOTS, HERE.network.segments))
    pace = np.where(rng.random(HERE.network.segments) < 0.3, stairs, 1.0)
    slow, fast = (arrivals(each, pace, volume) for each in sorted(speeds))
    assert (fast <= slow * (1 + 1e-5)).all()
    level = arrivals(min(speeds), np.ones_like(pace), volume)
    assert (level <= slow * (1 + 1e-5)).all()
    yielding = arrivals(min(speeds), pace, volume, crowd_factor)
    assert (slow <= yielding * (1 + 1e-5)).all()


def test_a_child_takes_as_much_longer_as_it_is_slower() -> None:
    # Below one person per m² the law that is held at free speed has no crowd.
    free = dict(law="power-capped", volumes=(1.0, 2.0), crowded_nodes=0, flows="forecast", horizon=24 * 3600.0)
    adult, child = (GRID.changed(**free, walker=kind) for kind in ("adult", "child"))
    to = jnp.int32(15)
    seconds = []
    for problem in (adult, child):
        params = make_environment(problem, draw_map(problem, 0), "test", 1)
        leave = leaving(params.network, params.expected, jnp.int32(0), "integrated", params.wait_in(jnp.int32(0)))
        seconds.append(float(earliest_arrivals(params.network, leave, jnp.int32(0), jnp.float32(0), to)[0][15]))
    assert seconds[1] == pytest.approx(seconds[0] * 1.34 / 0.81, rel=1e-5)
