"""From every bend of every way to crossings and the streets between them.

Each step takes streets and gives streets. Where rows can be handled at once they are; plain loops remain only where
one decision depends on the last, and run over the few streets concerned.
"""

from collections import Counter
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sidestep.network.town import course_lengths

SAME_PLACE = 0.1  # m; ends nearer than this along a street are one place even where nothing is to be merged
MOST_NEIGHBOURS = 7  # of a merged crossing; every crossing is padded to the exits of the busiest one
_MIN_EXCESS = 0.01  # m; streets that differ by less are the same street drawn twice


@dataclass(frozen=True, eq=False)
class Streets:
    """Streets between numbered nodes, with their courses; see `sidestep.network.town.Town`."""

    tail: Int64[np.ndarray, " street"]
    head: Int64[np.ndarray, " street"]
    one_way: Bool[np.ndarray, " street"]
    length: Float64[np.ndarray, " street"]  # m
    width: Float64[np.ndarray, " street"]  # m
    kind: Int64[np.ndarray, " street"]  # code of a kind
    name: Int64[np.ndarray, " street"]  # code of a name
    signals: Int64[np.ndarray, " street"]
    crossings: Int64[np.ndarray, " street"]
    points: Float64[np.ndarray, "point 2"]
    first: Int64[np.ndarray, " border"]

    def __len__(self) -> int:
        return len(self.tail)


def keep(streets: Streets, which: Bool[np.ndarray, " street"]) -> Streets:
    """Some of the streets, in their order."""
    rows = np.flatnonzero(which)
    order, first = spans(streets.first[rows], np.diff(streets.first)[rows])
    columns = {
        field.name: getattr(streets, field.name)[rows]
        for field in fields(Streets)
        if field.name not in ("points", "first")
    }
    return Streets(**columns, points=streets.points[order], first=first)


def largest_part(streets: Streets) -> Bool[np.ndarray, " street"]:
    """The streets of the largest part (by its nodes) in which every node can be walked to from every other."""
    nodes = int(max(streets.tail.max(), streets.head.max())) + 1
    back = ~streets.one_way
    tail = np.concatenate([streets.tail, streets.head[back]])
    head = np.concatenate([streets.head, streets.tail[back]])
    links = coo_array((np.ones(len(tail), np.int32), (tail, head)), shape=(nodes, nodes))
    _, part = connected_components(links, directed=True, connection="strong")
    used = np.zeros(nodes, bool)
    used[tail] = used[head] = True
    best = int(np.argmax(np.bincount(part[used])))
    return (part[streets.tail] == best) & (part[streets.head] == best)


def give_to_one(streets: Streets, standing: Int[np.ndarray, " node"], own_way: Bool[np.ndarray, " street"]) -> Streets:
    """Count each crossing of vehicle traffic at the end of several streets for exactly one of them.

    That is the shortest of the walkers' own ways that end there, since it is most likely the one that leads over the
    carriageway, or else the shortest street.
    """
    street = np.tile(np.arange(len(streets)), 2)
    node = np.concatenate([streets.tail, streets.head])
    at = standing[node] > 0
    street, node = street[at], node[at]
    order = np.lexsort((street, streets.length[street], ~own_way[street], node))
    street, node = street[order], node[order]
    if not len(node):
        return streets
    once = np.append(True, node[1:] != node[:-1])
    street, node = street[once], node[once]
    added = {value: np.bincount(street[standing[node] == value], minlength=len(streets)) for value in (1, 2)}
    return replace(streets, signals=streets.signals + added[2], crossings=streets.crossings + added[1])


