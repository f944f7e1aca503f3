"""Loops and parallel streets go, and streets are joined where only two meet."""

from collections import Counter

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from sidestep.network.streets import Streets, ranges

_MIN_EXCESS = 0.01  # m; streets that differ by less are the same street drawn twice


def simplify(streets: Streets, metres: float) -> tuple[Streets, Counter[str], int]:
    """Drop loops and parallel streets, and merge nodes of degree two, until nothing changes.

    Parameters
    ----------
    streets
        All streets.
    metres
        By how much longer than a parallel street another must be to stay.

    Returns
    -------
    Streets, Counter, int
        The streets that are left, how many were dropped for which reason, and at how many nodes two were joined.
    """
    dropped: Counter[str] = Counter()
    joined = 0
    while len(streets):
        before = dropped.total() + joined
        loops = streets.tail == streets.head
        dropped["street: loop"] += int(loops.sum())
        streets = streets.keep(~loops)
        parallel = _parallel(streets, metres)
        dropped["street: parallel to a shorter one"] += int(parallel.sum())
        streets, merged = merge_degree_two(streets.keep(~parallel))
        joined += merged
        if dropped.total() + joined == before:
            break
    return streets, dropped, joined


def merge_degree_two(streets: Streets) -> tuple[Streets, int]:
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
    Streets, int
        The joined streets, and the number of nodes that this removed.
    """
    mate = _mates(streets)
    if (mate >= 0).all() or (mate < 0).all():
        return streets, 0
    pieces, chains = _chains(mate.tolist(), streets.one_way.tolist())
    end, chain = np.array(pieces), np.array(chains)
    street, back = end >> 1, (end & 1).astype(bool)
    starts = np.flatnonzero(np.diff(chain, prepend=-1))
    last = np.append(starts[1:], len(end)) - 1
    # Each piece but the first of a chain begins where the last one ended: that point is there already.
    later = np.ones(len(end), np.int64)
    later[starts] = 0
    counts = np.diff(streets.first)[street] - later
    step = np.where(back, -1, 1)
    begin = np.where(back, streets.first[street + 1] - 1, streets.first[street]) + step * later
    order, first = ranges(begin, counts, step)
    length = streets.length[street]
    total = np.add.reduceat(length, starts)
    ends = streets.ends.ravel()  # numbered as by _mates
    return Streets(
        tail=ends[end[starts]],
        head=ends[end[last] ^ 1],
        one_way=streets.one_way[street[starts]],
        length=total,
        width=np.add.reduceat(length * streets.width[street], starts) / total,
        kind=_longest_part(streets.kind[street], chain, length),
        name=_longest_part(streets.name[street], chain, length),
        signals=np.add.reduceat(streets.signals[street], starts),
        crossings=np.add.reduceat(streets.crossings[street], starts),
        points=streets.points[order],
        first=first[np.append(starts, len(end))],
    ), int(later.sum())


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
    """Find the street end that each street end is to be joined to, -1 where there is none.

    End 2 i is the tail of street i, end 2 i + 1 its head.
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


def _chains(mate: list[int], one_way: list[bool]) -> tuple[list[int], list[int]]:
    """Order streets by the chains they form, each as the end at which it is entered; number the chain of each."""
    pieces: list[int] = []
    chain: list[int] = []
    seen = [False] * len(one_way)
    number = 0
    for start, joined in enumerate(mate):
        street = start >> 1
        if joined >= 0 or seen[street] or (one_way[street] and start & 1):
            continue  # not the end of a chain, or the wrong one
        end = start
        while end >= 0:
            seen[end >> 1] = True
            pieces.append(end)
            chain.append(number)
            end = mate[end ^ 1]
        number += 1
    return pieces, chain


def _longest_part(
    code: Int[np.ndarray, " piece"], chain: Int[np.ndarray, " piece"], length: Float[np.ndarray, " piece"]
) -> Int64[np.ndarray, " chain"]:
    """Find the code that the greatest length of each chain has."""
    codes = int(code.max()) + 1
    key, which = np.unique(chain * codes + code, return_inverse=True)
    metres = np.bincount(which, length)
    order = np.lexsort((-metres, key // codes))
    best = order[np.append(True, np.diff(key[order] // codes) > 0)]
    return key[best] % codes
