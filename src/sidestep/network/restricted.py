"""Restricted areas: they may always be left, and are entered only by walks that end in them."""

import numpy as np
from jaxtyping import Bool, Int

from sidestep.network.connected import components
from sidestep.network.graph import ABSENT, SHUT, Areas


def restricted_areas(
    nodes: int,
    tail: Int[np.ndarray, " segment"],
    head: Int[np.ndarray, " segment"],
    restricted: Bool[np.ndarray, " segment"],
    never_open: Bool[np.ndarray, " segment"],
) -> Areas:
    """Find the restricted areas of a town.

    An area is made of restricted streets that meet. A node is inside when all its streets are restricted; one at the
    border, where an open street ends too, belongs to no area. So that every walk can be walked, open streets that can
    be reached or left through restricted ones only belong to the area as well: in each connected part of a town, the
    nodes that are in no area are those that open streets join with most others in both directions.

    Parameters
    ----------
    nodes
        Number of nodes.
    tail, head
        Node where each segment begins and ends.
    restricted, never_open
        Segments for those only whose walk begins or ends there; segments that nobody walks.

    Returns
    -------
    Areas
        The area that each node is inside of, and the one that each segment enters from outside.
    """
    walked = ~never_open
    anybody = walked & ~restricted
    together = components(nodes, tail[anybody], head[anybody], "strong")
    part = components(nodes, tail[walked], head[walked], "weak")
    joined = np.isin(np.arange(nodes), np.concatenate([tail[anybody], head[anybody]]))
    size = np.bincount(together[joined], minlength=nodes)[together]
    order = np.lexsort((together, -size))  # of each part of the town, the nodes of the largest component come first
    _, first = np.unique(part[order], return_index=True)
    outside = joined & (together == together[order][first][part])
    of_area = walked & (restricted | ~outside[tail] | ~outside[head])
    label = components(nodes, tail[of_area], head[of_area], "weak")
    number = np.full(nodes, ABSENT, np.int32)
    _, number_of = np.unique(label[tail[of_area]], return_inverse=True)
    number[tail[of_area]] = number[head[of_area]] = number_of
    area = np.where(outside, np.int32(ABSENT), number)
    enters = np.where(of_area & outside[tail], number[tail], np.int32(ABSENT))
    return area, np.where(never_open, np.int32(SHUT), enters)
