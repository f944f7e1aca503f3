"""Stairs, ramps, lifts, kerbs and crowds as walkers take them, by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.network.town import Town
from sidestep.walking.profile import lift_waits, own_law, paces, passable
from sidestep.walking.speed_laws import LAWS, Weidmann

ROWS = (  # kind, rise from tail to head, kerb, width
    ("footway", np.nan, 0.0, 2.0),
    ("steps", 0.5, 0.0, 2.0),
    ("steps", -0.5, 0.0, 2.0),
    ("steps", np.nan, 0.0, 2.0),
    ("footway", 0.06, 0.03, 0.9),
    ("footway", -0.08, 0.0, 2.0),
    ("footway", 0.01, 0.12, 2.0),
    ("path", np.nan, 0.0, 0.6),
    ("elevator", np.nan, 0.0, 1.5),
)
FOOTWAY, UP, DOWN, STEPS, RAMP, STEEP, KERB, NARROW, LIFT = range(len(ROWS))
TAKES_ALL = dict(stairs=True, lifts=True, least_width=0.0, highest_kerb=None, steepest=None)


def street_by_street(rows=ROWS) -> Town:
    """A line of streets, each 30 m long and walked both ways."""
    place = np.stack([np.arange(len(rows) + 1) * 3e-4, np.zeros(len(rows) + 1)], axis=1)
    ends = np.stack([np.arange(len(rows)), np.arange(1, len(rows) + 1)], axis=1)
    kind, incline, kerb, width = zip(*rows, strict=True)
    return Town.of_streets(
        ends,
        place=place,
        ids=np.arange(len(place)),
        one_way=np.zeros(len(rows), bool),
        length=np.full(len(rows), 30.0),
        width=width,
        kind=kind,
        name=("",) * len(rows),
        signals=np.zeros(len(rows)),
        crossings=np.zeros(len(rows)),
        incline=incline,
        kerb=kerb,
        points=place[ends].reshape(-1, 2),
        first=np.arange(len(rows) + 1) * 2,
        attribution="nobody",
    )


TOWN = street_by_street()


def seconds(free_speed: float = 1.34, **stairs: float) -> tuple[np.ndarray, np.ndarray]:
    """Over each street at free speed, from tail to head and back."""
    pace = paces(TOWN, free_speed, **stairs)
    assert pace is not None
    forth, back = np.split(30 / (free_speed * pace), 2)
    return forth, back


def test_stairs_take_longer_up_than_down() -> None:
    forth, back = seconds()
    level = 30 / 1.34
    # 30 / .61 = 49.180, 30 / .69 = 43.478, and where nobody knows which is which 30 / .65 = 46.154
    expected = [level, 49.180, 43.478, 46.154, level, level, level, level, level]
    np.testing.assert_allclose(forth, expected, rtol=1e-5)
    expected[UP], expected[DOWN] = expected[DOWN], expected[UP]
    np.testing.assert_allclose(back, expected, rtol=1e-5)


def test_stairs_are_in_proportion_to_level_ways_or_as_said() -> None:
    forth, _ = seconds(0.67)
    assert forth[[FOOTWAY, UP, DOWN]].tolist() == pytest.approx([30 / 0.67, 30 / 0.305, 30 / 0.345], rel=1e-5)
    forth, _ = seconds(0.67, up=0.5, down=0.6)
    assert forth[[FOOTWAY, UP, DOWN, STEPS]].tolist() == pytest.approx([30 / 0.67, 60, 50, 30 / 0.55], rel=1e-5)


def test_without_stairs_and_lifts_there_is_nothing_to_work_out() -> None:
    level = street_by_street(ROWS[:1])
    assert paces(level, 1.34) is None
    assert lift_waits(level, 60.0) is None
    assert lift_waits(TOWN, 0.0) is None


def test_lifts_take_their_time_both_ways() -> None:
    found = lift_waits(TOWN, 60.0)
    assert found is not None
    assert np.flatnonzero(found).tolist() == [LIFT, LIFT + len(ROWS)]
    assert found[LIFT] == 60


@pytest.mark.parametrize(
    ("limits", "left_out"),
    [
        ({}, set()),
        (dict(stairs=False), {UP, DOWN, STEPS}),
        (dict(lifts=False), {LIFT}),
        (dict(least_width=0.9), {NARROW}),
        (dict(least_width=0.91), {NARROW, RAMP}),
        (dict(highest_kerb=0.03), {KERB}),
        (dict(highest_kerb=0.0), {KERB, RAMP}),
        # A ramp of 6 % is taken where 6 % are; stairs are no ramps.
        (dict(steepest=0.06), {STEEP}),
        (dict(steepest=0.05), {STEEP, RAMP}),
        (
            dict(stairs=False, least_width=0.9, highest_kerb=0.03, steepest=0.06),
            {UP, DOWN, STEPS, STEEP, KERB, NARROW},
        ),
    ],
)
def test_streets_that_are_taken(limits, left_out) -> None:
    taken = passable(TOWN, **TAKES_ALL | limits)
    assert set(np.flatnonzero(~taken).tolist()) == left_out


def test_a_walker_half_as_fast_is_so_in_any_crowd() -> None:
    density = jnp.array([0.1, 0.7, 2.0, 4.0, 6.0])
    for law in LAWS.values():
        assert own_law(law, 1.34, 1.0) == law
        np.testing.assert_allclose(own_law(law, 0.67, 1.0).speed(density), law.speed(density) / 2, rtol=1e-6)


def test_crowds_that_count_four_times() -> None:
    law = own_law(Weidmann(), 0.67, 4.0)
    assert law.free_speed == 0.67
    # As among 2 persons/m²: .67 (1 - exp(-1.913 (1/2 - 1/5.4))) = .67 * .452417
    assert float(law.speed(jnp.float32(0.5))) == pytest.approx(0.67 * 0.452417, rel=1e-5)
