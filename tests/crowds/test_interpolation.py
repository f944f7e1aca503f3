"""How crowds fade along the streets around sensors: distances and shares by hand, and what must hold anywhere."""

from math import exp

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sidestep.crowds.interpolation import FADED, NEAR, InterpolationWeights, interpolation_weights, walking_distances
from sidestep.network.graph import NetworkError, RoadNetwork, road_network


def streets(*ends: tuple[int, int, float], one_way: bool = False) -> RoadNetwork:
    """Segment i is street i from its first end to its second; after them all streets backwards, if not one-way."""
    tail, head, length = (np.array(column) for column in zip(*ends, strict=True))
    if not one_way:
        tail, head, length = np.r_[tail, head], np.r_[head, tail], np.r_[length, length]
    return road_network(np.zeros((int(max(tail.max(), head.max())) + 1, 2)), tail, head, length)


# Segments 0 to 4 lead to the right, 5 to 9 back, 100 m each:  0 --- 1 --- 2 --- 3 --- 4 --- 5
LINE = streets(*((node, node + 1, 100.0) for node in range(5)))


def shares(spread: InterpolationWeights, sensors: int) -> np.ndarray:
    """Of each sensor in what each segment hears, [segment, sensor]."""
    dense = np.zeros((len(spread.sensor), sensors))
    np.add.at(dense, (np.arange(len(dense))[:, None], np.asarray(spread.sensor)), np.asarray(spread.weight))
    return dense


def heard(network: RoadNetwork, at: list[int], reach: float) -> np.ndarray:
    return shares(interpolation_weights(network, np.array(at), reach), len(at))


# --- Distances ------------------------------------------------------------------------------------------------------


def test_from_middle_to_middle_in_either_direction() -> None:
    away = walking_distances(LINE, np.array([1, 6]))
    assert away.tolist() == [[100, 0, 100, 200, 300] * 2] * 2


def test_of_parallel_streets_the_shorter_is_walked() -> None:
    #  3 --- 0 === 1 --- 2: 100 m, then 100 or 300 m, then 100 m
    network = streets((3, 0, 100), (0, 1, 300), (0, 1, 100), (1, 2, 100))
    away = walking_distances(network, np.array([0, 1, 2]))
    # 50 + 100 + 50 m to the other end; the middle of the long one is 150 m from both of its ends.
    assert away[:, :4].tolist() == [[0, 200, 100, 200], [200, 0, 200, 200], [100, 200, 0, 100]]


def test_crowds_walk_one_way_streets_both_ways() -> None:
    # 0 > 1 > 2 > 0 of 100, 100 and 400 m. Against the one-way street it is 50 + 200 m from the first to the last.
    away = walking_distances(streets((0, 1, 100), (1, 2, 100), (2, 0, 400), one_way=True), np.array([0, 2]))
    assert away.tolist() == [[0, 100, 250], [250, 250, 0]]


def test_no_farther_than_the_limit() -> None:
    # From the end of street 0 it is 50 m + 100 m to node 2, and 200 m to node 3, which is too far.
    away = walking_distances(LINE, np.array([0]), limit=150.0)[0, :5]
    assert away.tolist() == [0, 100, 200, np.inf, np.inf]


# --- Shares ---------------------------------------------------------------------------------------------------------


def test_both_directions_hear_one_sensor_alike() -> None:
    # 0, 100, 200, 300 and 400 m at a reach of 100 m
    fading = [exp(-streets_away) for streets_away in range(5)]
    for segment in (0, 5):
        np.testing.assert_allclose(heard(LINE, [segment], 100.0)[:, 0], fading * 2, rtol=1e-6)


def test_nothing_is_heard_beyond_six_reaches() -> None:
    assert FADED == 6
    # At 40 m, 200 m are 5 reaches and 300 m are 7.5.
    np.testing.assert_allclose(heard(LINE, [0], 40.0)[:5, 0], [1, exp(-2.5), exp(-5), 0, 0], rtol=1e-6)


def test_shares_are_divided_by_their_sum_only_above_one() -> None:
    # Sensors on streets 0 and 2: street 1 hears both at 100 m, .735759 together; streets 0 and 2 hear 1 + .135335.
    found = heard(LINE, [0, 2], 100.0)[:4]
    here, there = 1 / 1.135335, 0.135335 / 1.135335
    np.testing.assert_allclose(
        found, [[here, there], [0.367879, 0.367879], [there, here], [0.049787, 0.367879]], rtol=1e-5
    )


def test_sensors_on_one_street_share_it() -> None:
    np.testing.assert_allclose(heard(LINE, [1, 6], 100.0)[[1, 6]], 0.5)


