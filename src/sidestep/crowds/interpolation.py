"""Interpolation of densities from a few sensors to all segments, along the streets."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sidestep.network.graph import NetworkError, RoadNetwork

Stations = Int[np.ndarray, " sensor"]

NEAR = 4  # sensors with a weight on one segment
FADED = 6.0  # reaches beyond which a sensor has no weight: exp(-6) is a quarter of a per cent


class InterpolationWeights(eqx.Module):
    """The nearest sensors of each segment and their weights."""

    sensor: Int[Array, "*segment near"]
    """Numbers of the sensors."""
    weight: Float[Array, "*segment near"]
    """Their weights, which add up to 1 at most; 0 where there are fewer sensors."""

    def of(self, segment: Int[Array, "*n"]) -> "InterpolationWeights":
        """The weights of some segments only."""
        return InterpolationWeights(self.sensor[segment], self.weight[segment])

    def everywhere(self, sensed: Float[Array, "*lead sensor"]) -> Float[Array, "*lead segment"]:
        """Densities on all segments from those at the sensors."""
        # One sensor of each segment after the other: all at once would take `near` times the memory of the result.
        near = range(self.sensor.shape[1])
        return sum((sensed[..., self.sensor[:, k]] * self.weight[:, k] for k in near), start=jnp.float32(0))


def interpolation_weights(network: RoadNetwork, segment: Stations, reach: float) -> InterpolationWeights:
    """Let the density at each sensor fade along the streets around it.

    A segment whose middle is d metres of walking from a sensor, in the shorter direction, takes exp(-d/reach) of that
    sensor's density, from the ``NEAR`` nearest sensors. Weights that add up to more than one are divided by their sum;
    where they add up to less, fewer people walk than at any sensor.

    Parameters
    ----------
    network
        The streets.
    segment
        The segment on which each sensor stands; a sensor counts both directions of its street.
    reach
        Metres after which a density has faded to 1/e, positive.

    Returns
    -------
    weights
        Of the nearest sensors of each segment.

    Raises
    ------
    NetworkError
        No sensor, a segment outside the network, or a reach that is not positive.
    """
    if not len(segment) or segment.min() < 0 or segment.max() >= network.segments:
        every = f"segments 0 to {network.segments - 1}"
        raise NetworkError(f"sensors must stand on {every}, not {segment.tolist()}", field="segment")
    if not 0 < reach < math.inf:
        raise NetworkError(f"the reach of a sensor must be a positive number of metres, not {reach}", field="reach")
    away = walking_distances(network, segment, FADED * reach)
    near = min(NEAR, len(segment))
    nearest = np.argsort(away, axis=0, kind="stable")[:near].T
    share = np.exp(-np.take_along_axis(away.T, nearest, axis=1) / reach)
    share[share < math.exp(-FADED)] = 0.0
    share /= np.maximum(share.sum(axis=1, keepdims=True), 1.0)
    return InterpolationWeights(*jax.device_put((nearest.astype(np.int32), share.astype(np.float32))))


def walking_distances(
    network: RoadNetwork, segment: Stations, limit: float = math.inf
) -> Float[np.ndarray, "sensor segment"]:
    """Metres from the middles of some segments to the middles of all.

    Crowds walk every street in both directions, one-way or not.

    Parameters
    ----------
    network
        The streets.
    segment
        Where to begin.
    limit
        Metres after which to stop.

    Returns
    -------
    away
        Infinity where every way is longer than the limit.
    """
    from scipy.sparse import coo_array  # on use: grids do without it
    from scipy.sparse.csgraph import dijkstra

    tail, head, length = (np.asarray(part) for part in (network.tail, network.head, network.length))
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    pair = low.astype(np.int64) * network.nodes + high
    # Of parallel segments the shortest counts; a sparse matrix would add up their lengths.
    order = np.argsort(length, kind="stable")
    kept = order[np.unique(pair[order], return_index=True)[1]]
    graph = coo_array((length[kept], (low[kept], high[kept])), shape=(network.nodes, network.nodes)).tocsr()
    away = np.empty((len(segment), network.segments), np.float32)
    for row, here in zip(away, segment.tolist(), strict=True):
        begin, end = dijkstra(graph, directed=False, indices=[tail[here], head[here]], limit=limit)
        node = np.minimum(begin, end) + length[here] / 2
        row[:] = np.minimum(node[tail], node[head]) + length / 2
        row[(pair == pair[here]) & (length == length[here])] = 0.0
    return away
