"""The paper's grid: counts, actions, and lengths."""

import numpy as np
import pytest

from sidestep.network.graph import NetworkError, RoadNetwork
from sidestep.network.grid import DOWN, LEFT, RIGHT, UP, grid_network


def grid(side: int = 6, seed: int = 0, **more) -> RoadNetwork:
    return grid_network(side, np.random.default_rng(seed), **more)


def test_the_papers_blocks() -> None:
    network = grid()
    assert (network.nodes, network.segments, network.exits) == (36, 120, 4)
    streets = {frozenset(ends) for ends in zip(network.tail.tolist(), network.head.tolist(), strict=True)}
    assert len(streets) == 60


@pytest.mark.parametrize(("side", "segments"), [(2, 8), (3, 24), (16, 960)])
def test_other_sides(side: int, segments: int) -> None:
    # 2 side (side - 1) streets, each in both directions
    network = grid(side)
    assert (network.nodes, network.segments, network.exits) == (side**2, segments, 4)


def test_actions_are_the_papers() -> None:
    assert (UP, DOWN, RIGHT, LEFT) == (0, 1, 2, 3)
    # Node 14 stands at column 2 and row 2 of 6: up is the next row, right the next column.
    assert grid().exit_node[14].tolist() == [20, 8, 15, 13]


@pytest.mark.parametrize(
    ("node", "exits"),
    [
        (0, {UP, RIGHT}),
        (5, {UP, LEFT}),
        (30, {DOWN, RIGHT}),
        (35, {DOWN, LEFT}),
        (3, {UP, RIGHT, LEFT}),
        (32, {DOWN, RIGHT, LEFT}),
        (12, {UP, DOWN, RIGHT}),
        (17, {UP, DOWN, LEFT}),
        (7, {UP, DOWN, RIGHT, LEFT}),
        (28, {UP, DOWN, RIGHT, LEFT}),
    ],
)
def test_valid_exits_at_corners_edges_and_inside(node: int, exits: set[int]) -> None:
    assert set(np.flatnonzero(grid().valid[node])) == exits


def test_exit_tables_agree_with_the_segments() -> None:
    network = grid()
    step = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]])
    position, segment = np.asarray(network.position), np.asarray(network.exit_segment)
    for node, action in np.argwhere(network.valid).tolist():
        assert network.tail[segment[node, action]] == node
        assert network.head[segment[node, action]] == network.exit_node[node, action]
        there = position[network.exit_node[node, action]]
        assert (there - position[node]).tolist() == (550 * step[action]).tolist()
    assert sorted(segment[segment >= 0].tolist()) == list(range(120))
    assert ((segment >= 0) == np.asarray(network.valid)).all()


def test_nodes_stand_the_mean_length_apart() -> None:
    position = np.asarray(grid().position)
    assert position[0].tolist() == [0, 0]
    assert position[1].tolist() == [550, 0]
    assert position[6].tolist() == [0, 550]
    assert position[35].tolist() == [2750, 2750]
    assert np.asarray(grid(2, lengths=(10, 30)).position).tolist() == [[0, 0], [20, 0], [0, 20], [20, 20]]


def test_lengths_are_symmetric_and_fill_their_range() -> None:
    network = grid(16)
    lengths = np.asarray(network.length)
    matrix = np.asarray(network.distance_matrix())
    assert (matrix == matrix.T).all()
    assert (np.diag(matrix) == -1).all()
    assert (matrix != -1).sum() == 960
    assert (lengths >= 100).all()
    assert (lengths <= 1000).all()
    # 480 uniform draws: the mean is 550 with a standard error of 900 / sqrt(12 * 480) = 12
    assert len(np.unique(lengths)) == 480
    assert lengths.mean() == pytest.approx(550, abs=50)
    assert lengths.min() < 120
    assert lengths.max() > 980


def test_lengths_may_be_chosen() -> None:
    lengths = np.asarray(grid(lengths=(40, 50)).length)
    assert (lengths >= 40).all()
    assert (lengths <= 50).all()
    assert set(np.asarray(grid(lengths=(70, 70)).length).tolist()) == {70}


def test_the_same_seed_gives_the_same_map_and_another_another() -> None:
    assert grid(seed=3).length.tolist() == grid(seed=3).length.tolist()
    assert grid(seed=3).length.tolist() != grid(seed=4).length.tolist()


@pytest.mark.parametrize("side", [1, 0, -3])
def test_grids_without_streets(side: int) -> None:
    with pytest.raises(NetworkError) as caught:
        grid(side)
    assert caught.value.field == "side"


@pytest.mark.parametrize("lengths", [(0, 100), (-5, 100), (200, 100), (float("nan"), 100), (100, float("nan"))])
def test_impossible_lengths(lengths: tuple[float, float]) -> None:
    with pytest.raises(NetworkError) as caught:
        grid(lengths=lengths)
    assert caught.value.field == "lengths"
