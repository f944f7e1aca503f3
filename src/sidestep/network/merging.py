"""Crossings near each other become one, and walks across it stay about as long as they were.

A merged crossing has an extent that is walked: every street that ends in it grows by a part of the distances inside.
The parts are chosen so that, for all pairs of these streets, the walk from one to the other is as long as it was before
in the mean, and off by as little as possible (least squares).
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from jaxtyping import Bool, Float, Int

from sidestep.network.geodesy import metres_between
from sidestep.network.simplify import SAME_PLACE
from sidestep.network.streets import LONG_LOOP, Nodes, Streets

MOST_NEIGHBOURS = 7
"""Of a merged crossing: every crossing is padded to the exits of the busiest one."""
TOLERANCE = 0.5
"""By how much walks across a merged crossing may be longer or shorter than before, root mean square over all pairs of
its streets, as a part of the length below which streets are short."""


def merge_crossings(streets: Streets, nodes: Nodes, metres: float) -> Streets:
    """Merge crossings that are joined by short streets.

    The shortest streets go first. A street stays if its merged crossing would change the lengths of walks across it by
    more than ``TOLERANCE`` allows, would have streets to more than ``MOST_NEIGHBOURS`` others, or would turn a street
    of ``LONG_LOOP`` metres or more into a loop. Only level streets that are walked both ways join crossings, so a
    bridge never merges with what is below it. The node whose walks to the other crossings change least represents the
    crossing, and the courses of the other streets are moved to it.

    Crossings of vehicle traffic along a street that goes are passed on to the streets of the merged crossing, each to
    the one that has been given the fewest so far, and of those to the shortest.

    Parameters
    ----------
    streets
        All streets, no loops among them.
    nodes
        The nodes that streets join.
    metres
        Length below which a street is short.

    Returns
    -------
    Streets
        The streets that are left. Their ``length`` is that of their course as it was, and of their parts of the
        merged crossings at their ends.
    """
    least = max(metres, SAME_PLACE)
    ordinary = streets.category == 0
    streets = replace(streets, length=np.maximum(streets.length, ~ordinary * SAME_PLACE))
    joining = ~streets.one_way & ordinary
    # Nodes at the same place merge in any case, since no street can be 0 m long.
    short = np.flatnonzero(((streets.length < least) & joining) | (streets.length == 0))
    representative, extent, radius = np.arange(len(nodes.ids)), np.zeros(len(nodes.ids)), np.zeros(len(nodes.ids))
    order = short[np.argsort(streets.length[short], kind="stable")]
    for crossing in _merged(streets, order, joining, TOLERANCE * least):
        middle, extent[crossing.nodes] = crossing.represented()
        representative[crossing.nodes] = middle
        around = nodes.place[crossing.nodes]
        radius[crossing.nodes] = metres_between(around, np.broadcast_to(nodes.place[middle], around.shape)).max()
    ends = representative[streets.ends]
    gone = ends[:, 0] == ends[:, 1]
    streets = _pass_on_traffic(streets, gone & (streets.length < least), ends)
    kept = streets.keep(~gone)
    length = kept.length + extent[kept.ends].sum(axis=1)
    return replace(_move_ends(kept, ends[~gone], nodes.place, radius[kept.ends]), length=length)


@dataclass(frozen=True, eq=False)
class _Crossing:
    """Nodes that become one crossing, or a node alone."""

    nodes: list[int]
    apart: list[list[float]]
    """Metres that are walked inside from each of these nodes to each."""
    arms: list[int]
    """How many streets lead out at each of these nodes."""

    def extents(self) -> list[float] | None:
        """Give the metres that streets grow by at each node; None where no choice changes the walk across."""
        arms, n = self.arms, sum(self.arms)
        if n <= 2:
            return None
        # Minimise the sum of (e_a + e_b - d_ab)² over all pairs a, b of n arms: (n - 2) e_a + sum(e) = sum_b(d_ab).
        to_all = [sum(map(float.__mul__, row, map(float, arms))) for row in self.apart]
        total = sum(map(float.__mul__, to_all, map(float, arms))) / (2 * n - 2)
        return [max((metres - total) / (n - 2), 0.0) for metres in to_all]

    def deviation(self) -> float:
        """Tell by how many metres walks across change, root mean square over all pairs of streets."""
        extents = self.extents()
        if extents is None:
            return 0.0
        arms, squares = self.arms, 0.0
        for i, (row, one, count) in enumerate(zip(self.apart, extents, arms, strict=True)):
            squares += 2 * count * (count - 1) * one * one
            for j in range(i):
                squares += count * arms[j] * (one + extents[j] - row[j]) ** 2
        n = sum(arms)
        return float((squares / (n * (n - 1) / 2)) ** 0.5)

    def represented(self) -> tuple[int, list[float]]:
        """Give the node that represents the crossing, and the metres that streets grow by at each node."""
        ending = [at for at, count in enumerate(self.arms) if count]
        extents = self.extents()
        if extents is not None:
            best = min(
                range(len(self.nodes)),
                key=lambda at: (max(abs(extents[to] - self.apart[at][to]) for to in ending), self.nodes[at]),
            )
            return self.nodes[best], extents
        # Walks across end at the first street, or a dead end is walked to its far end.
        best = ending[0] if sum(self.arms) == 2 else int(np.argmax(self.apart[ending[0]])) if ending else 0
        return self.nodes[best], self.apart[best]


Link = tuple[int, float, bool]
"""A street as one of its ends sees it: the other end, its length, and whether it may join crossings."""


def _merged(
    streets: Streets, order: Int[np.ndarray, " short"], joining: Bool[np.ndarray, " street"], tolerance: float
) -> Iterable[_Crossing]:
    """Contract short streets in the order given; list the crossings of more than one node."""
    links: dict[int, list[Link]] = {node: [] for node in np.unique(streets.ends[order]).tolist()}
    near = np.flatnonzero(np.isin(streets.ends, list(links)).any(axis=1))
    for (tail, head), length, may_join in zip(
        streets.ends[near].tolist(), streets.length[near].tolist(), joining[near].tolist(), strict=True
    ):
        for node, other in ((tail, head), (head, tail)):
            if node in links:
                links[node].append((other, length, may_join))
    home = {node: _Crossing([node], [[0.0]], [len(links[node])]) for node in links}
    for tail, head in streets.ends[order].tolist():
        one, other = home[tail], home[head]
        if one is not other and (joined := _join(one, other, links, home, tolerance)):
            home.update(dict.fromkeys(joined.nodes, joined))
    return dict.fromkeys(crossing for crossing in home.values() if len(crossing.nodes) > 1)


def _join(
    one: _Crossing, other: _Crossing, links: dict[int, list[Link]], home: dict[int, _Crossing], tolerance: float
) -> _Crossing | None:
    """Merge two crossings that a short street joins; None if they must not."""
    size = len(one.nodes)
    nodes = one.nodes + other.nodes
    place = {node: at for at, node in enumerate(nodes)}
    between: list[tuple[int, int, float, bool]] = []
    around: set[object] = set()
    arms = one.arms + other.arms
    for at, node in enumerate(nodes):
        for to, length, may_join in links[node]:
            there = home.get(to, to)
            if there is one or there is other:
                if (place[to] < size) != (at < size):
                    arms[at] -= 1
                    if at < size:
                        between.append((at, place[to], length, may_join))
            else:
                around.add(there)
    same_place = any(length == 0 for _, _, length, _ in between)
    if not same_place and (len(around) > MOST_NEIGHBOURS or any(length >= LONG_LOOP for _, _, length, _ in between)):
        return None
    apart = [row + [inf] * len(other.nodes) for row in one.apart] + [[inf] * size + row for row in other.apart]
    for tail, head, length, may_join in between:
        if may_join or length == 0:
            apart = _with_street(apart, tail, head, length)
    joined = _Crossing(nodes, apart, arms)
    return joined if same_place or joined.deviation() <= tolerance else None


def _with_street(apart: list[list[float]], tail: int, head: int, length: float) -> list[list[float]]:
    """Shorten distances by a street between two of the nodes."""
    from_tail, from_head = apart[tail], apart[head]
    result = []
    for row in apart:
        to_tail, to_head = row[tail] + length, row[head] + length
        result.append([
            min(direct, to_tail + beyond_head, to_head + beyond_tail)
            for direct, beyond_head, beyond_tail in zip(row, from_head, from_tail, strict=True)
        ])  # fmt: skip
    return result


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


def _move_ends(
    streets: Streets,
    ends: Int[np.ndarray, "street 2"],
    place: Float[np.ndarray, "node 2"],
    radius: Float[np.ndarray, "street 2"],
) -> Streets:
    """Move the ends of courses to the nodes that represent merged crossings."""
    # The last metres go, up to the radius of the crossing: a line from one street to another across the crossing then
    # has no spike, that is, it does not run to the representative and back.
    points, first = streets.points.copy(), streets.first
    street = np.repeat(np.arange(len(streets)), np.diff(first))
    walked = np.append(0.0, np.cumsum(metres_between(points[:-1], points[1:])))
    begin, end = walked[first[:-1]] + radius[:, 0], walked[first[1:] - 1] - radius[:, 1]
    stays = (walked >= begin[street]) & (walked <= end[street])
    stays[first[:-1]] = stays[first[1:] - 1] = True
    points[first[:-1]], points[first[1:] - 1] = place[ends].swapaxes(0, 1)
    first = np.append(0, np.cumsum(np.bincount(street[stays], minlength=len(streets))))
    return replace(streets, ends=ends, points=points[stays], first=first)
