"""Areas of a map around those parts of its streets that are reached within a limit."""

from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import contourpy
import numpy as np
from jaxtyping import Float, Int

from sidestep.network.snapping import SplitStreets
from sidestep.network.town import Town

CELL = 10.0
"""Metres between the points at which it is worked out what is reached, and at most between samples of a street."""
MOST_CELLS = 600
"""The most such points along one side of an area; of larger areas they lie farther apart."""
BESIDE = 30.0
"""Metres beside a street that are reached with it."""
ABOVE = 60.0
"""Seconds above a limit that count as much as more: at most half a cell is added where streets are not reached."""

Rings = list[Float[np.ndarray, "_ 2"]]
"""The outer ring of a polygon, anticlockwise, and its holes, clockwise; x and y in metres."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Points along all streets of a town, at most ``CELL`` apart."""

    xy: Float[np.ndarray, "sample 2"]
    """Metres."""
    fraction: Float[np.ndarray, " sample"]
    """Of the street's length, from its tail."""
    first: Int[np.ndarray, " border"]
    """Number of the first sample of each street, and at last the number of samples."""
    metres: Float[np.ndarray, " sample"]
    """Length of street that each stands for."""

    @classmethod
    def of(cls, town: Town) -> "Samples":
        """Sample the streets of a town.

        Parameters
        ----------
        town
            The streets.

        Returns
        -------
        Samples
            From tail to head of every street, both included.
        """
        points, first = town.project(town.points), town.first
        leg = np.linalg.norm(np.diff(points, axis=0), axis=1)
        leg[first[1:-1] - 1] = 0.0  # from one course to the next
        along = np.append(0.0, np.cumsum(leg))
        begin, end = along[first[:-1]], along[first[1:] - 1]
        number = np.maximum(np.ceil((end - begin) / CELL).astype(int), 1) + 1
        street = np.repeat(np.arange(town.streets), number)
        border = np.append(0, np.cumsum(number))
        fraction = (np.arange(border[-1]) - border[street]) / (number[street] - 1)
        # All courses one after the other are one line, so one interpolation does for all; a metre lies between two.
        at = begin[street] + fraction * (end - begin)[street] + street
        along = along + np.repeat(np.arange(town.streets), np.diff(first))
        xy = np.stack([np.interp(at, along, column) for column in points.T], axis=1)
        return cls(xy, fraction, border, np.asarray(town.length, float)[street] / number[street])

    def reached(
        self, streets: SplitStreets, begins: Float[np.ndarray, " segment"], seconds: Float[np.ndarray, " segment"]
    ) -> Float[np.ndarray, " sample"]:
        """When each sample is reached by those who walk on along all segments.

        Parameters
        ----------
        streets
            The same streets, some of them split.
        begins, seconds
            When each segment is entered, in s, infinite where it is not; and how long it takes to walk.

        Returns
        -------
        Float[np.ndarray, " sample"]
            Seconds; infinite where nobody comes.
        """
        segment = np.flatnonzero(np.isfinite(begins))
        street = streets.street[segment]
        number = np.diff(self.first)[street]
        which = np.repeat(np.arange(len(segment)), number)
        sample = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number) + self.first[street][which]
        begin, end = streets.begin[segment][which], streets.end[segment][which]
        share = (self.fraction[sample] - begin) / (end - begin)
        there = begins[segment][which] + share * seconds[segment][which]
        found = np.full(len(self.fraction), np.inf)
        on = (share >= -1e-9) & (share <= 1 + 1e-9)
        np.minimum.at(found, sample[on], there[on])
        return found


@dataclass(frozen=True, eq=False)
class Raster:
    """Points of a map, each with the cell of its nearest street."""

    x: Float[np.ndarray, " column"]
    y: Float[np.ndarray, " row"]
    cell: Int[np.ndarray, " sample"]
    """Number of the point nearest to each sample; -1 where that lies outside."""
    nearest: Int[np.ndarray, "row column"]
    """Number of the nearest point with a sample."""
    away: Float[np.ndarray, "row column"]
    """Metres from it."""

    @classmethod
    def around(cls, samples: Samples, inside: Float[np.ndarray, "point 2"]) -> "Raster":
        """Lay points over a part of a map.

        Parameters
        ----------
        samples
            Of the streets.
        inside
            x and y in metres of points that the part must hold, at least one.

        Returns
        -------
        Raster
            With room around them.
        """
        from scipy.ndimage import distance_transform_edt  # which routes do without

        low, high = inside.min(axis=0) - 2 * BESIDE, inside.max(axis=0) + 2 * BESIDE
        size = max(CELL, float((high - low).max()) / MOST_CELLS)
        columns, rows = (np.ceil((high - low) / size).astype(int) + 1).tolist()
        column, row = np.round((samples.xy - low) / size).astype(int).T
        on = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        cell = np.where(on, row * columns + column, -1)
        empty = np.ones(rows * columns, bool)
        empty[cell[on]] = False
        cells, (there, along) = distance_transform_edt(empty.reshape(rows, columns), return_indices=True)
        x, y = low[0] + size * np.arange(columns), low[1] + size * np.arange(rows)
        return cls(x, y, cell, there * columns + along, cells * size)

    def seconds(self, reached: Float[np.ndarray, " sample"], speed: float) -> Float[np.ndarray, "row column"]:
        """When each point is reached from its nearest street, at ``speed`` in m/s, given when samples are reached."""
        there = np.full(self.nearest.size, np.inf)
        on = self.cell >= 0
        np.minimum.at(there, self.cell[on], reached[on])
        return there[self.nearest] + self.away / speed

    def areas(self, seconds: Float[np.ndarray, "row column"], limit: float, speed: float) -> list[Rings]:
        """Draw the borders of what is reached.

        Parameters
        ----------
        seconds
            As of :meth:`seconds`.
        limit
            Seconds within which it is reached.
        speed
            m/s beside the streets.

        Returns
        -------
        list of Rings
            Polygons that lie apart; none where nothing is reached.
        """
        over = np.minimum(np.maximum(seconds - limit, (self.away - BESIDE) / speed), ABOVE)
        lines = contourpy.contour_generator(self.x, self.y, over, fill_type=contourpy.FillType.OuterOffset)
        points, offsets = cast("tuple[list[np.ndarray], list[np.ndarray]]", lines.filled(-1e9, 0.0))
        return [
            [polygon[begin:end] for begin, end in pairwise(border)]
            for polygon, border in zip(points, offsets, strict=True)
        ]


def ring_area(ring: Float[np.ndarray, "point 2"]) -> float:
    """Square metres within a ring that ends where it begins; below zero where it runs clockwise."""
    x, y = ring.T
    return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2