def merge_crossings(
    streets: Streets,
    place: Float[np.ndarray, "node 2"],
    xy: Float[np.ndarray, "node 2"],
    ids: Int[np.ndarray, " node"],
    metres: float,
) -> tuple[Streets, int]:
    """Make one crossing of those that streets shorter than `metres` join, and say how many streets that took.

    The shortest streets go first, and none goes whose crossing would become larger than twice `metres` (the diagonal
    of the box around it) or would have streets to more than `MOST_NEIGHBOURS` others. Crossings merge only along a
    street, so a bridge never merges with what is below it. The member nearest to the members' mean stands for the
    crossing, and the other streets are led on to it in a straight line, which keeps walks across the crossing about as
    long as they were.

    Crossings of vehicle traffic on a street that goes are handed on to the streets of the merged crossing, to the
    one that has been given fewest so far, and of those to the shortest.
    """
    least = max(metres, SAME_PLACE)
    short = np.flatnonzero(streets.length < least)
    if not len(short):
        return streets, 0
    group = _clusters(streets, short[np.argsort(streets.length[short], kind="stable")], xy, 2 * least)
    gone = (streets.length < least) & (group[streets.tail] == group[streets.head])
    total = np.stack([np.bincount(group, xy[:, axis]) for axis in (0, 1)], axis=1)
    middle = total / np.maximum(np.bincount(group), 1)[:, None]
    order = np.lexsort((ids, np.hypot(*(xy - middle[group]).T), group))
    leader = np.zeros(len(middle), np.int64)
    leader[group[order[::-1]]] = order[::-1]  # the last to be written is the nearest
    stands = leader[group]
    streets = _hand_on(streets, gone, stands)
    return _led_on(keep(streets, ~gone), stands, place), int(gone.sum())


def tidy(streets: Streets, metres: float) -> tuple[Streets, Counter[str]]:
    """Drop loops and parallel streets, and join streets where only two meet, until nothing changes."""
    changed: Counter[str] = Counter()
    while len(streets):
        before = changed.total()
        loops = streets.tail == streets.head
        changed["street: begins and ends at one crossing"] += int(loops.sum())
        streets = keep(streets, ~loops)
        parallel = _parallel(streets, metres)
        changed["street: hardly longer than a parallel one"] += int(parallel.sum())
        streets = keep(streets, ~parallel)
        streets, joined = _smooth(streets)
        changed["joined"] += joined
        if changed.total() == before:
            break
    return streets, changed


def spans(
    start: Int[np.ndarray, " span"], count: Int[np.ndarray, " span"], step: Int[np.ndarray, " span"] | int = 1
) -> tuple[Int[np.ndarray, " point"], Int64[np.ndarray, " border"]]:
    """The numbers of several runs one after the other, and where each run begins."""
    first = np.concatenate([[0], np.cumsum(count, dtype=np.int64)]).astype(np.int64)
    within = np.arange(first[-1]) - np.repeat(first[:-1], count)
    return np.repeat(start, count) + within * np.repeat(np.broadcast_to(step, len(count)), count), first


def _clusters(
    streets: Streets, order: Int[np.ndarray, " short"], xy: Float[np.ndarray, "node 2"], extent: float
) -> Int64[np.ndarray, " node"]:
    """The number of the cluster that each node belongs to once short streets have been contracted in order."""
    parent = list(range(len(xy)))
    box: dict[int, tuple[float, float, float, float]] = {}
    near = _neighbours(streets, order)

    def root(node: int) -> int:
        while parent[node] != node:
            parent[node] = node = parent[parent[node]]
        return node

    for tail, head in zip(streets.tail[order].tolist(), streets.head[order].tolist(), strict=True):
        a, b = root(tail), root(head)
        if a == b:
            continue
        (west, south, east, north), other = (box.get(i, (*xy[i].tolist(), *xy[i].tolist())) for i in (a, b))
        west, south = min(west, other[0]), min(south, other[1])
        east, north = max(east, other[2]), max(north, other[3])
        around = {root(node) for node in near[a] | near[b]} - {a, b}
        # Nodes at the very same place merge whatever follows, since no street can be 0 m long.
        same = (west, south) == (east, north)
        if same or (np.hypot(east - west, north - south) <= extent and len(around) <= MOST_NEIGHBOURS):
            parent[b] = a
            box[a] = (west, south, east, north)
            near[a] = around
    return np.array([root(node) for node in range(len(xy))], np.int64)


