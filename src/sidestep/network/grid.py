"""Grid maps: the paper's 5 x 5 blocks are 6 x 6 nodes, 60 streets and 120 directed segments."""

import numpy as np

from sidestep.network.graph import NetworkError, RoadNetwork, road_network

UP, DOWN, RIGHT, LEFT = range(4)
"""The paper's actions (eq. 11), and the exits of a grid's nodes."""
STEP = {UP: (0, 1), DOWN: (0, -1), RIGHT: (1, 0), LEFT: (-1, 0)}
"""Columns and rows by which each action moves."""
LENGTHS = (100.0, 1000.0)
"""The paper's shortest and longest street in metres."""


def grid_network(side: int, rng: np.random.Generator, lengths: tuple[float, float] = LENGTHS) -> RoadNetwork:
    """Draw a square grid of streets whose lengths are uniform and the same in both directions.

    Node ``y * side + x`` is at column x and row y. Random lengths fit no plane, so nodes stand the mean length apart:
    straight-line distances come from these positions and may exceed the walking distance.

    Parameters
    ----------
    side
        Nodes along one side, at least 2.
    rng
        Source of the lengths.
    lengths
        Shortest and longest street in metres.

    Returns
    -------
    RoadNetwork
        The grid; exits are the paper's actions.

    Raises
    ------
    NetworkError
        A side of fewer than 2 nodes, or lengths that are not positive and in order.
    """
    if side < 2:
        raise NetworkError(f"a grid needs at least 2 nodes a side, not {side}", field="side")
    low, high = lengths
    if not 0 < low <= high:
        raise NetworkError(f"street lengths must be positive and in order, not {low} to {high} m", field="lengths")
    node = np.arange(side * side)
    xy = np.stack([node % side, node // side], axis=1)
    onto = xy + np.array(list(STEP.values()))[:, None]
    action, tail = np.nonzero(((onto >= 0) & (onto < side)).all(axis=2))
    head = onto[action, tail] @ [1, side]
    pair = np.minimum(tail, head) * side * side + np.maximum(tail, head)
    streets, street = np.unique(pair, return_inverse=True)
    length = rng.uniform(low, high, len(streets))[street]
    return road_network(xy * (low + high) / 2, tail, head, length, exit_of=action, exits=4)
