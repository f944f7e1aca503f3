"""Virtual grid maps: the paper's 5 x 5 blocks are 6 x 6 nodes, 60 streets and 120 directed segments."""

import numpy as np

from sidestep.network.graph import NetworkError, RoadNetwork, road_network

UP, DOWN, RIGHT, LEFT = range(4)  # the paper's actions, eq. 11
STEP = {UP: (0, 1), DOWN: (0, -1), RIGHT: (1, 0), LEFT: (-1, 0)}
LENGTHS = (100.0, 1000.0)  # m, the paper's range


def grid_network(side: int, rng: np.random.Generator, lengths: tuple[float, float] = LENGTHS) -> RoadNetwork:
    """Draw a square grid of streets whose lengths are uniform and the same in both directions.

    The random lengths fit no plane, so nodes stand at the mean length apart: straight-line distances come from these
    coordinates and may exceed the walking distance. Node ``y * side + x`` is at column x and row y.

    Parameters
    ----------
    side
        Nodes along one side, at least 2.
    rng
        Source of the lengths.
    lengths
        Shortest and longest street in metres.
    """
    if side < 2:
        raise NetworkError(f"a grid needs at least 2 nodes a side, not {side}")
    shortest, longest = lengths
    if not 0 < shortest <= longest:
        raise NetworkError(f"street lengths must be positive and in order, not {shortest} to {longest} m")
    spacing = (shortest + longest) / 2
    node = np.arange(side * side)
    x, y = node % side, node // side
    tail, head, exit_of = [], [], []
    for action, (dx, dy) in STEP.items():
        there = (x + dx >= 0) & (x + dx < side) & (y + dy >= 0) & (y + dy < side)
        tail.append(node[there])
        head.append(node[there] + dx + dy * side)
        exit_of.append(np.full(there.sum(), action))
    tails, heads = np.concatenate(tail), np.concatenate(head)
    street_length = {}
    for i, j in sorted({(min(i, j), max(i, j)) for i, j in zip(tails.tolist(), heads.tolist(), strict=True)}):
        street_length[i, j] = street_length[j, i] = rng.uniform(shortest, longest)
    length = [street_length[i, j] for i, j in zip(tails.tolist(), heads.tolist(), strict=True)]
    position = np.stack([x, y], axis=1) * spacing
    return road_network(position, tails, heads, length, exit_of=np.concatenate(exit_of), exits=4)
