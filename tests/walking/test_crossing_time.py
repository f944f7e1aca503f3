"""Speed laws by hand (eqs. 3 and 4), crossings by hand, and what must hold for any speeds (FIFO)."""

from functools import partial
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.crowds.base import FlowField
from sidestep.network.graph import road_network
from sidestep.walking.crossing_time import CrossingRule, crossing_time, crossing_times, exposure, leaving_clock
from sidestep.walking.speed_field import dense_speeds, speed_field, walking_speeds
from sidestep.walking.speed_laws import LAWS, Aoki, SpeedLaw, Weidmann

CROSSING_RULES = get_args(CrossingRule)
SLOTS = 20  # more than are looked at together
EPS = float(np.finfo(np.float32).eps)


def speed_at(law: SpeedLaw, *density: float) -> list[float]:
    return law.speed(jnp.array(density, float)).tolist()


# --- Speed laws -----------------------------------------------------------------------------------------------------


def test_power_law_eq_3() -> None:
    # 2^-0.8 = 0.574349, 0.5^-0.8 = 1.741101, 32^-0.8 = 1/16, (1/32)^-0.8 = 16; times 1.34 m/s
    speeds = speed_at(Aoki(capped=False), 1, 2, 0.5, 32, 1 / 32)
    assert speeds == pytest.approx([1.34, 0.769628, 2.333076, 0.08375, 21.44], rel=1e-5)


def test_capped_power_law_never_exceeds_the_free_speed() -> None:
    speeds = speed_at(Aoki(), 1, 2, 0.5, 1 / 32, 32)
    assert speeds == pytest.approx([1.34, 0.769628, 1.34, 1.34, 0.08375], rel=1e-5)


def test_power_law_with_other_numbers() -> None:
    # 2 * 4^-0.5 = 1
    assert speed_at(Aoki(free_speed=2, exponent=0.5), 4) == pytest.approx([1])


def test_weidmann() -> None:
    # density 1: 1 - 1/5.4 = .814815, times -1.913 is -1.558741, exp .210401: 1.34 * .789599 = 1.058063
    # density 2.7: 2/5.4 - 1/5.4 = .185185, times -1.913 is -.354259, exp .701692: 1.34 * .298308 = .399732
    assert speed_at(Weidmann(), 1, 2.7) == pytest.approx([1.058063, 0.399732], rel=1e-5)


def test_weidmann_jams_at_5_4_and_is_held_at_the_floor() -> None:
    # 1/5.4 - 1/5.4 = 0, exp 1: standing still; beyond, the formula walks backwards
    assert speed_at(Weidmann(floor=0), 5.4)[0] == pytest.approx(0, abs=1e-6)
    assert speed_at(Weidmann(), 5.4, 6, 50) == pytest.approx([0.05, 0.05, 0.05])
    # just below the jam: 1/5 - 1/5.4 = .0148148, times -1.913 is -.0283407, exp .972057: 1.34 * .027943 = .037443
    assert speed_at(Weidmann(), 5) == pytest.approx([0.05])
    assert speed_at(Weidmann(floor=0.01), 5) == pytest.approx([0.037443], rel=1e-3)


def test_weidmann_of_an_empty_street_is_the_free_speed() -> None:
    assert speed_at(Weidmann(), 0, 1e-9, 0.05) == pytest.approx([1.34, 1.34, 1.34], rel=1e-5)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
@given(densities=hnp.arrays(np.float32, 8, elements=st.floats(2**-10, 60, width=32)))
def test_the_denser_the_slower(law: SpeedLaw, densities: np.ndarray) -> None:
    speed = np.asarray(law.speed(jnp.asarray(np.sort(densities))))
    assert (speed > 0).all()
    assert (np.diff(speed) <= 2 * EPS * speed[1:]).all()


@pytest.mark.parametrize(
    ("persons", "metres", "seconds"),
    [
        # c = d^0.2 p^0.8 / x0; fifth powers: 32 = 2^5, 243 = 3^5, 1024 = 4^5
        (243, 32, 2 * 81 / 1.34),
        (32, 243, 3 * 16 / 1.34),
        (1024, 1024, 4 * 256 / 1.34),
        (3125, 100000, 10 * 625 / 1.34),
        (1, 1, 1 / 1.34),
    ],
)
@pytest.mark.parametrize("rule", CROSSING_RULES)
def test_crossing_time_eq_4(persons: float, metres: float, seconds: float, rule: CrossingRule) -> None:
    network = road_network(np.zeros((2, 2)), tail=[0], head=[1], length=[metres])
    field = dense_speeds(network, FlowField(jnp.full((3, 1), persons, float)), Aoki(capped=False))
    assert float(crossing_time(field.row(jnp.int32(0)), network.length[0], jnp.float32(0), rule)) == pytest.approx(
        seconds, rel=1e-5
    )


