"""Closed rings from the pieces that a multipolygon relation names."""

from collections import defaultdict
from collections.abc import Iterable, Sequence


def closed_rings(pieces: Iterable[Sequence[int]]) -> tuple[list[list[int]], list[list[int]]]:
    """Join pieces whose ends are the same nodes to rings.

    Parameters
    ----------
    pieces
        Node numbers of each piece; one that ends where it begins is a ring.

    Returns
    -------
    list, list
        Rings, whose last node is their first; and what does not close.
    """
    rings: list[list[int]] = []
    rest: dict[int, list[int]] = {}  # nodes of pieces that are not yet part of a ring, by number
    at: defaultdict[int, list[int]] = defaultdict(list)  # those that begin or end at each node
    for number, piece in enumerate(pieces):
        nodes = list(piece)
        if len(nodes) < 2:
            continue
        if nodes[0] == nodes[-1]:
            rings.append(nodes)
            continue
        rest[number] = nodes
        at[nodes[0]].append(number)
        at[nodes[-1]].append(number)
    gaps: list[list[int]] = []
    while rest:
        _, chain = rest.popitem()
        for _ in range(2):  # onwards from its end, then from its beginning
            while chain[0] != chain[-1] and (found := [number for number in at[chain[-1]] if number in rest]):
                nodes = rest.pop(found[0])
                chain += nodes[1:] if nodes[0] == chain[-1] else nodes[-2::-1]
            if chain[0] != chain[-1]:
                chain.reverse()
        (rings if chain[0] == chain[-1] else gaps).append(chain)
    return rings, gaps
