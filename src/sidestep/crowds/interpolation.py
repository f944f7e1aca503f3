"""How what a few sensors count spreads along the streets to all others."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from sidestep.network.graph import NetworkError, RoadNetwork

NEAR = 4  # sensors that a segment listens to
FADED = 6.0  # reaches beyond which a sensor is not heard: exp(-6) is a quarter of a per cent


class InterpolationWeights(eqx.Module):
    """The sensors that each segment listens to, and how much; unused places have weight 0."""

    sensor: Int[Array, "*segment near"]
    weight: Float[Array, "*segment near"]  # they sum up to 1 at most

    def of(self, segment: Int[Array, "*n"]) -> "InterpolationWeights":
        """Weights of some segments only."""
        return InterpolationWeights(self.sensor[segment], self.weight[segment])

    def everywhere(self, sensed: Float[Array, "*lead sensor"]) -> Float[Array, "*lead segment"]:
        """What is sensed, spread to all segments."""
        # One sensor of each segment after the other: all at once would hold `near` times the result.
        return sum(
            (sensed[..., self.sensor[:, k]] * self.weight[:, k] for k in range(self.sensor.shape[1])),
            start=jnp.float32(0),
        )


def interpolation_weights(
    network: RoadNetwork, segment: Int[np.ndarray, " sensor"], reach: float
) -> InterpolationWeights:
    """Let the crowd of each sensor fade along the streets around it.

    A segment whose middle is d metres of walking from a sensor, in whichever direction is shorter, takes exp(-d/reach)
    of that sensor's density, from the ``NEAR`` nearest ones. Where these shares sum up to more than one they are
    divided by their sum; where they do not, fewer people walk than at any sensor.

    Parameters
    ----------
    segment
        Where each sensor stands. What stands on one direction of a street is on the other as well.
    reach
        Metres, positive.

    Raises
    ------
    NetworkError
        Sensors on segments that there are not, no sensor, a reach that is not positive.
    """
    if not len(segment) or segment.min() < 0 or segment.max() >= network.segments:
        raise NetworkError(f"sensors must stand on segments 0 to {network.segments - 1}, not {segment.tolist()}")
    if not 0 < reach < math.inf:
        raise NetworkError(f"the reach of a sensor must be a positive number of metres, not {reach}")
    away = walking_distances(network, segment, FADED * reach)
    near = min(NEAR, len(segment))
    nearest = np.argsort(away, axis=0, kind="stable")[:near].T
    share = np.exp(-np.take_along_axis(away.T, nearest, axis=1) / reach)
    share[share < math.exp(-FADED)] = 0.0
    share /= np.maximum(share.sum(axis=1, keepdims=True), 1.0)
    return InterpolationWeights(jnp.asarray(nearest, jnp.int32), jnp.asarray(share, jnp.float32))


def walking_distances(
    network: RoadNetwork, segment: Int[np.ndarray, " sensor"], limit: float = math.inf
) -> Float[np.ndarray, "sensor segment"]:
    """Metres from the middle of some segments to the middles of all, infinity beyond the limit.

    Streets are walked in both directions here, since crowds do: only pedestrians' one-way streets differ.
    """
    tail, head, length = (np.asarray(part) for part in (network.tail, network.head, network.length))
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    # Of parallel segments the shortest counts; a sparse matrix would add them up.
    order = np.lexsort((length, high, low))
    first = np.ones(len(order), bool)
    first[1:] = (np.diff(low[order]) != 0) | (np.diff(high[order]) != 0)
    kept = order[first]
    graph = coo_array((length[kept], (low[kept], high[kept])), shape=(network.nodes, network.nodes)).tocsr()
    away = np.empty((len(segment), network.segments), np.float32)
    for row, here in zip(away, segment.tolist(), strict=True):
        begin, end = dijkstra(graph, directed=False, indices=[tail[here], head[here]], limit=limit)
        node = np.minimum(begin, end) + length[here] / 2
        row[:] = np.minimum(node[tail], node[head]) + length / 2
        row[(low == low[here]) & (high == high[here]) & (length == length[here])] = 0.0
    return away
