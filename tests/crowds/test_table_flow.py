"""Crowds from a table: rows, hours, noise and forecasts, by hand."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.crowds.counts import CountsError, LatestCounts
from sidestep.crowds.table_flow import TableFlow

VOLUME = jnp.array([[1.0, 0.0], [2.0, 0.0], [3.0, 10.0]])


@partial(jax.jit, static_argnames="slots")
def expected(flow: TableFlow, hours: list[float], slots: int) -> jax.Array:
    return flow.expected(jnp.array(hours), slots).counted


@partial(jax.jit, static_argnames="slots")
def draw(flow: TableFlow, hours: jax.Array, slots: int) -> jax.Array:
    return flow.draw(jax.random.key(3), hours, slots).counted


@partial(jax.jit, static_argnames="slots")
def ahead(flow: TableFlow, now: jax.Array, hour: float, slot: int, slots: int) -> jax.Array:
    return flow.ahead(now, jnp.float32(hour), slot, slots)


def test_without_noise_or_times_crowds_are_the_table() -> None:
    flow = TableFlow(0.9, 0.0, 300.0, VOLUME, 300.0)
    # the last slot holds
    rows = [[1, 0], [2, 0], [3, 10], [3, 10]]
    assert expected(flow, [0.0, 0.0], 4).tolist() == [rows]  # a single field: hours mean nothing
    assert draw(flow, jnp.zeros(2), 4).tolist() == [rows, rows]
    assert ahead(flow, VOLUME[0], 0, 0, 4).tolist() == rows
    assert not flow.timed
    assert flow.covers(100)
    assert flow.expected(jnp.zeros(1), 4).slot_seconds == 300


def test_longer_rows_hold_for_several_slots() -> None:
    flow = TableFlow(0.9, 0.0, 300.0, VOLUME, 600.0)
    assert expected(flow, [0.0], 6)[0, :, 0].tolist() == [1, 1, 2, 2, 3, 3]


def test_the_noise_is_lasting() -> None:
    flow = TableFlow(0.5, 0.4, 300.0, jnp.array([[100.0, 0.0]]), 300.0)
    drawn = np.asarray(draw(flow, jnp.zeros(20_000), 2))
    assert (drawn[..., 1] == 0).all()
    logs = np.log(drawn[..., 0] / 100)
    assert logs.std(axis=0) == pytest.approx([0.4, 0.4], rel=0.03)
    assert np.corrcoef(logs.T)[0, 1] == pytest.approx(0.5, abs=0.03)
    # exp(.4^2 / 2) = 1.083287
    assert expected(flow, [0.0], 2)[0].tolist() == [pytest.approx([108.3287, 0])] * 2
    # twice as many now: 2^.5 exp(.08 (1 - .25)) = 1.501652 in the next slot; nobody stays nobody
    found = ahead(flow, jnp.array([200.0, 0.0]), 0, 0, 2)
    assert found.tolist() == [[200, 0], pytest.approx([150.1652, 0], rel=1e-5)]


def test_whole_days_repeat_and_begin_by_the_clock() -> None:
    # 24 hours from Saturday noon on: row number is hours since noon
    flow = TableFlow(0.9, 0.0, 3600.0, jnp.arange(24.0)[:, None], 3600.0, 132.0)
    hours = [132.0, 10.0, 35.5]
    assert flow.repeats
    # Saturday 12:00; Monday 10:00, 22 hours after noon; Tuesday 11:30, whose first slot has its middle at 12:00
    rows = [[0, 1, 2], [22, 23, 0], [0, 1, 2]]
    assert expected(flow, hours, 3)[..., 0].tolist() == rows
    assert draw(flow, jnp.array(hours), 3)[..., 0].tolist() == rows
    assert ahead(flow, jnp.array([22.0]), 10, 0, 3).tolist() == [[22], [23], [0]]
    assert ahead(flow, jnp.array([23.0]), 10, 1, 2).tolist() == [[23], [0]]
    assert flow.timed
    assert flow.covers(0.0)


def test_other_spans_hold_their_ends() -> None:
    # Saturday 12:00 to 15:00
    flow = TableFlow(0.9, 0.0, 3600.0, VOLUME, 3600.0, 132.0)
    assert expected(flow, [132.0, 131.0, 134.0], 3)[..., 0].tolist() == [[1, 2, 3], [1, 1, 2], [3, 3, 3]]
    assert [flow.covers(hour) for hour in (131.9, 132.0, 134.9, 135.0)] == [False, True, True, False]
    assert flow.coverage == "3 hours from Saturday 12:00 on"


def test_pieces_of_a_segment_are_as_dense_as_the_whole() -> None:
    flow = TableFlow(0.9, 0.0, 300.0, VOLUME, 300.0).on_pieces(jnp.array([1, 0, 1]), jnp.array([0.25, 1.0, 0.75]))
    assert flow.volume.tolist() == [[0, 1, 0], [0, 2, 0], [2.5, 3, 7.5]]


def test_a_table_does_not_go_on_from_counts() -> None:
    latest = LatestCounts(np.ones(2), np.datetime64("2025-05-24T12", "h"), 0.0)
    with pytest.raises(CountsError) as caught:
        TableFlow(0.9, 0.0, 300.0, VOLUME, 300.0).going_on_from(latest)
    assert caught.value.field == "live"
