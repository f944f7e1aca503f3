"""Grids drawn from seeds: their streets, and the crowds on them."""

from collections.abc import Sequence

import numpy as np

from sidestep.crowds.arima import ArimaFlow, change_step, load_fitted
from sidestep.crowds.base import FlowModel
from sidestep.crowds.rush import RushFlow, ShiftingFlow
from sidestep.network.graph import RoadNetwork, disjoint_union
from sidestep.network.grid import grid_network
from sidestep.programs import on_device
from sidestep.scenarios.places import Grid


def _draw_grid(grid: Grid, side: int, seed: tuple[int, ...]) -> tuple[RoadNetwork, np.ndarray, np.ndarray, np.ndarray]:
    """Draw streets and crowds (section V-A of the paper).

    Returns
    -------
    network
        The streets.
    volume, amplitude, phase
        Of each segment the persons without waves and noise, and its wave in rush hours: the amplitude in the logarithm
        of volume, the phase in radians.
    """
    rng = np.random.default_rng(seed)
    network = grid_network(side, rng, grid.lengths)
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    volume = rng.uniform(*grid.volumes, network.segments)
    crowded = rng.choice(np.arange(1, network.nodes - 1), _crowded_nodes(grid, network.nodes), replace=False)
    if grid.rush is None or not grid.rush.shifting:
        at_crowded = np.isin(tail, crowded) | np.isin(head, crowded)
        drawn = np.maximum(rng.normal(*grid.crowded_volume, network.segments), 1.0)
        volume = np.where(at_crowded, drawn, volume)
    if grid.rush is None:
        return network, volume, np.zeros(network.segments), np.zeros(network.segments)
    # Both directions of a street have one wave.
    street = np.unique(np.sort([tail, head], axis=0), axis=1, return_inverse=True)[1].reshape(-1)
    amplitude = rng.uniform(*grid.rush.amplitude, network.segments)
    return network, volume, amplitude[street], rng.uniform(0, 2 * np.pi, network.segments)[street]


def _crowded_nodes(grid: Grid, nodes: int) -> int:
    """As large a share of the nodes as on the first map."""
    return round(grid.crowded_nodes * nodes / grid.nodes)


def on_grids(
    grid: Grid, side: int, seeds: Sequence[tuple[int, ...]], slot_seconds: float
) -> tuple[RoadNetwork, FlowModel, tuple[int, ...]]:
    """A grid drawn from each seed, as one map without streets between them, and the crowds on it.

    Parameters
    ----------
    grid, side
        The place, and the nodes along one side.
    seeds
        One for each part of the map.
    slot_seconds
        Length of a slot, s.

    Returns
    -------
    RoadNetwork, FlowModel, tuple[int, ...]
        Streets, crowds, and the number of nodes of each part.
    """
    networks, *columns = zip(*(_draw_grid(grid, side, seed) for seed in seeds), strict=True)
    network, parts = disjoint_union(networks), tuple(each.nodes for each in networks)
    volume, amplitude, phase = (on_device(np.concatenate(each)) for each in columns)
    flow: FlowModel
    if (rush := grid.rush) is None:
        flow = ArimaFlow(volume, change_step(load_fitted(), slot_seconds))
    else:
        flow = RushFlow(rush.phi, rush.sigma, slot_seconds, volume, amplitude, phase, rush.period)
        if rush.shifting:
            first = np.cumsum((0, *parts))
            spared = np.isin(np.arange(network.nodes), (first[:-1], first[1:] - 1))
            ends = on_device(np.stack([network.tail, network.head], axis=1), np.int32)
            crowded_nodes = sum(_crowded_nodes(grid, nodes) for nodes in parts)
            flow = ShiftingFlow(flow, ends, on_device(spared, np.bool_), crowded_nodes, *grid.crowded_volume)
    return network, flow, parts
