"""Waits at gates by hand, exact to the second, and that nobody leaves before those who came earlier."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sidestep.network.opening_hours import open_minutes
from sidestep.walking.opening import AnyWaits, with_opening_times
from sidestep.walking.waits import NoWaits, Waits

DAY, WEEK = 24, 168
TIMES = ("06:00-22:00", "", "Mo-Fr 08:00-18:00", "22:00-06:00")
PARK, ALWAYS, OFFICE, NIGHT = range(4)


def light(segments: int) -> Waits:
    """Everywhere a light, green for the first 30 s of each 90 s."""
    none = jnp.zeros(segments)
    return Waits(none + 1, none, none + 90, none + 30, none, jnp.zeros(24), 8.0)


found: Callable[..., jax.Array] = jax.jit(lambda waits, *come: waits.seconds(*come))


def seconds(waits: AnyWaits, segment: int, hour: float, clock: float = 0.0) -> float:
    return float(found(waits, jnp.float32(hour), jnp.float32(0), jnp.int32(segment), jnp.float32(clock)))


@pytest.mark.parametrize(
    ("segment", "hour", "clock", "wait"),
    [
        (PARK, 12, 0, 0),
        (PARK, 22, 0, 8 * 3600),  # shut for those who come at 22:00
        (PARK, 21, 3599, 0),
        (PARK, 21, 3599.75, 0),
        (PARK, 21.5, 1800, 8 * 3600),
        (PARK, 23.5, 0, 6.5 * 3600),
        (PARK, 5, 3599, 1),
        (PARK, 5, 3599.75, 0.25),
        (PARK, 6, 0, 0),
        (PARK, 6 * DAY + 23, 7200, 5 * 3600),  # over the end of the week
        (PARK, WEEK - 1 / 3600, 0, 6 * 3600 + 1),  # hours are taken to the second
        (ALWAYS, 3, 17, 0),
        (OFFICE, 4 * DAY + 18, 0, (6 + 2 * DAY + 8) * 3600),  # from Friday evening to Monday
        (OFFICE, 7, 3540, 60),
        (NIGHT, 12, 100, 10 * 3600 - 100),
        (NIGHT, 23, 3 * 3600, 0),
    ],
)
def test_who_comes_before_a_gate_opens_waits(segment: int, hour: float, clock: float, wait: float) -> None:
    assert seconds(with_opening_times(NoWaits(), TIMES), segment, hour, clock) == wait


def test_then_come_the_lights_by_the_later_clock() -> None:
    waits = with_opening_times(light(4), TIMES)
    # The gate opens at clock 40 in red till 90; the light alone, at clock 40, is red for 50 s more.
    assert seconds(waits, PARK, 6 - 40 / 3600) == 90
    assert seconds(waits, PARK, 6 - 40 / 3600, 45.0) == 45
    assert seconds(waits, ALWAYS, 6, 45.0) == 45
    assert seconds(waits.averaged(), PARK, 6 - 40 / 3600) == pytest.approx(40 + 20)
    assert (waits.jumps, waits.averaged().jumps, light(4).averaged().jumps) == (True, True, False)
    shut = waits.until_open(jnp.float32(6 - 40 / 3600), jnp.arange(2), jnp.zeros(2))
    assert shut.tolist() == [40, 0]


def test_where_all_is_open_nothing_changes() -> None:
    none, lit = NoWaits(), light(2)
    assert with_opening_times(none, ("", "")) is none
    assert with_opening_times(lit, ("", "")) is lit
    for waits in (none, lit):
        assert not waits.gates
        assert waits.until_open(jnp.float32(3), jnp.arange(2), jnp.zeros(2)).tolist() == [0, 0]


def test_walks_wait_once_for_each_street() -> None:
    waits = with_opening_times(light(4), TIMES)
    pieces = waits.on_pieces(jnp.array([PARK, PARK, ALWAYS]), jnp.array([True, False, False]))
    # At clock 60 s it opens, and the light, on the first piece alone, is red for 30 s more.
    assert [seconds(pieces, piece, 6 - 60 / 3600) for piece in range(3)] == [90, 0, 0]
    # Who begins on the second one waits there.
    begun = pieces.begun_on(np.array([False, True, True]))
    assert [seconds(begun, piece, 6 - 60 / 3600) for piece in range(3)] == [90, 60, 0]
    assert waits.begun_on(np.ones(3, bool)) is waits  # in streets that are whole


def test_never_open() -> None:
    assert seconds(with_opening_times(NoWaits(), ("off",)), 0, 3.0, 30.0) == pytest.approx(WEEK * 3600, abs=60)


CLOCKS = st.floats(0, 2e5, width=32, allow_subnormal=False)  # which some compilers take for zero
leave = jax.jit(lambda waits, hour, segment, clock: clock + waits.seconds(hour, jnp.float32(0), segment, clock))


@given(st.integers(0, WEEK * 60 - 1), CLOCKS, CLOCKS, st.integers(0, 3), st.booleans())
def test_nobody_leaves_before_those_who_came_earlier(
    minute: int, one: float, other: float, segment: int, lit: bool
) -> None:
    waits = with_opening_times(light(4) if lit else NoWaits(), TIMES)
    come = jnp.float32(minute / 60), jnp.int32(segment)
    early, late = (float(leave(waits, *come, jnp.float32(clock))) for clock in sorted((one, other)))
    assert late >= early - 0.05  # single precision, three days later
    assert early >= min(one, other)
    minutes = open_minutes(TIMES[segment])
    # Who leaves a gate leaves it open.
    passed = minute * 60 + float(min(one, other) + waits.until_open(*come, jnp.float32(min(one, other))))
    assert any(minutes[int((passed + rounding) // 60) % len(minutes)] for rounding in (-0.05, 0.05))