def test_a_wider_street_is_less_dense() -> None:
    # p / (d w) = 640 / (10 * 2) = 32: 1.34 / 16 m/s
    network = road_network(np.zeros((2, 2)), tail=[0], head=[1], length=[10.0], width=2.0)
    field = dense_speeds(network, FlowField(jnp.full((1, 1), 640.0)), Aoki())
    assert field.speed.tolist() == [[pytest.approx(0.08375)]]


def test_speeds_keep_segments_and_slots_and_crowds_apart() -> None:
    network = road_network(np.zeros((2, 2)), tail=[0, 1], head=[1, 0], length=[1.0, 2.0])
    volume = jnp.array([[[1.0, 64], [32, 2], [1, 2]], [[32, 64], [32, 64], [32, 64]]])  # crowd, slot, segment
    field = walking_speeds(network, FlowField(volume, 60.0), Aoki())
    np.testing.assert_allclose(
        field.speed,  # crowd, segment, slot; 1.34 / 16 = .08375
        [[[1.34, 0.08375, 1.34], [0.08375, 1.34, 1.34]], [[0.08375] * 3, [0.08375] * 3]],
        rtol=1e-5,
    )
    assert (field.count, field.slots, field.slot_seconds) == (2, 3, 60.0)
    # metres walked before each slot: 60 * 1.34 = 80.4, 60 * .08375 = 5.025
    np.testing.assert_allclose(field.covered[0], [[0, 80.4, 85.425], [0, 5.025, 85.425]], rtol=1e-5)


# --- Crossings by hand ----------------------------------------------------------------------------------------------

# Slots of 10 s at 1, 2 and 0.5 m/s on segment 0; segment 1 is always walked at 4 m/s.
HAND = speed_field(jnp.array([[1.0, 2.0, 0.5], [4.0, 4.0, 4.0]]), 10.0)


def cross(clock: float, metres: float, rule: CrossingRule = "integrated", segment: int = 0) -> float:
    return float(crossing_time(HAND.row(jnp.int32(segment)), jnp.float32(metres), jnp.float32(clock), rule))


@pytest.mark.parametrize(
    ("clock", "metres", "seconds"),
    [
        (0, 4, 4),  # all in the first slot
        (5, 3, 3),
        (0, 10, 10),  # exactly to its end
        (10, 20, 10),  # exactly the second slot
        (5, 15, 10),  # 5 m in 5 s, 10 m at 2 m/s in 5 s
        (0, 30, 20),  # two whole slots
        (5, 30, 25),  # 5 m in 5 s, 20 m in 10 s, 5 m at 0.5 m/s in 10 s
        (9, 22, 13),  # 1 m in 1 s, 20 m in 10 s, 1 m in 2 s
        (29, 1, 2),  # the last slot's speed holds after its end at 30
        (100, 3, 6),
        (15, 110, 205),  # 10 m in 5 s, 100 m at 0.5 m/s in 200 s
    ],
)
def test_integrated_crossings(clock: float, metres: float, seconds: float) -> None:
    assert cross(clock, metres) == pytest.approx(seconds, rel=1e-6)


@pytest.mark.parametrize(
    ("clock", "metres", "seconds"),
    [
        (0, 4, 4),
        (5, 30, 30),  # the speed of the moment of entry to the end
        (9.99, 30, 30),
        (10, 30, 15),
        (19.99, 30, 15),
        (20, 30, 60),
        (1000, 30, 60),
    ],
)
def test_entry_crossings(clock: float, metres: float, seconds: float) -> None:
    assert cross(clock, metres, "entry") == pytest.approx(seconds, rel=1e-6)


def test_each_segment_has_its_own_speeds() -> None:
    assert cross(5, 20, segment=1) == pytest.approx(5)
    assert cross(5, 20, "entry", segment=1) == pytest.approx(5)


def test_integrated_is_the_default() -> None:
    assert float(crossing_time(HAND.row(jnp.int32(0)), jnp.float32(30), jnp.float32(5))) == pytest.approx(25)


def test_under_the_entry_rule_one_may_leave_earlier_by_entering_later() -> None:
    # 10 m, jammed until 10 s: at 9 s one enters at 0.1 m/s for 100 s and leaves at 109; at 10 s at 10 m/s for 1 s: 11.
    clearing = speed_field(jnp.array([[0.1, 10.0]]), 10.0)

    def leave(clock: float, rule: CrossingRule) -> float:
        return clock + float(crossing_time(clearing.row(jnp.int32(0)), jnp.float32(10), jnp.float32(clock), rule))

    assert leave(9, "entry") == pytest.approx(109)
    assert leave(10, "entry") == pytest.approx(11)
    # Walking on as the jam clears: .1 m by 10 s, 9.9 m at 10 m/s in .99 s.
    assert leave(9, "integrated") == pytest.approx(10.99)
    assert leave(10, "integrated") == pytest.approx(11)


