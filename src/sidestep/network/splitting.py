"""From ways to streets: ways are cut where they meet, where nodes are absent, and at gates, walls and lifts."""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Int, Int64

from sidestep.network.access import NEVER, Access, both
from sidestep.network.extract import Extract
from sidestep.network.geodesy import course_lengths
from sidestep.network.streets import Nodes, Streets, join_streets, ranges, straight_streets
from sidestep.network.tags import FULL_WIDTH, KINDS, CrossingKind


@dataclass(frozen=True, eq=False)
class _Stops:
    """The nodes along all ways one after another, without those that the file lacks."""

    node: Int64[np.ndarray, " stop"]
    """Index of each node."""
    way: Int64[np.ndarray, " stop"]
    piece: Int64[np.ndarray, " stop"]
    """Piece of a way to which each belongs: a street never leads from one piece to another."""

    def select(self, which: Int[np.ndarray, " stop"] | Bool[np.ndarray, " stop"]) -> "_Stops":
        return _Stops(self.node[which], self.way[which], self.piece[which])

    @property
    def ends(self) -> Bool[np.ndarray, " stop"]:
        """Whether each is the first or the last of its piece."""
        other = self.piece[1:] != self.piece[:-1]
        return np.append(True, other) | np.append(other, True)


def split_ways(extract: Extract, widths: dict[str, float]) -> tuple[Streets, Nodes]:
    """Cut ways where they meet others or themselves, where nodes are absent, and where something is in the way.

    - At a node that nobody may pass, each end gets a node of its own.
    - At a gate with opening times, or for destinations only, the parts of all ways between the nodes before and after
      it get these.
    - At a lift, each level gets a node of its own, and a street of kind ``elevator`` joins each two of them. Ways
      without a level are on level 0; where that leaves fewer than two levels, each way is on its own.

    New nodes get invented negative numbers.

    Parameters
    ----------
    extract
        What a file holds; its counters go on counting.
    widths
        Metres available to walkers by kind of street.

    Returns
    -------
    Streets, Nodes
        The streets; and all nodes, the new ones last.
    """
    stops = _present(extract)
    closed = {number for number, access in extract.passages.items() if access.opening == NEVER}
    lifts = extract.lifts - closed
    stops = _cut_at(stops, extract.nodes.indices({*closed, *lifts}))
    origin = list(range(len(extract.nodes.ids)))  # of each node: itself, or the one in whose place it stands
    node = stops.node.copy()
    for at in np.flatnonzero(np.isin(node, extract.nodes.indices(closed))).tolist():
        origin.append(int(node[at]))
        node[at] = len(origin) - 1
    rides = [
        ride for lift in extract.nodes.indices(lifts).tolist() for ride in _lift(extract, stops, node, lift, origin)
    ]
    stops = replace(stops, node=node)
    nodes = extract.nodes.copied(np.array(origin[len(extract.nodes.ids) :], np.int64))
    streets = _streets(extract, stops, nodes, np.array(origin))
    elevator = KINDS.index("elevator")
    lifted = straight_streets(np.array(rides, np.int64).reshape(-1, 2), nodes.place, elevator, widths["elevator"])
    streets = join_streets([streets, _guarded(extract, lifted, np.array(origin))])
    never = np.array([text == NEVER for text in extract.openings])[streets.opening]
    extract.dropped["street: never open"] += int(never.sum())
    return streets.keep(~never), nodes


def _present(extract: Extract) -> _Stops:
    """List the nodes along ways; ways are cut at those that the file lacks."""
    counts = np.array(extract.ways.counts, np.int64)
    node = np.searchsorted(extract.nodes.ids, np.array(extract.ways.refs, np.int64))
    way = np.repeat(np.arange(len(counts)), counts)
    there = ~np.isnan(extract.nodes.place[node, 0])
    extract.repaired["way: split at missing nodes"] += len(np.unique(way[~there]))
    cut = np.append(True, (way[1:] != way[:-1]) | ~there[:-1])
    stops = _Stops(node, way, np.cumsum(cut)).select(there)
    again = (np.diff(stops.node, prepend=-1) == 0) & (np.diff(stops.piece, prepend=0) == 0)
    return stops.select(~again)


def _cut_at(stops: _Stops, nodes: Int[np.ndarray, " cut"]) -> _Stops:
    """Cut pieces at some nodes, which then stand at the end of one piece and the beginning of the next."""
    within = np.isin(stops.node, nodes) & ~stops.ends
    begins = np.append(True, stops.piece[1:] != stops.piece[:-1])
    twice = np.repeat(np.arange(len(within)), 1 + within)
    second = np.diff(twice, prepend=-1) == 0
    return replace(stops.select(twice), piece=np.cumsum((begins[twice] & ~second) | second))


def _lift(
    extract: Extract, stops: _Stops, node: Int64[np.ndarray, " stop"], lift: int, origin: list[int]
) -> list[tuple[int, int]]:
    """Give each level at a lift a node of its own; list the pairs of them."""
    at = np.flatnonzero(stops.node == lift)
    level = np.array(extract.ways.levels, np.int64)[stops.way[at]]
    if not level.all():  # ways without a level are on level 0
        level[level == extract.levels.get("0", 0)] = 0
    group = level if len(np.unique(level)) > 1 else np.arange(len(at))
    own = [lift]
    for number in np.unique(group)[1:].tolist():
        origin.append(lift)
        own.append(len(origin) - 1)
        node[at[group == number]] = own[-1]
    return list(combinations(own, 2))