def _neighbours(streets: Streets, short: Int[np.ndarray, " short"]) -> dict[int, set[int]]:
    """The nodes around each end of the short streets."""
    ends = np.unique(np.concatenate([streets.tail[short], streets.head[short]]))
    near: dict[int, set[int]] = {node: set() for node in ends.tolist()}
    touching = np.isin(streets.tail, ends) | np.isin(streets.head, ends)
    for tail, head in zip(streets.tail[touching].tolist(), streets.head[touching].tolist(), strict=True):
        if tail in near:
            near[tail].add(head)
        if head in near:
            near[head].add(tail)
    return near


def _hand_on(streets: Streets, gone: Bool[np.ndarray, " street"], stands: Int[np.ndarray, " node"]) -> Streets:
    loop = stands[streets.tail] == stands[streets.head]
    heirs: dict[int, list[int]] = {int(node): [] for node in stands[streets.tail[gone]]}
    stays = np.flatnonzero(~gone & ~loop)
    for street in stays[np.argsort(streets.length[stays], kind="stable")].tolist():
        for end in (stands[streets.tail[street]], stands[streets.head[street]]):
            if int(end) in heirs:
                heirs[int(end)].append(street)
    given: Counter[int] = Counter()
    signals, crossings = streets.signals.copy(), streets.crossings.copy()
    for street in np.flatnonzero(gone & (signals + crossings > 0)).tolist():
        if candidates := heirs[int(stands[streets.tail[street]])]:
            heir = min(candidates, key=lambda candidate: given[candidate])
            given[heir] += int(signals[street] + crossings[street])
            signals[heir] += signals[street]
            crossings[heir] += crossings[street]
    return replace(streets, signals=signals, crossings=crossings)


def _led_on(streets: Streets, stands: Int[np.ndarray, " node"], place: Float[np.ndarray, "node 2"]) -> Streets:
    """The streets between the nodes that stand for merged crossings, their courses led on to these."""
    tail, head = stands[streets.tail], stands[streets.head]
    before, after = tail != streets.tail, head != streets.head
    counts = np.diff(streets.first)
    _, first = spans(streets.first[:-1], counts + before + after)
    to, _ = spans(first[:-1] + before, counts)
    points = np.empty((first[-1], 2))
    points[to] = streets.points
    points[first[:-1][before]] = place[tail[before]]
    points[first[1:][after] - 1] = place[head[after]]
    return replace(streets, tail=tail, head=head, points=points, first=first, length=course_lengths(points, first))


def _parallel(streets: Streets, metres: float) -> Bool[np.ndarray, " street"]:
    """Streets that are hardly longer than others between the same crossings, in all the directions they are walked."""
    low, high = np.minimum(streets.tail, streets.head), np.maximum(streets.tail, streets.head)
    dropped = np.zeros(len(streets), bool)
    if not len(streets):
        return dropped
    order = np.lexsort((streets.one_way, streets.length, high, low))
    same = (low[order[1:]] == low[order[:-1]]) & (high[order[1:]] == high[order[:-1]])
    several = np.append(same, False) | np.append(False, same)
    begins = ~np.append(False, same)
    shortest: dict[int, float] = {}
    for street, new in zip(order[several].tolist(), begins[several].tolist(), strict=True):
        if new:
            shortest = {}
        tail, head, length = int(streets.tail[street]), int(streets.head[street]), float(streets.length[street])
        starts = (tail,) if streets.one_way[street] else (tail, head)
        if all(start in shortest and length - shortest[start] < max(metres, _MIN_EXCESS) for start in starts):
            dropped[street] = True
        for start in starts:
            shortest.setdefault(start, length)
    return dropped