def test_the_four_nearest_are_heard() -> None:
    assert NEAR == 4
    spread = interpolation_weights(LINE, np.arange(5), 1000.0)
    assert spread.sensor.shape == (10, 4)
    # Street 0 hears 0, 100, 200 and 300 m: 1, .904837, .818731, .740818, together 3.464386
    found = shares(spread, 5)
    np.testing.assert_allclose(found[0], [0.288651, 0.261183, 0.236328, 0.213838, 0], rtol=1e-5)
    np.testing.assert_allclose(found[[4, 9]], found[[0, 5], ::-1])
    np.testing.assert_allclose(found.sum(axis=1), 1, rtol=1e-6)


def test_everywhere_by_hand() -> None:
    spread = InterpolationWeights(jnp.array([[0, 2], [1, 0]]), jnp.array([[0.5, 0.25], [1.0, 0.0]]))
    # .5 * 2 + .25 * 8 and 4; then with other crowds
    assert spread.everywhere(jnp.array([2.0, 4, 8])).tolist() == [3, 4]
    assert spread.everywhere(jnp.array([[[2.0, 4, 8]], [[0, 1, 4]]])).tolist() == [[[3, 4]], [[1, 1]]]


@pytest.mark.parametrize(
    ("at", "reach", "says"),
    [
        ([], 100.0, "segments 0 to 9, not []"),
        ([0, 10], 100.0, "segments 0 to 9, not [0, 10]"),
        ([-1], 100.0, "segments 0 to 9, not [-1]"),
        ([0], 0.0, "positive number of metres, not 0.0"),
        ([0], float("inf"), "positive number of metres, not inf"),
        ([0], float("nan"), "positive number of metres, not nan"),
    ],
)
def test_sensors_that_cannot_be(at: list[int], reach: float, says: str) -> None:
    with pytest.raises(NetworkError) as caught:
        interpolation_weights(LINE, np.array(at, np.int64), reach)
    assert says in str(caught.value)


# --- What holds anywhere --------------------------------------------------------------------------------------------

CROSSINGS = 6
RING = [(node, (node + 1) % CROSSINGS) for node in range(CROSSINGS)] + [(0, 3), (1, 5), (0, 1)]


@settings(max_examples=40)
@given(
    hnp.arrays(np.float64, len(RING), elements=st.floats(1, 500)),
    st.lists(st.integers(0, 2 * len(RING) - 1), min_size=5, max_size=5),
    st.floats(5, 1000),
)
def test_shares_fade_with_the_distance(length: np.ndarray, at: list[int], reach: float) -> None:
    # Parallel streets of one length could not be told apart.
    length = np.append(length[:-1], length[0] + length[-1])
    network = streets(*((tail, head, metres) for (tail, head), metres in zip(RING, length, strict=True)))
    spread = interpolation_weights(network, np.array(at), reach)
    weight, sensor = np.asarray(spread.weight), np.asarray(spread.sensor)
    assert ((weight >= 0) & (weight <= 1)).all()
    assert (weight.sum(axis=1) <= 1 + 1e-6).all()
    np.testing.assert_allclose(weight[: len(RING)], weight[len(RING) :])
    # By hand: between the ends of all streets by Floyd and Warshall, then to the middles.
    between = np.where(np.eye(CROSSINGS), 0, np.inf)
    for (tail, head), metres in zip(RING, length, strict=True):
        between[tail, head] = between[head, tail] = min(between[tail, head], metres)
    for node in range(CROSSINGS):
        between = np.minimum(between, between[:, [node]] + between[node])
    tail, head, metres = (np.asarray(part) for part in (network.tail, network.head, network.length))
    for segment in range(network.segments):
        away = [
            0.0
            if one % len(RING) == segment % len(RING)
            else (metres[one] + metres[segment]) / 2
            + min(between[a, b] for a in (tail[one], head[one]) for b in (tail[segment], head[segment]))
            for one in at
        ]
        nearest = sorted(away)[:NEAR]
        heard = np.array(nearest) < FADED * reach
        np.testing.assert_allclose(np.array(away)[sensor[segment]][heard], np.array(nearest)[heard], rtol=1e-5)
        faded = np.array([exp(-metres / reach) for metres in nearest])
        faded[faded < exp(-FADED)] = 0
        np.testing.assert_allclose(weight[segment], faded / max(faded.sum(), 1), atol=3e-3)


@settings(max_examples=25)
@given(hnp.arrays(np.float32, (2, 3), elements=st.floats(0, 8, width=32)), st.floats(0, 4, width=32))
def test_twice_as_many_at_the_sensors_are_twice_as_many_everywhere(sensed: np.ndarray, times: float) -> None:
    spread = interpolation_weights(LINE, np.array([0, 3, 9]), 100.0)
    one, other = (np.asarray(spread.everywhere(jnp.asarray(row))) for row in sensed)
    both = np.asarray(spread.everywhere(jnp.asarray(sensed[0] + times * sensed[1])))
    np.testing.assert_allclose(both, one + times * other, rtol=1e-5, atol=1e-5)
    assert (one <= sensed[0].max() * (1 + 1e-6)).all()
