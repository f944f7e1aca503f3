"""Rush hours by hand, their noise and their crowded places by statistics, and forecasts from counts."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.rush import RushFlow, ShiftingFlow

KEY = jax.random.key(1)
SLOT = 300.0
MANY = 20_000


def rush(
    base: list[float], amplitude: float = 0.0, phase: float = 0.0, phi: float = 0.5, sigma: float = 0.4
) -> RushFlow:
    """Waves of four slots."""
    every = jnp.ones(len(base))
    return RushFlow(phi, sigma, SLOT, jnp.array(base, float), amplitude * every, phase * every, 4 * SLOT)


@jax.jit
def _drawn(flow: RushFlow | ShiftingFlow, key: jax.Array) -> jax.Array:
    return flow.draw(key, jnp.zeros(MANY), 5).counted


def draw(flow: RushFlow | ShiftingFlow, key: jax.Array, slots: int = 5) -> np.ndarray:
    """The first of five slots, so that tests share compiled programs."""
    return np.asarray(_drawn(flow, key))[:, :slots]


@partial(jax.jit, static_argnames="slots")
def expected(flow: RushFlow | ShiftingFlow, slots: int) -> jax.Array:
    """Of the single field: these crowds know no hours."""
    (volume,) = flow.expected(jnp.zeros(7), slots).counted
    return volume


@partial(jax.jit, static_argnames="slots")
def ahead(flow: RushFlow | ShiftingFlow, now: jax.Array, slot: int, slots: int) -> jax.Array:
    return flow.ahead(now, jnp.float32(0), slot, slots)


@partial(jax.jit, static_argnames="slots")
def median(flow: RushFlow, slots: int) -> jax.Array:
    return flow.median(jnp.float32(0), jnp.arange(slots))


@jax.jit
def draw_noise(flow: RushFlow, key: jax.Array) -> jax.Array:
    return flow.noise(key, MANY, 5, flow.base.shape[0])


def near(found: np.ndarray, expected: float | np.ndarray, error: float | np.ndarray) -> None:
    """Within five standard errors."""
    assert (np.abs(np.asarray(found) - expected) < 5 * error).all()


# --- Rush hours -----------------------------------------------------------------------------------------------------


def test_the_wave_of_one_segment() -> None:
    # sin is 0, 1, 0, -1, 0: 100, 100 exp(.5) = 164.8721, 100, 100 exp(-.5) = 60.6531, 100
    usual = median(rush([100], 0.5), 5)
    assert usual[:, 0].tolist() == pytest.approx([100, 164.8721, 100, 60.6531, 100], rel=1e-5)
    # a quarter of a wave ahead
    usual = median(rush([100], 0.5, math.pi / 2), 3)
    assert usual[:, 0].tolist() == pytest.approx([164.8721, 100, 60.6531], rel=1e-5)


def test_the_mean_is_above_the_median() -> None:
    # exp(.4^2 / 2) = 1.083287: 108.3287, 164.8721 * 1.083287 = 178.6038
    assert rush([100], 0.5).expected(jnp.zeros(1), 2).slot_seconds == SLOT
    assert expected(rush([100], 0.5), 2).tolist() == [pytest.approx([108.3287]), pytest.approx([178.6038])]


def test_expected_is_the_mean_of_many_draws() -> None:
    flow = rush([100, 5000], 0.5, 1.0)
    drawn = np.asarray(draw(flow, KEY))
    assert drawn.shape == (MANY, 5, 2)
    near(drawn.mean(axis=0), np.asarray(expected(flow, 5)), drawn.std(axis=0) / math.sqrt(MANY))
    # half of the draws are below the median
    below = (drawn < np.asarray(median(flow, 5))).mean(axis=0)
    near(below, 0.5, 0.5 / math.sqrt(MANY))


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_the_noise_is_stationary_and_lasts(phi: float) -> None:
    noise = np.asarray(draw_noise(rush([100, 100], phi=phi), KEY))
    assert noise.shape == (MANY, 5, 2)
    near(noise.mean(axis=0), 0, 0.4 / math.sqrt(MANY))
    # as large in the first slot as in the last
    near(noise.std(axis=0), 0.4, 0.4 / math.sqrt(2 * MANY))
    for slot in range(4):
        for segment in range(2):
            lag_one = np.corrcoef(noise[:, slot, segment], noise[:, slot + 1, segment])[0, 1]
            near(lag_one, phi, (1 - phi**2) / math.sqrt(MANY))
    near(np.corrcoef(noise[:, 0, 0], noise[:, 3, 0])[0, 1], phi**3, 1 / math.sqrt(MANY))


def test_every_segment_and_crowd_has_noise_of_its_own() -> None:
    noise = np.asarray(draw_noise(rush([100, 100], phi=0.9), KEY))
    near(np.corrcoef(noise[:, 1], rowvar=False)[0, 1], 0, 1 / math.sqrt(MANY))
    near(np.corrcoef(noise[:-1, 1, 0], noise[1:, 1, 0])[0, 1], 0, 1 / math.sqrt(MANY))


def test_the_same_key_draws_the_same() -> None:
    flow = rush([100, 200], 0.5)
    first, again, other = (draw(flow, key, 4) for key in (KEY, KEY, jax.random.key(2)))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()


def test_no_segment_is_empty() -> None:
    flow = rush([0.01, 0.01])
    for volume in (expected(flow, 2), draw(flow, KEY, 2), ahead(flow, jnp.ones(2), 0, 4)):
        assert (volume == 1).all()


# --- From the counts of now -----------------------------------------------------------------------------------------


def test_ahead_of_one_segment() -> None:
    # Twice the median: 2^1, 2^.5, 2^.25 times 100, times exp(.16 (1 - fading^2) / 2) = 1, exp(.06), exp(.075):
    # 200, 141.42136 * 1.0618365 = 150.16637, 118.92071 * 1.0778842 = 128.18276
    found = ahead(rush([100]), jnp.array([200.0]), 7, 3)
    assert found[:, 0].tolist() == pytest.approx([200, 150.16637, 128.18276], rel=1e-5)


def test_ahead_follows_the_wave_from_its_own_slot() -> None:
    # without noise, as expected now is as expected later: slots 1, 2, 3, 4
    found = ahead(rush([100], 0.5, sigma=0.0), jnp.array([164.8721]), 1, 4)
    assert found[:, 0].tolist() == pytest.approx([164.8721, 100, 60.6531, 100], rel=1e-5)


def test_ahead_starts_now_and_fades_to_the_expected() -> None:
    flow = rush([100, 100, 3000], 0.5, phi=0.9)
    now = jnp.array([30.0, 400, 3000])
    found = ahead(flow, now, 3, 200)
    np.testing.assert_allclose(found[0], now, rtol=1e-5)
    np.testing.assert_allclose(found[-4:], expected(flow, 203)[-4:], rtol=1e-4)


def test_ahead_is_the_mean_of_what_follows() -> None:
    flow = rush([100, 5000], 0.5)
    drawn = np.asarray(draw(flow, KEY))
    # Each future's own forecast leaves an error whose mean is zero.
    foretold = np.asarray(jax.vmap(lambda now: ahead(flow, now, 0, 5))(jnp.asarray(drawn[:, 0])))
    error = drawn[:, 1:] - foretold[:, 1:]
    near(error.mean(axis=0), 0, error.std(axis=0) / math.sqrt(MANY))
    # and is less than that of the expected
    assert (error.std(axis=0) < drawn[:, 1:].std(axis=0)).all()


# --- Crowded places that shift --------------------------------------------------------------------------------------

# A star: segment i - 1 leads from node i to the hub 0. Nobody crowds the hub nor node 7, so segments tell of nodes.
STAR = [[node, 0] for node in range(1, 8)]
SPARED = jnp.isin(jnp.arange(8), jnp.array([0, 7]))


def shifting(
    ends: list[list[int]] = STAR, amplitude: float = 0.0, sigma: float = 0.0, spread: float = 0.0
) -> ShiftingFlow:
    """Two of six nodes are crowded by 5,000 instead of 100."""
    ordinary = rush([100.0] * len(ends), amplitude, sigma=sigma)
    return ShiftingFlow(ordinary, jnp.array(ends), SPARED, 2, 5000.0, spread)


def test_every_crowd_has_as_many_crowded_nodes() -> None:
    drawn = np.asarray(draw(shifting(), KEY, 2))
    assert set(np.unique(drawn.round(1)).tolist()) == {100, 5000}
    np.testing.assert_allclose(drawn[:, 0], drawn[:, 1])  # all day
    crowded = drawn[:, 0] > 1000
    assert (crowded.sum(axis=1) == 2).all()
    assert not crowded[:, 6].any()
    # elsewhere in every crowd: all 15 pairs of the six nodes come, and every node as often
    assert len({tuple(np.flatnonzero(row)) for row in crowded}) == 15
    near(crowded[:, :6].mean(axis=0), 1 / 3, math.sqrt(2 / 9 / MANY))


def test_segments_at_both_ends_of_a_crowded_node_are_crowded() -> None:
    # two ways through each node, in and out, and one between two spared nodes
    ends = [[node, 0] for node in range(1, 7)] + [[0, node] for node in range(1, 7)] + [[0, 7]]
    crowded = np.asarray(draw(shifting(ends), KEY, 2))[:, 0] > 1000
    np.testing.assert_array_equal(crowded[:, :6], crowded[:, 6:12])
    assert not crowded[:, 12].any()


def test_crowded_volumes_differ_as_they_should() -> None:
    drawn = np.asarray(draw(shifting(spread=500.0), KEY, 2))[:, 0]
    crowded = drawn[drawn > 1000]
    assert len(crowded) == 2 * MANY
    near(crowded.mean(), 5000, 500 / math.sqrt(2 * MANY))
    near(crowded.std(), 500, 500 / math.sqrt(4 * MANY))


def test_expected_lies_between_ordinary_and_crowded() -> None:
    # a third of the time crowded: 2/3 * 100 + 1/3 * 5,000 = 1,733.333; node 7 never
    found = expected(shifting(), 1)[0]
    assert found.tolist() == pytest.approx([1733.3333] * 6 + [100], rel=1e-5)
    # with rush hours and noise: exp(.5) in slot 1, and exp(.08): 1,733.333 * 1.786038 = 3,095.800
    found = expected(shifting(amplitude=0.5, sigma=0.4), 2)[1]
    assert found.tolist() == pytest.approx([3095.800] * 6 + [178.6038], rel=1e-5)


def test_expected_is_the_mean_over_all_places() -> None:
    flow = shifting(STAR, amplitude=0.5, sigma=0.4, spread=500.0)
    drawn = np.asarray(draw(flow, KEY, 2))
    near(drawn.mean(axis=0), np.asarray(expected(flow, 2)), drawn.std(axis=0) / math.sqrt(MANY))


def test_expected_is_the_mean_where_both_ends_may_be_crowded() -> None:
    # Neither end is among two of six: 4/6 * 3/5 = .4, so crowded in .6: .4 * 100 + .6 * 5,000 = 3,040
    flow = shifting([[1, 2]])
    drawn = np.asarray(draw(flow, KEY, 2))
    near(drawn.mean(), 3040, drawn.std() / math.sqrt(MANY))
    assert float(expected(flow, 1)[0, 0]) == pytest.approx(3040, rel=1e-5)


def test_ahead_tells_crowded_from_ordinary() -> None:
    flow = shifting(amplitude=0.5, sigma=0.4)
    # In slot 1 median volumes are 164.9 and 8,244; in between, at 100 exp(.5) sqrt(50) = 1,165.8, they part.
    now = jnp.array([100.0, 165, 1150, 1180, 8000, 12_000, 165])
    found = ahead(flow, now, 1, 101)
    np.testing.assert_allclose(found[0], now, rtol=1e-5)
    # At last, in slot 101, which is as slot 1: 100 * 1.786038 and 5,000 * 1.786038
    few, many = 178.6038, 8930.19
    np.testing.assert_allclose(found[-1], [few, few, few, many, many, many, few], rtol=1e-4)
    # on the way there nearer and nearer: half of the ratio's logarithm after a slot
    mean = 100 * math.exp(0.06)
    np.testing.assert_allclose(found[1, 0], mean * (100 / 164.8721) ** 0.5, rtol=1e-4)


def test_shifting_the_same_key_draws_the_same() -> None:
    flow = shifting(sigma=0.4, spread=500.0)
    first, again, other = (np.asarray(draw(flow, key, 2)) for key in (KEY, KEY, jax.random.key(2)))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(axis=(1, 2)).all()
