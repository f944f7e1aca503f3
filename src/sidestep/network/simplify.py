"""Loops and parallel streets go, and streets are joined where only two meet."""

from array import array
from collections import Counter

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from sidestep.network.streets import Streets, ranges

JOINED = "crossing: two streets joined into one"
"""What reports call a node that goes since just two streets meet there."""

_MIN_EXCESS = 0.01  # m; streets that differ by less are the same street drawn twice


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
        The streets that are left, and by how many there are fewer for which reason.
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

    A node stays where a one-way street meets another of another direction, or one that is walked both ways. Joined
    streets have the mean width by length, and the kind and name of the longer part. A town that is one ring stays as it
    is.

    Parameters
    ----------
    streets
        All streets.

    Returns
    -------
    Streets
        The joined streets.
    """
    mate = _mates(streets)
    if (mate >= 0).all() or (mate < 0).all():
        return streets
    end, starts = _chains(mate.tolist(), streets.one_way.tolist())
    last = np.append(starts[1:], len(end)) - 1
    street, back = np.divmod(end, 2)
    step = 1 - 2 * back
    # Each piece but the first of a chain begins where the last one ended: that point is there already.
    later = np.ones(len(end), np.int64)
    later[starts] = 0
    chain = np.cumsum(1 - later)
    counts = np.diff(streets.first)[street] - later
    begin = np.where(back, streets.first[street + 1] - 1, streets.first[street]) + step * later
    order, first = ranges(begin, counts, step)
    length = streets.length[street]
    total = np.add.reduceat(length, starts)
    ends = streets.ends.ravel()  # numbered as by _mates
    return Streets(
        ends=np.stack([ends[end[starts]], ends[end[last] ^ 1]], axis=1),
        one_way=streets.one_way[street[starts]],
        length=total,
        width=np.add.reduceat(length * streets.width[street], starts) / total,
        kind=_longest_part(streets.kind[street], chain, length),
        name=_longest_part(streets.name[street], chain, length),
        signals=np.add.reduceat(streets.signals[street], starts),
        crossings=np.add.reduceat(streets.crossings[street], starts),
        points=streets.points[order],
        first=first[np.append(starts, len(end))],
    )


def _parallel(streets: Streets, metres: float) -> Bool[np.ndarray, " street"]:
    """Find streets hardly longer than others between the same crossings, in all directions that they are walked."""
    ends = streets.ends
    low, high = np.sort(ends, axis=1).T
    _, pair, size = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True, return_counts=True)
    order = np.lexsort((streets.one_way, streets.length))
    dropped = np.zeros(len(streets), bool)
    shortest: dict[tuple[int, int], float] = {}
    for street in order[size[pair[order]] > 1].tolist():
        tail, head = ends[street].tolist()
        length = float(streets.length[street])
        directions = [(tail, head)] if streets.one_way[street] else [(tail, head), (head, tail)]
        dropped[street] = all(
            length - shortest.get(direction, -np.inf) < max(metres, _MIN_EXCESS) for direction in directions
        )
        for direction in directions:
            shortest.setdefault(direction, length)
    return dropped


def _mates(streets: Streets) -> Int64[np.ndarray, " end"]:
    """Find the street end that each street end is to be joined to.

    Returns
    -------
    Int64[np.ndarray, " end"]
        The other end, -1 where there is none. End 2 i is the tail of street i, end 2 i + 1 its head.
    """
    node = streets.ends.ravel()
    order = np.argsort(node, kind="stable")
    _, begins, degree = np.unique(node[order], return_index=True, return_counts=True)
    pairs = begins[degree == 2]
    one, two = order[pairs], order[pairs + 1]
    single = streets.one_way[one >> 1]
    fits = (one >> 1 != two >> 1) & (single == streets.one_way[two >> 1]) & (~single | ((one ^ two) & 1 == 1))
    mate = np.full(len(node), -1, np.int64)
    mate[one[fits]], mate[two[fits]] = two[fits], one[fits]
    return mate


def _chains(mate: list[int], one_way: list[bool]) -> tuple[Int64[np.ndarray, " piece"], Int64[np.ndarray, " chain"]]:
    """Order streets by the chains they form, each as the end at which it is entered; tell where each chain starts."""
    pieces, starts = array("q"), array("q")
    seen = [False] * len(one_way)
    for start, joined in enumerate(mate):
        street = start >> 1
        if joined >= 0 or seen[street] or (one_way[street] and start & 1):
            continue  # not the end of a chain, or the wrong one
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