@pytest.mark.parametrize(
    ("begin", "end", "met"), [(0, 100, 200), (90, 110, 30), (150, 450, 300), (50, 50, 0), (0, 1000, 1100)]
)
def test_exposure_is_the_integral_of_density(begin: float, end: float, met: float) -> None:
    assert float(exposure(jnp.array([2.0, 1.0]), 100.0, jnp.float32(begin), jnp.float32(end))) == pytest.approx(met)


# --- Whatever the speeds --------------------------------------------------------------------------------------------


def step_through(speed: np.ndarray, slot_seconds: float, metres: float, clock: float) -> float:
    """Seconds to cross, slot after slot, in double precision: slow, and nothing like the code it checks."""
    now, ahead = float(clock), float(metres)
    slot = min(int(now // slot_seconds), len(speed) - 1)
    while slot < len(speed) - 1:
        reach = float(speed[slot]) * ((slot + 1) * slot_seconds - now)
        if reach >= ahead:
            break
        ahead -= reach
        slot += 1
        now = slot * slot_seconds
    return now + ahead / float(speed[slot]) - float(clock)


@partial(jax.jit, static_argnames=("slot_seconds", "rule"))
def seconds_to_cross(
    speed: jax.Array, slot_seconds: float, metres: jax.Array, clock: jax.Array, rule: CrossingRule = "integrated"
) -> jax.Array:
    return crossing_time(speed_field(speed, slot_seconds).row(), metres, clock, rule)


def in_double(
    speed: np.ndarray, slot_seconds: float, metres: float, clock: float, rule: CrossingRule = "integrated"
) -> float:
    """The code under test without rounding to speak of: what it computes, beside how precisely."""
    with jax.enable_x64(True):
        double = [jnp.asarray(each, jnp.float64) for each in (speed, metres, clock)]
        return float(seconds_to_cross(double[0], slot_seconds, double[1], double[2], rule))


def in_single(
    speed: np.ndarray, slot_seconds: float, metres: float, clock: float, rule: CrossingRule = "integrated"
) -> float:
    single = [jnp.asarray(each, jnp.float32) for each in (speed, metres, clock)]
    return float(seconds_to_cross(single[0], slot_seconds, single[1], single[2], rule))


def rounding(speed: np.ndarray, slot_seconds: float, metres: float, clock: float) -> float:
    """Seconds by which single precision may be off: it rounds clocks, and metres that are then walked slowly."""
    farthest = float(speed.max()) * (SLOTS * slot_seconds + clock) + metres
    latest = clock + metres / float(speed.min())
    return 8 * EPS * (farthest / float(speed.min()) + latest)


# From a jam of 30 persons/m² to the literal power law on an almost empty street.
speeds = hnp.arrays(np.float32, SLOTS, elements=st.floats(1 / 16, 20, width=32))
slot_lengths = st.sampled_from([10.0, 300.0])
metres_long = st.floats(1, 1000, width=32)
shares = st.floats(0, 1.5, allow_subnormal=False)  # of all slots' time, so that some clocks are after the last


@given(speeds, slot_lengths, metres_long, shares, shares)
def test_who_enters_later_never_leaves_earlier(
    speed: np.ndarray, slot_seconds: float, metres: float, one: float, other: float
) -> None:
    early, late = sorted(float(np.float32(share * SLOTS * slot_seconds)) for share in (one, other))
    leave_early = early + in_double(speed, slot_seconds, metres, early)
    leave_late = late + in_double(speed, slot_seconds, metres, late)
    assert leave_early <= leave_late + 1e-9 * leave_late
    # and single precision is no worse than its rounding
    leave_early = early + in_single(speed, slot_seconds, metres, early)
    leave_late = late + in_single(speed, slot_seconds, metres, late)
    assert leave_early <= leave_late + 2 * rounding(speed, slot_seconds, metres, late)


@given(speeds, slot_lengths, metres_long, shares)
def test_stepping_through_slot_by_slot_takes_as_long(
    speed: np.ndarray, slot_seconds: float, metres: float, share: float
) -> None:
    clock = float(np.float32(share * SLOTS * slot_seconds))
    expected = step_through(speed, slot_seconds, metres, clock)
    assert in_double(speed, slot_seconds, metres, clock) == pytest.approx(expected, rel=1e-9, abs=1e-9 * (1 + clock))
    assert in_single(speed, slot_seconds, metres, clock) == pytest.approx(
        expected, abs=rounding(speed, slot_seconds, metres, clock)
    )


@partial(jax.jit, static_argnames=("slot_seconds", "rule"))
def clock_on_leaving(speed: jax.Array, slot_seconds: float, metres: jax.Array, clock: jax.Array, rule: CrossingRule):
    one = speed_field(speed[None, None], slot_seconds)
    return leaving_clock(one, jnp.int32(0), jnp.int32(0), metres, clock, rule)


@given(speeds, slot_lengths, metres_long, shares)
def test_the_clock_on_leaving_is_that_on_entering_and_the_time_to_cross(
    speed: np.ndarray, slot_seconds: float, metres: float, share: float
) -> None:
    clock = float(np.float32(share * SLOTS * slot_seconds))
    for rule in CROSSING_RULES:
        single = [jnp.asarray(each, jnp.float32) for each in (speed, metres, clock)]
        left = float(clock_on_leaving(single[0], slot_seconds, single[1], single[2], rule))
        expected = clock + in_double(speed, slot_seconds, metres, clock, rule)
        assert left == pytest.approx(expected, abs=rounding(speed, slot_seconds, metres, clock))


@partial(jax.jit, static_argnames="rule")
def both_ways(speed: jax.Array, metres: jax.Array, clock: jax.Array, rule: CrossingRule):
    field = speed_field(speed, 300.0)
    each = jax.vmap(lambda segment, *rest: crossing_time(field.row(segment), *rest, rule))(jnp.arange(5), metres, clock)
    return each, crossing_times(field.speed.T, field.covered.T, 300.0, metres, clock, rule)


@pytest.mark.parametrize("rule", CROSSING_RULES)
@given(
    hnp.arrays(np.float32, (5, SLOTS), elements=st.floats(1 / 16, 20, width=32)),
    hnp.arrays(np.float32, 5, elements=metres_long),
    hnp.arrays(np.float32, 5, elements=st.floats(0, 1.5 * SLOTS * 300.0, allow_subnormal=False, width=32)),
)
def test_all_segments_at_once_take_as_long_as_each(
    rule: CrossingRule, speed: np.ndarray, metres: np.ndarray, clock: np.ndarray
) -> None:
    each, together = both_ways(*map(jnp.asarray, (speed, metres, clock)), rule)
    np.testing.assert_allclose(together, each, rtol=1e-6)


@given(speeds, slot_lengths, metres_long, shares)
def test_a_crossing_takes_time_between_the_fastest_and_the_slowest(
    speed: np.ndarray, slot_seconds: float, metres: float, share: float
) -> None:
    clock = float(np.float32(share * SLOTS * slot_seconds))
    for rule in CROSSING_RULES:
        seconds = in_double(speed, slot_seconds, metres, clock, rule)
        assert metres / speed.max() * (1 - 1e-6) <= seconds <= metres / speed.min() * (1 + 1e-6)


@given(st.floats(1 / 16, 20, width=32), slot_lengths, metres_long, shares)
def test_the_rules_agree_where_the_speed_is_constant(
    speed: float, slot_seconds: float, metres: float, share: float
) -> None:
    constant, clock = np.full(SLOTS, speed, np.float32), float(np.float32(share * SLOTS * slot_seconds))
    for rule in CROSSING_RULES:
        seconds = in_double(constant, slot_seconds, metres, clock, rule)
        assert seconds == pytest.approx(metres / speed, rel=1e-9, abs=1e-9 * (1 + clock))


@given(speeds, slot_lengths, metres_long, st.floats(0, 100, allow_subnormal=False))
def test_after_the_last_slot_the_last_speed_holds(
    speed: np.ndarray, slot_seconds: float, metres: float, later: float
) -> None:
    clock = float(np.float32((SLOTS - 1 + later) * slot_seconds))
    for rule in CROSSING_RULES:
        seconds = in_double(speed, slot_seconds, metres, clock, rule)
        assert seconds == pytest.approx(metres / speed[-1], rel=1e-9, abs=1e-9 * (1 + clock))


@given(speeds, slot_lengths, metres_long, shares)
def test_entry_takes_the_speed_of_the_moment(
    speed: np.ndarray, slot_seconds: float, metres: float, share: float
) -> None:
    clock = float(np.float32(share * SLOTS * slot_seconds))
    now = speed[min(int(clock // slot_seconds), SLOTS - 1)]
    assert in_double(speed, slot_seconds, metres, clock, "entry") == pytest.approx(metres / now, rel=1e-9)
