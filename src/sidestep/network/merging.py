"""Crossings that are near each other become one, and crossings of vehicle traffic are given to one street each.

Where rows can be handled at once they are; plain loops remain only where one decision depends on the last, and run
over the few streets concerned.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from sidestep.network.geodesy import Projection, course_lengths
from sidestep.network.streets import Nodes, Streets
from sidestep.network.tags import FULL_WIDTH, WIDTHS, CrossingKind

SAME_PLACE = 0.1
"""Metres along a street within which its ends are one crossing even where nothing is to be merged."""
MOST_NEIGHBOURS = 7
"""Of a merged crossing: every crossing is padded to the exits of the busiest one."""


def assign_crossings(streets: Streets, kind: Int[np.ndarray, " node"]) -> Streets:
    """Count each crossing of vehicle traffic at the end of several streets for exactly one of them.

    That is the shortest of the footways and other ways walked on their full width, since it is the one most likely to
    lead over the carriageway; without one, the shortest street.

    Parameters
    ----------
    streets
        All streets.
    kind
        What each node is, see `sidestep.network.tags.CrossingKind`.

    Returns
    -------
    Streets
        The same streets with more ``signals`` and ``crossings``.
    """
    is_road = np.array([kind not in FULL_WIDTH for kind in WIDTHS])[streets.kind]
    street, end = np.nonzero(kind[streets.ends] > CrossingKind.NONE)
    node = streets.ends[street, end]
    order = np.lexsort((streets.length[street], is_road[street], node))
    first = order[np.diff(node[order], prepend=-1) > 0]
    street, node = street[first], node[first]
    signals, unsignalised = (
        np.bincount(street[kind[node] == each], minlength=len(streets))
        for each in (CrossingKind.SIGNALS, CrossingKind.UNSIGNALISED)
    )
    return replace(streets, signals=streets.signals + signals, crossings=streets.crossings + unsignalised)


def merge_crossings(streets: Streets, nodes: Nodes, metres: float) -> Streets:
    """Merge crossings that are joined by short streets.

    The shortest streets go first. A street stays if its merged crossing would be larger than twice ``metres`` (the
    diagonal of the box around it) or would have streets to more than ``MOST_NEIGHBOURS`` others. Only streets join
    crossings, so a bridge never merges with what is below it. The node nearest to the mean of the merged ones
    represents the crossing; the other streets are extended to it in a straight line, so that walks across the crossing
    stay about as long as they were.

    Crossings of vehicle traffic along a street that goes are passed on to the streets of the merged crossing, each to
    the one that has been given the fewest so far, and of those to the shortest.

    Parameters
    ----------
    streets
        All streets.
    nodes
        The nodes that streets join.
    metres
        Length below which a street is short.

    Returns
    -------
    Streets
        The streets that are left.
    """
    least = max(metres, SAME_PLACE)
    short = np.flatnonzero(streets.length < least)
    if not len(short):
        return streets
    known = nodes.place[~np.isnan(nodes.place[:, 0])]
    xy = np.nan_to_num(Projection.of(known).project(nodes.place))
    cluster = _clusters(streets, short[np.argsort(streets.length[short], kind="stable")], xy, 2 * least)
    gone = (streets.length < least) & (cluster[streets.ends[:, 0]] == cluster[streets.ends[:, 1]])
    total = np.stack([np.bincount(cluster, along) for along in xy.T], axis=1)
    mean = total / np.bincount(cluster)[:, None]
    order = np.lexsort((nodes.ids, np.hypot(*(xy - mean[cluster]).T), cluster))
    nearest = order[np.diff(cluster[order], prepend=-1) > 0]
    representative = nearest[cluster]
    streets = _pass_on_crossings(streets, gone, representative)
    return _extend(streets.keep(~gone), representative, nodes.place)


def _clusters(
    streets: Streets, order: Int[np.ndarray, " short"], xy: Float[np.ndarray, "node 2"], extent: float
) -> Int64[np.ndarray, " node"]:
    """Contract short streets in the order given; number the cluster, from 0, that each node then belongs to."""
    parent = list(range(len(xy)))
    low, high = xy.copy(), xy.copy()  # corners of the box around each cluster, at its root
    near = _neighbours(streets, order)

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = node = parent[parent[node]]
        return node

    for tail, head in streets.ends[order].tolist():
        a, b = root(tail), root(head)
        if a == b:
            continue
        corners = np.minimum(low[a], low[b]), np.maximum(high[a], high[b])
        diagonal = np.hypot(*(corners[1] - corners[0]))
        around = {root(node) for node in near[a] | near[b]} - {a, b}
        # Nodes at the same place merge in any case, since no street can be 0 m long.
        if diagonal == 0 or (diagonal <= extent and len(around) <= MOST_NEIGHBOURS):
            parent[b] = a
            low[a], high[a] = corners
            near[a] = around
    return np.unique([root(node) for node in range(len(xy))], return_inverse=True)[1]


def _neighbours(streets: Streets, short: Int[np.ndarray, " short"]) -> dict[int, set[int]]:
    """Find the nodes around each end of the short streets."""
    ends = np.unique(streets.ends[short])
    near: dict[int, set[int]] = {node: set() for node in ends.tolist()}
    for tail, head in streets.ends[np.isin(streets.ends, ends).any(axis=1)].tolist():
        near.get(tail, set()).add(head)
        near.get(head, set()).add(tail)
    return near


def _pass_on_crossings(
    streets: Streets, gone: Bool[np.ndarray, " street"], representative: Int[np.ndarray, " node"]
) -> Streets:
    ends = representative[streets.ends]
    heirs: dict[int, list[int]] = {node: [] for node in ends[gone, 0].tolist()}
    stays = np.flatnonzero(~gone & (ends[:, 0] != ends[:, 1]))
    for street in stays[np.argsort(streets.length[stays], kind="stable")].tolist():
        for end in ends[street].tolist():
            heirs.get(end, []).append(street)
    given: Counter[int] = Counter()
    signals, crossings = streets.signals.copy(), streets.crossings.copy()
    for street in np.flatnonzero(gone & (signals + crossings > 0)).tolist():
        if candidates := heirs[int(ends[street, 0])]:
            heir = min(candidates, key=lambda candidate: given[candidate])
            given[heir] += int(signals[street] + crossings[street])
            signals[heir] += signals[street]
            crossings[heir] += crossings[street]
    return replace(streets, signals=signals, crossings=crossings)


def _extend(streets: Streets, representative: Int[np.ndarray, " node"], place: Float[np.ndarray, "node 2"]) -> Streets:
    """Extend courses to the nodes that represent merged crossings."""
    ends = representative[streets.ends]
    before, after = (ends != streets.ends).T
    at = np.concatenate([streets.first[1:][after], streets.first[:-1][before]])
    points = np.insert(streets.points, at, place[np.concatenate([ends[after, 1], ends[before, 0]])], axis=0)
    first = streets.first + np.append(0, np.cumsum(before.astype(int) + after))
    return replace(streets, ends=ends, points=points, first=first, length=course_lengths(points, first))
