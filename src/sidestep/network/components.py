"""The streets that form one town: what can be reached from everywhere, and what only by restricted ways or ferries."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int

from sidestep.network.connected import components
from sidestep.network.streets import Streets


@dataclass(frozen=True, eq=False)
class Connected:
    """How streets hang together."""

    kept: Bool[np.ndarray, " street"]
    """Streets of the largest part in which every node can be reached from every other."""
    secluded: Bool[np.ndarray, " street"]
    """Public streets among them that can be reached, or left, only through restricted ones."""
    by_ferry: Bool[np.ndarray, " street"]
    """Other streets that would be kept if ferries were walked."""
    parts: int
    """Connected parts without a street that is kept."""


def connect(streets: Streets, ferries: Int[np.ndarray, "link 2"]) -> Connected:
    """Find the largest part of a town in which every node can be reached from every other.

    Parameters
    ----------
    streets
        At least one.
    ferries
        Nodes that ferries join.

    Returns
    -------
    Connected
        What is in that part, and how.
    """
    part = _components(streets, np.ones(len(streets), bool))
    kept = _within(part, streets, int(np.bincount(part).argmax()))
    public = kept & ~streets.restricted
    secluded = public
    if public.any():
        of = _components(streets, public)
        inhabited = np.bincount(of[np.unique(streets.ends[public])], minlength=of.max() + 1)
        secluded = public & ~_within(of, streets, int(inhabited.argmax()))
    with_ferries = _components(streets, np.ones(len(streets), bool), ferries)
    home = int(with_ferries[streets.ends[np.argmax(kept), 0]])
    weak = _components(streets, np.ones(len(streets), bool), connection="weak")[streets.ends[:, 0]]
    left_out = np.setdiff1d(weak, weak[kept])
    return Connected(kept, secluded, _within(with_ferries, streets, home) & ~kept, len(left_out))


def _components(
    streets: Streets,
    which: Bool[np.ndarray, " street"],
    links: Int[np.ndarray, "link 2"] | None = None,
    connection: Literal["strong", "weak"] = "strong",
) -> Int[np.ndarray, " node"]:
    """Number the component of each node, by some of the streets and links that are walked both ways."""
    more = np.zeros((0, 2), np.int64) if links is None else links
    back = streets.ends[which & ~streets.one_way, ::-1]
    tail, head = np.concatenate([streets.ends[which], back, more, more[:, ::-1]]).T
    nodes = int(max(streets.ends.max(), more.max(initial=0))) + 1
    return components(nodes, tail, head, connection)


def _within(component: Int[np.ndarray, " node"], streets: Streets, number: int) -> Bool[np.ndarray, " street"]:
    return (component[streets.ends] == number).all(axis=1)
