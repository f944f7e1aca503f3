"""How far a walker has come along its route, by a position that is off by some metres."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

NEAR = 20.0
"""Metres beside its route up to which a walker is taken to be on it.

Satellites are off by 15 m in streets, and streets are wide. So nobody is taken to a parallel street that is nearer, and
a walker who leaves the route is found to have left it that far beside it.
"""

FASTEST = 3.0
"""Speed in m/s that no walker exceeds: a route that comes by the same place twice is followed in its order."""

_ALIKE = 1.0  # metres: of points of the route that are as near, the first one counts


@dataclass(frozen=True)
class Found:
    """A point of the route."""

    metres: float
    """From where the route begins."""

    away: float
    """Metres from the position."""


def follow(
    lines: Sequence[Float[np.ndarray, "_ 2"]],
    lengths: Sequence[float],
    here: Float[np.ndarray, "2"],
    done: float,
    seconds: float,
) -> Found | None:
    """Find a position on the rest of a route.

    The nearest point counts that the walker can have reached since the last position. If none of these is near,
    positions may have been missed, and the whole rest of the route counts. Who seems to be behind the last position,
    but near it, stays there; who is farther behind has turned back, and is no longer on the way.

    Parameters
    ----------
    lines, lengths
        The course of each segment, x and y in m, and its length in m.
    here
        x and y of the position in m.
    done
        Metres from the beginning to the last position.
    seconds
        Since the last position.

    Returns
    -------
    Found or None
        None where the walker is not on the route.
    """
    begin = np.concatenate([line[:-1] for line in lines])
    step = np.concatenate([np.diff(line, axis=0) for line in lines])
    metres, along = _measured(lines, lengths)
    part = np.clip(((here - begin) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    earliest = done - NEAR
    at, points = along + part * metres, begin + part[:, None] * step
    away = np.linalg.norm(points - here, axis=1)
    for latest in (done + FASTEST * seconds + 2 * NEAR, np.inf):
        possible = np.where((at >= earliest - 1e-6) & (at <= latest), away, np.inf)
        if possible.min() <= NEAR:
            first = int(np.flatnonzero(possible <= possible.min() + _ALIKE)[0])
            return Found(float(max(at[first], done)), float(away[first]))
    return None


def _measured(
    lines: Sequence[Float[np.ndarray, "_ 2"]], lengths: Sequence[float]
) -> tuple[Float[np.ndarray, " piece"], Float[np.ndarray, " piece"]]:
    """Metres of each straight piece of a route, and from where the route begins to it."""
    metres = []
    for line, length in zip(lines, lengths, strict=True):
        pieces = np.linalg.norm(np.diff(line, axis=0), axis=1)
        metres.append(pieces * (length / max(float(pieces.sum()), 1e-9)))
    every = np.concatenate(metres)
    return every, np.append(0.0, every.cumsum()[:-1])


def cut(line: Sequence[Sequence[float]], part: float) -> list[list[float]]:
    """The last ``part`` of a course, given as longitudes and latitudes."""
    points = np.array(line, float)
    pieces = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.append(0.0, pieces.cumsum())
    begin = (1 - part) * along[-1]
    first = [float(np.interp(begin, along, column)) for column in points.T]
    return [first, *points[along > begin + 1e-12].tolist()] if part < 1 else points.tolist()
