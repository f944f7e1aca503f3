"""Fewer crossings and streets: crossings near each other become one, loops and parallel streets go, chains are joined.

Where rows can be handled at once they are; plain loops remain only where one decision depends on the last, and run
over the few streets concerned.
"""

from array import array
from collections import Counter
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from sidestep.network.geodesy import Projection, course_lengths
from sidestep.network.streets import Nodes, Streets, ranges
from sidestep.network.tags import FULL_WIDTH, WIDTHS, CrossingKind

SAME_PLACE = 0.1
"""Metres along a street within which its ends are one crossing even where nothing is to be merged."""
MOST_NEIGHBOURS = 7
"""Of a merged crossing: every crossing is padded to the exits of the busiest one."""
JOINED = "crossing: two streets joined into one"
"""What reports call a node that goes since just two streets meet there."""

_MIN_EXCESS = 0.01  # m; streets that differ by less are the same street drawn twice


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
        The same streets with more ``traffic``.
    """
    is_road = np.array([kind not in FULL_WIDTH for kind in WIDTHS])[streets.kind]
    street, end = np.nonzero(kind[streets.ends] > CrossingKind.NONE)
    node = streets.ends[street, end]
    order = np.lexsort((streets.length[street], is_road[street], node))
    first = order[np.diff(node[order], prepend=-1) > 0]
    street, node = street[first], node[first]
    traffic = streets.traffic.copy()
    np.add.at(traffic, (street, kind[node] - CrossingKind.UNSIGNALISED), 1)
    return replace(streets, traffic=traffic)


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
    ordinary = streets.category == 0
    streets = replace(streets, length=np.maximum(streets.length, ~ordinary * SAME_PLACE))
    short = np.flatnonzero(ordinary & (streets.length < least))
    if not len(short):
        return streets
    known = nodes.place[~np.isnan(nodes.place[:, 0])]
    xy = np.nan_to_num(Projection.of(known).project(nodes.place))
    cluster = _clusters(streets, short[np.argsort(streets.length[short], kind="stable")], xy, 2 * least)
    total = np.stack([np.bincount(cluster, along) for along in xy.T], axis=1)
    mean = total / np.bincount(cluster)[:, None]
    order = np.lexsort((nodes.ids, np.hypot(*(xy - mean[cluster]).T), cluster))
    nearest = order[np.diff(cluster[order], prepend=-1) > 0]
    ends = nearest[cluster][streets.ends]
    gone = ordinary & (streets.length < least) & (ends[:, 0] == ends[:, 1])
    streets = _pass_on_traffic(streets, gone, ends)
    return _extend(streets.keep(~gone), ends[~gone], nodes.place)


def simplify(streets: Streets, metres: float) -> tuple[Streets, Counter[str]]:
    """Drop loops and parallel streets, and merge nodes of degree two, until nothing changes.

    Parameters
    ----------
    streets
        All streets.
    metres
        By how much longer than a parallel street another must be to stay.

    Returns
    -------
    Streets, Counter
        The streets that are left, and how many went, by reason.
    """
    fewer: Counter[str] = Counter()
    before = -1
    while len(streets) != before:
        before = len(streets)
        streets = streets.keep(streets.ends[:, 0] != streets.ends[:, 1])
        fewer["street: loop"] += before - len(streets)
        single = streets.keep(~_parallel(streets, metres))
        fewer["street: parallel to a shorter one"] += len(streets) - len(single)
        streets = merge_degree_two(single)
        fewer[JOINED] += len(single) - len(streets)
    return streets, fewer


def merge_degree_two(streets: Streets) -> Streets:
    """Join the streets at nodes where just two meet.

    A node stays where a one-way street meets another of another direction, or one that is walked both ways, and where
    streets of different categories meet. Joined streets have the mean width and incline by length, the kind and name of
    the longer part, and the highest kerb. A town that is one ring stays as it is.

    Parameters
    ----------
    streets
        All streets.

    Returns
    -------
    Streets
        The joined streets.
    """
    end, starts = _chains(streets)
    if len(starts) in (0, len(streets)):
        return streets
    border = np.append(starts, len(end))
    chain = np.repeat(np.arange(len(starts)), np.diff(border))
    street, back = np.divmod(end, 2)
    step = 1 - 2 * back
    # Each piece but the first of a chain begins where the last one ended: that point is there already.
    later = np.diff(chain, prepend=-1) == 0
    counts = np.diff(streets.first)[street] - later
    begin = np.where(back, streets.first[street + 1] - 1, streets.first[street]) + step * later
    order, first = ranges(begin, counts, step)
    length = streets.length[street]
    total = np.add.reduceat(length, starts)
    ends = streets.ends.ravel()  # numbered as by _chains
    rise = length * streets.incline[street] * step
    return Streets(
        ends=np.stack([ends[end[starts]], ends[end[border[1:] - 1] ^ 1]], axis=1),
        one_way=streets.one_way[street[starts]],
        length=total,
        width=np.add.reduceat(length * streets.width[street], starts) / total,
        kind=_longest_part(streets.kind[street], chain, length),
        name=_longest_part(streets.name[street], chain, length),
        traffic=np.add.reduceat(streets.traffic[street], starts),
        opening=streets.opening[street[starts]],
        restricted=streets.restricted[street[starts]],
        incline=np.add.reduceat(rise, starts) / total,
        kerb=np.maximum.reduceat(streets.kerb[street], starts),
        points=streets.points[order],
        first=first[border],
    )


def _clusters(
    streets: Streets, order: Int[np.ndarray, " short"], xy: Float[np.ndarray, "node 2"], extent: float
) -> Int64[np.ndarray, " node"]:
    """Contract short streets in the order given; number the cluster, from 0, that each node then belongs to."""
    parent = list(range(len(xy)))
    low, high = xy.copy(), xy.copy()  # corners of the box around each cluster, at its root
    near: dict[int, set[int]] = {node: set() for node in np.unique(streets.ends[order]).tolist()}
    for tail, head in streets.ends[np.isin(streets.ends, list(near)).any(axis=1)].tolist():
        near.get(tail, set()).add(head)
        near.get(head, set()).add(tail)

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


def _pass_on_traffic(streets: Streets, gone: Bool[np.ndarray, " street"], ends: Int[np.ndarray, "street 2"]) -> Streets:
    """Pass crossings of vehicle traffic on removed streets on to other streets of the same merged crossing."""
    heirs: dict[int, list[int]] = {node: [] for node in ends[gone, 0].tolist()}
    stays = np.flatnonzero(~gone & (ends[:, 0] != ends[:, 1]))
    for street in stays[np.argsort(streets.length[stays], kind="stable")].tolist():
        for end in ends[street].tolist():
            heirs.get(end, []).append(street)
    given: Counter[int] = Counter()
    traffic = streets.traffic.copy()
    for street in np.flatnonzero(gone & traffic.any(axis=1)).tolist():
        if candidates := heirs[int(ends[street, 0])]:
            heir = min(candidates, key=lambda candidate: given[candidate])
            given[heir] += int(traffic[street].sum())
            traffic[heir] += traffic[street]
    return replace(streets, traffic=traffic)


def _extend(streets: Streets, ends: Int[np.ndarray, "street 2"], place: Float[np.ndarray, "node 2"]) -> Streets:
    """Extend courses to other ends, which represent merged crossings."""
    before, after = (ends != streets.ends).T
    at = np.concatenate([streets.first[1:][after], streets.first[:-1][before]])
    points = np.insert(streets.points, at, place[np.concatenate([ends[after, 1], ends[before, 0]])], axis=0)
    first = streets.first + np.append(0, np.cumsum(before.astype(int) + after))
    return replace(streets, ends=ends, points=points, first=first, length=course_lengths(points, first))


def _parallel(streets: Streets, metres: float) -> Bool[np.ndarray, " street"]:
    """Find streets hardly longer than others between the same crossings, in all directions that they are walked."""
    alike = np.column_stack([np.sort(streets.ends, axis=1), streets.category])
    _, pair, size = np.unique(alike, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((streets.one_way, streets.length))
    least = max(metres, _MIN_EXCESS)
    dropped = np.zeros(len(streets), bool)
    shortest: dict[tuple[int, int, int], float] = {}
    for street in order[size[pair[order]] > 1].tolist():
        tail, head = streets.ends[street].tolist()
        length, group = float(streets.length[street]), int(pair[street])
        directions = [(group, tail, head)] if streets.one_way[street] else [(group, tail, head), (group, head, tail)]
        dropped[street] = all(length - shortest.get(direction, -np.inf) < least for direction in directions)
        for direction in directions:
            shortest.setdefault(direction, length)
    return dropped


def _chains(streets: Streets) -> tuple[Int64[np.ndarray, " piece"], Int64[np.ndarray, " chain"]]:
    """Order streets by the chains they form.

    Returns
    -------
    Int64[np.ndarray, " piece"], Int64[np.ndarray, " chain"]
        Each street as the end at which it is entered: 2 i is the tail of street i, 2 i + 1 its head. And where among
        these each chain starts; none does in a town that is one ring.
    """
    node = streets.ends.ravel()
    order = np.argsort(node, kind="stable")
    _, begins, degree = np.unique(node[order], return_index=True, return_counts=True)
    pairs = begins[degree == 2]
    one, two = order[pairs], order[pairs + 1]
    single, category = streets.one_way[one >> 1], streets.category
    fits = (one >> 1 != two >> 1) & (single == streets.one_way[two >> 1]) & (~single | ((one ^ two) & 1 == 1))
    fits &= category[one >> 1] == category[two >> 1]
    joined = np.full(len(node), -1, np.int64)  # the end that each end is joined to, -1 where there is none
    joined[one[fits]], joined[two[fits]] = two[fits], one[fits]
    free = joined.reshape(-1, 2) < 0
    free[streets.one_way, 1] = False  # one-way chains are entered at their tails
    mate, pieces, starts = joined.tolist(), array("q"), array("q")
    seen = [False] * len(streets)
    for start in np.flatnonzero(free).tolist():
        if seen[start >> 1]:
            continue  # the other end of a chain
        starts.append(len(pieces))
        end = start
        while end >= 0:
            seen[end >> 1] = True
            pieces.append(end)
            end = mate[end ^ 1]
    return np.array(pieces, np.int64), np.array(starts, np.int64)


def _longest_part(
    code: Int[np.ndarray, " piece"], chain: Int[np.ndarray, " piece"], length: Float[np.ndarray, " piece"]
) -> Int64[np.ndarray, " chain"]:
    """Find the code that the greatest length of each chain has."""
    codes = int(code.max()) + 1
    key, which = np.unique(chain * codes + code, return_inverse=True)
    of, found = np.divmod(key, codes)
    order = np.lexsort((-np.bincount(which, length), of))
    return found[order[np.diff(of, prepend=-1) > 0]]
