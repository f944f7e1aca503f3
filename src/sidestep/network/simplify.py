"""Fewer crossings and streets: loops and parallel streets go, chains are joined.

Where rows can be handled at once they are; plain loops remain only where one decision depends on the last, and run
over the few streets concerned.
"""

from array import array
from collections import Counter
from dataclasses import replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Int64

from sidestep.network.geodesy import Projection
from sidestep.network.streets import LONG_LOOP, Streets, ranges
from sidestep.network.tags import FULL_WIDTH, KINDS, CrossingKind

SAME_PLACE = 0.1
"""Metres within which places are the same even where nothing is to be merged."""
BESIDE = 5.0
"""Metres from each other within which parallel streets are one; those farther apart, such as the banks of a river, are
two, however alike their lengths."""
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
    is_road = np.array([kind not in FULL_WIDTH for kind in KINDS])[streets.kind]
    street, end = np.nonzero(kind[streets.ends] > CrossingKind.NONE)
    node = streets.ends[street, end]
    order = np.lexsort((streets.length[street], is_road[street], node))
    first = order[np.diff(node[order], prepend=-1) > 0]
    street, node = street[first], node[first]
    traffic = streets.traffic.copy()
    np.add.at(traffic, (street, kind[node] - CrossingKind.UNSIGNALISED), 1)
    return replace(streets, traffic=traffic)


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
    streets of different categories meet. One node stays on a loop of ``LONG_LOOP`` metres or more, so that it is two
    streets. Joined streets have the mean width and incline by length, the kind and name of the longer part, and the
    highest kerb. A town that is one ring stays as it is.

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
    starts = _without_long_loops(streets, end, starts)
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
    weight = np.maximum(length, SAME_PLACE)  # of nodes at the same place some are joined before they merge
    weights = np.add.reduceat(weight, starts)
    ends = streets.ends.ravel()  # numbered as by _chains
    rise = weight * streets.incline[street] * step
    return Streets(
        ends=np.stack([ends[end[starts]], ends[end[border[1:] - 1] ^ 1]], axis=1),
        one_way=streets.one_way[street[starts]],
        length=total,
        width=np.add.reduceat(weight * streets.width[street], starts) / weights,
        kind=_longest_part(streets.kind[street], chain, length),
        name=_longest_part(streets.name[street], chain, length),
        traffic=np.add.reduceat(streets.traffic[street], starts),
        opening=streets.opening[street[starts]],
        restricted=streets.restricted[street[starts]],
        incline=np.add.reduceat(rise, starts) / weights,
        kerb=np.maximum.reduceat(streets.kerb[street], starts),
        points=streets.points[order],
        first=first[border],
    )


def _parallel(streets: Streets, metres: float) -> Bool[np.ndarray, " street"]:
    """Find streets beside others of their category that are hardly longer, in all directions that they are walked."""
    low, high = np.sort(streets.ends, axis=1).T
    dropped = np.zeros(len(streets), bool)
    _, pair, size = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True, return_counts=True)
    order = np.lexsort((streets.one_way, streets.length))
    order = order[size[pair[order]] > 1]
    if not len(order):
        return dropped
    excess, beside = max(metres, _MIN_EXCESS), max(min(metres, BESIDE), SAME_PLACE)
    category, plane = streets.category, Projection.of(streets.points)
    course = {i: shapely.LineString(plane.project(streets.points[slice(*streets.first[i : i + 2])])) for i in order}
    stay: dict[tuple[int, int, int], list[int]] = {}  # from the shortest on, by ends and category
    for street in order.tolist():
        tail, head = streets.ends[street].tolist()
        directions = [(tail, head)] if streets.one_way[street] else [(tail, head), (head, tail)]
        keys = [(*direction, int(category[street])) for direction in directions]
        dropped[street] = all(
            any(
                streets.length[street] - streets.length[other] < excess
                and shapely.hausdorff_distance(course[street], course[other]) <= beside
                for other in stay.get(key, ())
            )
            for key in keys
        )
        if not dropped[street]:
            for key in keys:
                stay.setdefault(key, []).append(street)
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


def _without_long_loops(
    streets: Streets, end: Int64[np.ndarray, " piece"], starts: Int64[np.ndarray, " chain"]
) -> Int64[np.ndarray, " shorter"]:
    """Cut chains that lead back to where they begin, if they are long, at the joint nearest to their middle."""
    border = np.append(starts, len(end))
    node, walked = streets.ends.ravel(), np.append(0.0, np.cumsum(streets.length[end >> 1]))
    loop = node[end[starts]] == node[end[border[1:] - 1] ^ 1] if len(starts) else np.zeros(0, bool)
    long = loop & (np.diff(walked[border]) >= LONG_LOOP) & (np.diff(border) > 1)
    cuts = []
    for begin, stop in zip(border[:-1][long].tolist(), border[1:][long].tolist(), strict=True):
        joints = walked[begin + 1 : stop]
        cuts.append(begin + 1 + int(np.argmin(np.abs(joints - (walked[begin] + walked[stop]) / 2))))
    return np.sort(np.append(starts, np.array(cuts, np.int64)))


def _longest_part(
    code: Int[np.ndarray, " piece"], chain: Int[np.ndarray, " piece"], length: Float[np.ndarray, " piece"]
) -> Int64[np.ndarray, " chain"]:
    """Find the code that the greatest length of each chain has."""
    codes = int(code.max()) + 1
    key, which = np.unique(chain * codes + code, return_inverse=True)
    of, found = np.divmod(key, codes)
    order = np.lexsort((-np.bincount(which, length), of))
    return found[order[np.diff(of, prepend=-1) > 0]]
