"""Crossings that are near each other become one, and crossings of vehicle traffic are given to one street each.

Where rows can be handled at once they are; plain loops remain only where one decision depends on the last, and run
over the few streets concerned.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from sidestep.network.geodesy import course_lengths
from sidestep.network.streets import Streets, ranges
from sidestep.network.tags import CrossingKind

SAME_PLACE = 0.1
"""Metres along a street within which its ends are one crossing even where nothing is to be merged."""
MOST_NEIGHBOURS = 7
"""Of a merged crossing: every crossing is padded to the exits of the busiest one."""


def assign_crossings(
    streets: Streets, kind: Int[np.ndarray, " node"], full_width: Bool[np.ndarray, " street"]
) -> Streets:
    """Count each crossing of vehicle traffic at the end of several streets for exactly one of them.

    That is the shortest of the footways and other ways walked on their full width, since it is the one most likely to
    lead over the carriageway; without one, the shortest street.

    Parameters
    ----------
    streets
        All streets.
    kind
        What each node is, see `sidestep.network.tags.CrossingKind`.
    full_width
        Which streets are walked on their full width.

    Returns
    -------
    Streets
        The same streets with more ``signals`` and ``crossings``.
    """
    street = np.tile(np.arange(len(streets)), 2)
    node = streets.ends.T.ravel()
    at = kind[node] > CrossingKind.NONE
    street, node = street[at], node[at]
    order = np.lexsort((street, streets.length[street], ~full_width[street], node))
    street, node = street[order], node[order]
    once = np.diff(node, prepend=-1) > 0
    street, node = street[once], node[once]
    signals, unsignalised = (
        np.bincount(street[kind[node] == each], minlength=len(streets))
        for each in (CrossingKind.SIGNALS, CrossingKind.UNSIGNALISED)
    )
    return replace(streets, signals=streets.signals + signals, crossings=streets.crossings + unsignalised)


def merge_crossings(
    streets: Streets,
    place: Float[np.ndarray, "node 2"],
    xy: Float[np.ndarray, "node 2"],
    ids: Int[np.ndarray, " node"],
    metres: float,
) -> tuple[Streets, int]:
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
    place, xy, ids
        Longitude and latitude, metres on a plane, and OpenStreetMap's number of each node.
    metres
        Length below which a street is short.

    Returns
    -------
    Streets, int
        The streets that are left, and how many went.
    """
    least = max(metres, SAME_PLACE)
    short = np.flatnonzero(streets.length < least)
    if not len(short):
        return streets, 0
    cluster = _clusters(streets, short[np.argsort(streets.length[short], kind="stable")], xy, 2 * least)
    gone = (streets.length < least) & (cluster[streets.tail] == cluster[streets.head])
    total = np.stack([np.bincount(cluster, xy[:, axis]) for axis in (0, 1)], axis=1)
    mean = total / np.maximum(np.bincount(cluster), 1)[:, None]
    order = np.lexsort((ids, np.hypot(*(xy - mean[cluster]).T), cluster))
    nearest = np.zeros(len(mean), np.int64)
    nearest[cluster[order[::-1]]] = order[::-1]  # the last to be written is the nearest
    representative = nearest[cluster]
    streets = _pass_on_crossings(streets, gone, representative)
    return _extend(streets.keep(~gone), representative, place), int(gone.sum())


def _clusters(
    streets: Streets, order: Int[np.ndarray, " short"], xy: Float[np.ndarray, "node 2"], extent: float
) -> Int64[np.ndarray, " node"]:
    """Contract short streets in the order given; number the cluster that each node then belongs to."""
    parent = list(range(len(xy)))
    box: dict[int, tuple[float, float, float, float]] = {}
    near = _neighbours(streets, order)

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = node = parent[parent[node]]
        return node

    for tail, head in streets.ends[order].tolist():
        a, b = root(tail), root(head)
        if a == b:
            continue
        (west, south, east, north), other = (box.get(i, (*xy[i].tolist(), *xy[i].tolist())) for i in (a, b))
        west, south = min(west, other[0]), min(south, other[1])
        east, north = max(east, other[2]), max(north, other[3])
        around = {root(node) for node in near[a] | near[b]} - {a, b}
        # Nodes at the same place merge in any case, since no street can be 0 m long.
        same = (west, south) == (east, north)
        if same or (np.hypot(east - west, north - south) <= extent and len(around) <= MOST_NEIGHBOURS):
            parent[b] = a
            box[a] = (west, south, east, north)
            near[a] = around
    return np.array([root(node) for node in range(len(xy))], np.int64)


def _neighbours(streets: Streets, short: Int[np.ndarray, " short"]) -> dict[int, set[int]]:
    """Find the nodes around each end of the short streets."""
    ends = np.unique(streets.ends[short])
    near: dict[int, set[int]] = {node: set() for node in ends.tolist()}
    touching = np.isin(streets.ends, ends).any(axis=1)
    for tail, head in streets.ends[touching].tolist():
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
    tail, head = representative[streets.ends].T
    before, after = tail != streets.tail, head != streets.head
    counts = np.diff(streets.first)
    _, first = ranges(streets.first[:-1], counts + before + after)
    to, _ = ranges(first[:-1] + before, counts)
    points = np.empty((first[-1], 2))
    points[to] = streets.points
    points[first[:-1][before]] = place[tail[before]]
    points[first[1:][after] - 1] = place[head[after]]
    return replace(streets, tail=tail, head=head, points=points, first=first, length=course_lengths(points, first))
