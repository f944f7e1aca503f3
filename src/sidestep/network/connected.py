"""Which nodes reach each other. SciPy is imported on use: most commands do without it."""

from typing import Literal

import numpy as np
from jaxtyping import Int


def components(
    nodes: int,
    tail: Int[np.ndarray, " segment"],
    head: Int[np.ndarray, " segment"],
    connection: Literal["strong", "weak"] = "strong",
) -> Int[np.ndarray, " node"]:
    """Number the components of a graph.

    Parameters
    ----------
    nodes
        How many there are.
    tail, head
        Where each segment begins and ends.
    connection
        ``strong``: nodes are in one component if paths lead from each to the other; ``weak``: if they are joined by
        segments of any direction.

    Returns
    -------
    Int[np.ndarray, " node"]
        Number of the component that each node is in.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(tail), np.int32), (tail, head)), shape=(nodes, nodes))
    return connected_components(links, connection=connection)[1]


def reached(
    nodes: int, tail: Int[np.ndarray, " segment"], head: Int[np.ndarray, " segment"], starts: tuple[int, ...]
) -> Int[np.ndarray, " reached"]:
    """Find the nodes to which paths lead from any of some nodes.

    Parameters
    ----------
    nodes, tail, head
        As for :func:`components`.
    starts
        Where paths begin.

    Returns
    -------
    Int[np.ndarray, " reached"]
        Their numbers, in order, those of the starts among them.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order

    links = coo_array((np.ones(len(tail), np.int32), (tail, head)), shape=(nodes, nodes)).tocsr()
    found = [breadth_first_order(links, node, return_predecessors=False) for node in starts]
    return np.unique(np.concatenate(found))
