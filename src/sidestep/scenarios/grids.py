"""Square grids drawn from a seed: streets, and how many people are on them (section V-A of the paper)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from sidestep.crowds.arima import ArimaFlow, change_step, load_fitted
from sidestep.crowds.base import FlowModel
from sidestep.crowds.rush import RushFlow, ShiftingFlow
from sidestep.network.graph import RoadNetwork, disjoint_union
from sidestep.network.grid import grid_network
from sidestep.scenarios.places import Grid


@dataclass(frozen=True)
class DrawnGrid:
    """One grid, and the people on it without waves and noise."""

    network: RoadNetwork
    volume: Float[np.ndarray, " segment"]
    """Persons."""
    amplitude: Float[np.ndarray, " segment"]
    """Of the segment's wave, in the logarithm of volume."""
    phase: Float[np.ndarray, " segment"]
    """In radians."""

    @classmethod
    def draw(cls, grid: Grid, side: int, rng: np.random.Generator) -> Self:
        """Draw streets, crowds and, where there are rush hours, waves.

        Parameters
        ----------
        grid
            What is drawn.
        side
            Nodes along one side, which may be another than the grid's.
        rng
            Source of the random numbers.
        """
        network = grid_network(side, rng, grid.lengths)
        tail, head = np.asarray(network.tail), np.asarray(network.head)
        volume = rng.uniform(*grid.volumes, network.segments)
        crowded = rng.choice(np.arange(1, network.nodes - 1), _crowded_nodes(grid, network.nodes), replace=False)
        if grid.rush is None or not grid.rush.shifting:
            at_crowded = np.isin(tail, crowded) | np.isin(head, crowded)
            drawn = np.maximum(rng.normal(*grid.crowded_volume, network.segments), 1.0)
            volume = np.where(at_crowded, drawn, volume)
        if grid.rush is None:
            return cls(network, volume, *np.zeros((2, network.segments)))
        # Both directions of a street have one wave.
        street = np.unique(np.sort([tail, head], axis=0), axis=1, return_inverse=True)[1].reshape(-1)
        amplitude = rng.uniform(*grid.rush.amplitude, network.segments)
        return cls(network, volume, amplitude[street], rng.uniform(0, 2 * np.pi, network.segments)[street])


def _crowded_nodes(grid: Grid, nodes: int) -> int:
    """As large a share of the nodes as on the first map."""
    return round(grid.crowded_nodes * nodes / grid.side**2)


def streets_and_crowds(grid: Grid, drawn: Sequence[DrawnGrid], slot_seconds: float) -> tuple[RoadNetwork, FlowModel]:
    """Several grids as one network without streets between them, and the crowds on it.

    Parameters
    ----------
    grid
        What they were drawn from.
    drawn
        The grids.
    slot_seconds
        Seconds in which crowds do not change.
    """
    network = disjoint_union([one.network for one in drawn])
    volume, amplitude, phase = (
        jnp.asarray(np.concatenate(each), jnp.float32)
        for each in zip(*((one.volume, one.amplitude, one.phase) for one in drawn), strict=True)
    )
    rush = grid.rush
    if rush is None:
        return network, ArimaFlow(volume, change_step(load_fitted(), slot_seconds))
    flow = RushFlow(volume, amplitude, phase, rush.period, rush.phi, rush.sigma, slot_seconds)
    if not rush.shifting:
        return network, flow
    parts = [one.network.nodes for one in drawn]
    spared = np.zeros(network.nodes, bool)
    first = np.cumsum((0, *parts))
    spared[[*first[:-1], *(first[1:] - 1)]] = True
    ends = jnp.stack([network.tail, network.head], axis=1)
    crowded_nodes = sum(_crowded_nodes(grid, nodes) for nodes in parts)
    return network, ShiftingFlow(flow, ends, jnp.asarray(spared), crowded_nodes, *grid.crowded_volume)