def _smooth(streets: Streets) -> tuple[Streets, int]:
    """Join the streets at nodes where just two meet, and say at how many nodes.

    A node stays where a one-way street meets another of another direction, or one that is walked both ways. Joined
    streets have the mean width by length, and the kind and the name of the greater part. Should the whole town be one
    ring, it stays as it is.
    """
    if not len(streets):
        return streets, 0
    mate = _mates(streets)
    if (mate >= 0).all() or (mate < 0).all():
        return streets, 0
    pieces, chain = _chains(mate.tolist(), streets.one_way.tolist())
    half = np.array(pieces)
    street, back = half >> 1, (half & 1).astype(bool)
    chain_of = np.array(chain)
    starts = np.flatnonzero(np.append(True, chain_of[1:] != chain_of[:-1]))
    ends = np.append(starts[1:], len(half)) - 1
    # Each piece but the first of a chain begins where the last one ended: that point is there already.
    later = np.ones(len(half), np.int64)
    later[starts] = 0
    counts = np.diff(streets.first)[street] - later
    step = np.where(back, -1, 1)
    begin = np.where(back, streets.first[street + 1] - 1, streets.first[street]) + step * later
    order, _ = spans(begin, counts, step)
    length = streets.length[street]
    total = np.add.reduceat(length, starts)
    near, far = (
        np.where(back, streets.head[street], streets.tail[street]),
        np.where(back, streets.tail[street], streets.head[street]),
    )
    return Streets(
        tail=near[starts],
        head=far[ends],
        one_way=streets.one_way[street[starts]],
        length=total,
        width=np.add.reduceat(length * streets.width[street], starts) / total,
        kind=_greater_part(streets.kind[street], chain_of, length),
        name=_greater_part(streets.name[street], chain_of, length),
        signals=np.add.reduceat(streets.signals[street], starts),
        crossings=np.add.reduceat(streets.crossings[street], starts),
        points=streets.points[order],
        first=np.concatenate([[0], np.cumsum(np.add.reduceat(counts, starts))]).astype(np.int64),
    ), int(later.sum())


def _mates(streets: Streets) -> Int64[np.ndarray, " half"]:
    """The street end that each street end is joined to, -1 where none.

    End 2 i is the tail of street i, end 2 i + 1 its head.
    """
    node = np.stack([streets.tail, streets.head], axis=1).ravel()
    order = np.argsort(node, kind="stable")
    at = node[order]
    begins = np.flatnonzero(np.append(True, at[1:] != at[:-1]))
    pairs = begins[np.diff(np.append(begins, len(at))) == 2]
    one, two = order[pairs], order[pairs + 1]
    single = streets.one_way[one >> 1]
    fits = (one >> 1 != two >> 1) & (single == streets.one_way[two >> 1]) & (~single | ((one ^ two) & 1 == 1))
    mate = np.full(len(node), -1, np.int64)
    mate[one[fits]], mate[two[fits]] = two[fits], one[fits]
    return mate


def _chains(mate: list[int], one_way: list[bool]) -> tuple[list[int], list[int]]:
    """Streets in the order of the chains they form, each as the end at which it is entered, and the chains' numbers."""
    pieces: list[int] = []
    chain: list[int] = []
    seen = [False] * len(one_way)
    number = 0
    for start, joined in enumerate(mate):
        street = start >> 1
        if joined >= 0 or seen[street] or (one_way[street] and start & 1):
            continue  # not the end of a chain, or the wrong one
        half = start
        while half >= 0:
            seen[half >> 1] = True
            pieces.append(half)
            chain.append(number)
            half = mate[half ^ 1]
        number += 1
    return pieces, chain


def _greater_part(
    code: Int[np.ndarray, " piece"], chain: Int[np.ndarray, " piece"], length: Float[np.ndarray, " piece"]
) -> Int64[np.ndarray, " chain"]:
    """The code that the greatest length of each chain has."""
    codes = int(code.max()) + 1
    key, which = np.unique(chain * codes + code, return_inverse=True)
    metres = np.bincount(which, length)
    order = np.lexsort((-metres, key // codes))
    best = order[np.append(True, np.diff(key[order] // codes) > 0)]
    return key[best] % codes