def _streets(extract: Extract, stops: _Stops, nodes: Nodes, origin: Int[np.ndarray, " node"]) -> Streets:
    """Make streets of the parts of pieces between crossings, ends, gates and ferries' landings."""
    ways, node, piece = extract.ways, stops.node, stops.piece
    times = np.bincount(node, weights=1.0 - np.array(ways.second, np.int64)[stops.way], minlength=len(nodes.ids))
    gates = [number for number, access in extract.passages.items() if access.opening != NEVER]
    gate = np.isin(origin[node], extract.nodes.indices(gates))
    near = gate | np.append(gate[1:], False) | np.append(False, gate[:-1])  # ends of pieces are crossings anyway
    landing = np.isin(node, extract.nodes.indices(extract.ferries.refs))
    stop = np.flatnonzero(stops.ends | (times[node] > 1) | near | landing)
    joined = piece[stop[1:]] == piece[stop[:-1]]
    # A loop is two streets: loops that are too short to be kept are joined again, and dropped.
    loop = joined & (node[stop[1:]] == node[stop[:-1]])
    stop = np.sort(np.append(stop, (stop[1:] + stop[:-1])[loop] // 2))
    joined = piece[stop[1:]] == piece[stop[:-1]]
    begin, end = stop[:-1][joined], stop[1:][joined]
    order, first = ranges(begin, end - begin + 1)
    points = nodes.place[node[order]]
    crossed = [np.flatnonzero(nodes.kind[node] == kind) for kind in (CrossingKind.UNSIGNALISED, CrossingKind.SIGNALS)]
    way = stops.way[begin]
    streets = Streets(
        ends=np.stack([node[begin], node[end]], axis=1),
        one_way=np.array(ways.one_way, bool)[way],
        length=course_lengths(points, first),
        width=np.array(ways.widths, np.float64)[way],
        kind=np.array(ways.kinds, np.int64)[way],
        name=np.array(ways.names, np.int64)[way],
        traffic=np.stack([np.searchsorted(at, end) - np.searchsorted(at, begin, "right") for at in crossed], axis=1),
        opening=np.array(ways.openings, np.int64)[way],
        restricted=np.array(ways.restricted, bool)[way],
        incline=np.array(ways.inclines, np.float64)[way],
        kerb=np.array(ways.kerbs, np.float64)[way],
        points=points,
        first=first,
    )
    return _guarded(extract, _with_kerbs(extract, streets, stops, begin, end), origin)


def _guarded(extract: Extract, streets: Streets, origin: Int[np.ndarray, " node"]) -> Streets:
    """Give the streets that end at gates their opening times, and restrict them where the gates are."""
    gates = {number: access for number, access in extract.passages.items() if access.opening != NEVER}
    index = extract.nodes.indices(gates)
    access_of = dict(zip(index.tolist(), gates.values(), strict=True))
    opening, restricted, texts = streets.opening.copy(), streets.restricted.copy(), list(extract.openings)
    ends = origin[streets.ends]
    for street in np.flatnonzero(np.isin(ends, index).any(axis=1)).tolist():
        access = Access(texts[opening[street]], bool(restricted[street]))
        for end in set(ends[street].tolist()) & access_of.keys():
            access = both(access, access_of[end])
        opening[street], restricted[street] = extract.openings[access.opening], access.restricted
    return replace(streets, opening=opening, restricted=restricted)


def _with_kerbs(
    extract: Extract,
    streets: Streets,
    stops: _Stops,
    begin: Int[np.ndarray, " street"],
    end: Int[np.ndarray, " street"],
) -> Streets:
    """Give streets the highest kerb along them."""
    # A kerb where streets meet counts for those that lead over a carriageway, or else for those that begin or end
    # there; of two, for the shorter one, since who passes takes both. Along roads there are no kerbs to cross.
    if not extract.kerbs:
        return streets
    index = extract.nodes.indices(extract.kerbs)
    height = np.zeros(len(extract.nodes.ids) + 1)
    height[index] = list(extract.kerbs.values())
    along = height[np.minimum(stops.node, len(height) - 1)]
    kerb = streets.kerb.copy()
    walked = np.array([kind in FULL_WIDTH for kind in KINDS])[streets.kind]
    order, first = ranges(begin + 1, end - begin - 1)
    np.maximum.at(kerb, np.repeat(np.arange(len(begin)), np.diff(first)), along[order])
    touching: dict[int, list[tuple[int, bool]]] = {}
    for at in (begin, end):
        for street in np.flatnonzero((along[at] > 0) & walked).tolist():
            touching.setdefault(int(stops.node[at[street]]), []).append((street, bool(stops.ends[at[street]])))
    crossing = np.array(extract.ways.crossing, bool)[stops.way[begin]]
    for node, found in touching.items():
        all_of = [street for street, _ in found]
        ending = [street for street, ends in found if ends]
        chosen = [street for street in all_of if crossing[street]] or ending or all_of
        if len(found) == 2:
            chosen = [min(all_of, key=lambda street: streets.length[street])]
        kerb[chosen] = np.maximum(kerb[chosen], height[node])
    return replace(streets, kerb=kerb * walked)
