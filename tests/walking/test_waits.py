"""Waits at lights and for gaps by hand, and that nobody leaves before those who came earlier."""

from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.scenarios.maps import DAY_OF_TRAFFIC, MOST_UNSIGNALISED
from sidestep.walking.waits import NoWaits, Waits, gap_delay, light_phases

ALL = jnp.arange(3)


def waits(**changes: object) -> Waits:
    """On segment 0 a light, green for the first 30 s of each 90 s from 20 s on; on 1 three such; on 2 two crossings."""
    flat = Waits(
        lights=jnp.array([1.0, 3.0, 0.0]),
        unsignalised=jnp.array([0.0, 0.0, 2.0]),
        cycle=jnp.full(3, 90.0),
        green=jnp.full(3, 30.0),
        offset=jnp.full(3, 20.0),
        vehicles=jnp.full(24, 0.1),
        critical_gap=8.0,
    )
    return replace(flat, **changes)


MONDAY, IN_STEP = jnp.float32(0), jnp.float32(0)


def seconds(found: Waits | NoWaits, clock: float, hour: float = 0.0, phase: float = 0.0) -> list[float]:
    return found.seconds(jnp.float32(hour), jnp.float32(phase), ALL, jnp.full(3, clock, float)).tolist()


# Adams: (e^.8 - .8 - 1) / .1
DELAY = 4.255409


@pytest.mark.parametrize(("clock", "red"), [(20, 0), (49, 0), (50, 60), (80, 30), (109.5, 0.5), (110, 0), (0, 20)])
def test_who_comes_at_red_leaves_as_it_turns_green(clock: float, red: float) -> None:
    # The mean wait at a light is 60² / (2 * 90) = 20 s; that is what the second and the third light take.
    assert seconds(waits(), clock) == pytest.approx([red, red + 40, 2 * DELAY], rel=1e-5)


def test_every_future_meets_the_lights_elsewhere_in_their_cycle() -> None:
    # Future 1 is .618034 of an hour later, 2,224.922 s, which is 64.922 s after a whole cycle: green from 84.922 s on.
    phases = light_phases(90).tolist()
    assert phases[:2] == pytest.approx([0, 2224.922])
    assert seconds(waits(), 50.0, phase=phases[1])[0] == pytest.approx(84.922 - 50, abs=2e-3)
    red = [seconds(waits(), 50.0, phase=phase)[0] for phase in phases]
    assert np.mean(red) == pytest.approx(20, abs=0.5)


def test_without_the_phases_lights_take_their_mean_wait() -> None:
    for clock in (0.0, 35.0, 80.0):
        assert seconds(waits().averaged(), clock, phase=17.0) == pytest.approx([20, 60, 2 * DELAY], rel=1e-5)
    every = jnp.arange(0, 90, 0.01)
    found = waits().seconds(MONDAY, IN_STEP, jnp.zeros(9000, int), every)
    assert float(found.mean()) == pytest.approx(20, abs=0.01)


@pytest.mark.parametrize(("vehicles", "delay"), [(0.0, 0.0), (1e-4, 0.0032), (0.1, DELAY), (0.5, 2 * (np.exp(4) - 5))])
def test_gaps_by_hand(vehicles: float, delay: float) -> None:
    # In thin traffic the chance of meeting a vehicle, vehicles * gap, times half a gap.
    assert float(gap_delay(jnp.float32(vehicles), 8.0)) == pytest.approx(delay, rel=2e-3, abs=1e-4)


def test_traffic_goes_straight_from_hour_to_hour_and_by_the_hour_of_the_week() -> None:
    found = waits(vehicles=jnp.zeros(24).at[7].set(0.1).at[0].set(0.2))

    def delay(rate: float) -> float:
        return 2 * float(gap_delay(jnp.float32(rate), 8.0))

    # Monday at 7:00 and Wednesday at midnight.
    on_monday, on_wednesday = ((1800.0, 0.1), (0.0, 0.05), (3600.0, 0.05)), ((0.0, 0.1), (3600.0, 0.1), (1800.0, 0.2))
    for hour, clock, rate in (*((7.0, *each) for each in on_monday), *((48.0, *each) for each in on_wednesday)):
        assert seconds(found, clock, hour)[2] == pytest.approx(delay(rate), rel=1e-3), (hour, clock)


leave: Callable[..., jax.Array] = jax.jit(
    lambda found, hour, phase, clock: clock + found.seconds(hour, phase, ALL, clock)
)


@given(
    st.floats(0, 5000, width=32), st.floats(0, 5000, width=32), st.floats(0, 90, width=32), st.floats(0, 0.5, width=32),
    st.integers(0, 167), st.floats(0, 3600, width=32),
)  # fmt: skip
def test_nobody_leaves_before_those_who_came_earlier(
    one: float, other: float, offset: float, busiest: float, hour: int, phase: float
) -> None:
    # Up to as many vehicles as scenarios may have, four in each gap of 8 s, on as many crossings as a street may have.
    found = waits(
        offset=jnp.full(3, offset),
        vehicles=jnp.array(DAY_OF_TRAFFIC) * busiest,
        unsignalised=jnp.full(3, float(MOST_UNSIGNALISED)),
    )
    early, late = (
        leave(found, jnp.float32(hour), jnp.float32(phase), jnp.full(3, clock)) for clock in sorted((one, other))
    )
    assert (np.asarray(late - early) >= -1e-3).all()
    assert (np.asarray(early) >= min(one, other)).all()


def test_pieces_of_a_segment_wait_where_it_begins() -> None:
    parent, first = jnp.array([0, 1, 2, 1]), jnp.array([True, False, True, True])
    found = waits().on_pieces(parent, first).seconds(MONDAY, IN_STEP, jnp.arange(4), jnp.full(4, 50.0))
    assert found.tolist() == pytest.approx([60, 0, 2 * DELAY, 100], rel=1e-5)
    assert NoWaits().on_pieces(parent, first) == NoWaits()


def test_lifts_take_their_time_after_everything_else() -> None:
    lifts = jnp.array([0.0, 60.0, 15.0])
    assert seconds(waits().with_fixed(lifts), 50.0) == pytest.approx([60, 100 + 60, 2 * DELAY + 15], rel=1e-5)
    alone = NoWaits().with_fixed(lifts)
    assert not alone.phases
    for found in (alone, alone.averaged()):
        assert seconds(found, 50.0, 7.0, 3.0) == [0, 60, 15]
    parent, first = jnp.array([0, 1, 2, 1]), jnp.array([True, False, True, True])
    pieces = alone.on_pieces(parent, first).seconds(MONDAY, IN_STEP, jnp.arange(4), jnp.full(4, 50.0))
    assert pieces.tolist() == [0, 0, 15, 60]


def test_without_traffic_nobody_waits() -> None:
    none = NoWaits()
    assert seconds(none, 50.0, 7.0, 3.0) == [0, 0, 0]
    assert none.averaged() == none
