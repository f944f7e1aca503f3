"""Crowds on a whole network: how many people are on each segment in each slot."""

from abc import abstractmethod
from typing import ClassVar, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.counts import CountsError, LatestCounts
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.network.graph import RoadNetwork

SLOT_SECONDS = 300.0

Scalar = Float[Array, ""]
Index = Int[Array, ""]
Slots = Int[Array, " slots"]
"""Numbers of slots; slot 0 begins at clock 0."""
Counts = Float[Array, " counter"]
"""What each counter counts in one slot: persons on every segment, or persons/m² at every sensor."""
Hours = Float[Array, " hour"]
"""Hours of the week at clock 0, one for each future or destination; 0 is Monday 0:00."""


class FlowField(eqx.Module):
    """Volumes in each slot on each segment; leading axes, if any, count futures."""

    interpolated: ClassVar[Literal[False]] = False
    """Whether densities follow from those at a few sensors."""
    counted: Float[Array, "*future slot segment"]
    """What counters on all segments would count: persons, positive."""
    slot_seconds: float = eqx.field(static=True, default=SLOT_SECONDS)
    """Length of a slot."""

    def flow_matrix(self, network: RoadNetwork, slot: int) -> Float[Array, "node node"]:
        """The paper's P of one slot (eq. 2): persons from node i to node j, -1 where there is no segment."""
        return network.matrix(self.counted[slot])

    def density(self, network: RoadNetwork) -> Float[Array, "*future slot segment"]:
        """Densities in persons/m² on all segments."""
        return self.counted / (network.length * network.width)


class SensedField(eqx.Module):
    """Densities at sensors in each slot; leading axes, if any, count futures."""

    interpolated: ClassVar[Literal[True]] = True
    """Whether densities follow from those at a few sensors."""
    counted: Float[Array, "*future slot sensor"]
    """What all counters count: densities in persons/m²."""
    weights: InterpolationWeights
    """How densities on the segments follow from those at the sensors."""
    slot_seconds: float = eqx.field(static=True)
    """Length of a slot."""

    def density(self, _network: RoadNetwork) -> Float[Array, "*future slot segment"]:
        """Densities in persons/m² on all segments."""
        return self.weights.everywhere(self.counted)

    def density_at(self, future: Int[Array, ""], segment: Int[Array, "*n"], slot: Int[Array, ""]) -> Float[Array, "*n"]:
        """Densities in persons/m² on some segments in one slot of one future."""
        near = self.weights.of(segment)
        return (near.weight * self.counted[future, slot, near.sensor]).sum(axis=-1)

    def densities(self, future: Int[Array, ""], segment: Int[Array, ""]) -> Float[Array, " slot"]:
        """Densities in persons/m² on one segment in all slots of one future."""
        near = self.weights.of(segment)
        return near.weight @ self.counted[future, :, near.sensor]


Field = FlowField | SensedField
"""Type checkers tell the two apart by ``interpolated``; both have ``counted`` and ``density``."""


class FlowModel(eqx.Module):
    """A source of crowds for one network.

    ``hours`` are hours of the week at clock 0, one for each future; 0 is Monday 0:00. Models that are not ``timed``
    ignore them.
    """

    @property
    def timed(self) -> bool:
        """Whether crowds depend on the hour of the week."""
        return False

    @property
    def certain(self) -> bool:
        """Whether all futures are alike."""
        return False

    def covers(self, hour: float) -> bool:  # noqa: ARG002 - for models that are timed
        """Whether crowds are known at an hour of the week."""
        return True

    @property
    def coverage(self) -> str:
        """The hours of the week at which crowds are known, for error messages."""
        return "all hours of the week"

    @abstractmethod
    def expected(self, hours: Hours, slots: int) -> Field:
        """Mean crowds, with a leading axis: one field for each hour, or a single one where the model is not timed."""

    @abstractmethod
    def draw(self, key: Key[Array, ""], hours: Hours, slots: int) -> Field:
        """Possible futures, one for each hour."""

    @abstractmethod
    def ahead(self, now: Counts, hour: Scalar, slot: Index, slots: int) -> Float[Array, "slots counter"]:
        """Mean counts in slot number ``slot`` and those after it, given the counts ``now`` in this slot."""

    def expected_counts(self, hour: float) -> Float[np.ndarray, " counter"]:  # noqa: ARG002 - for models of sensors
        """Persons/h that each sensor is expected to count at an hour of the week; none where there are no sensors."""
        return np.zeros(0)

    def on_pieces(self, parent: Int[Array, " piece"], fraction: Float[Array, " piece"]) -> "FlowModel":  # noqa: ARG002
        """Crowds as dense on pieces of the segments, each a ``fraction`` of the length of its ``parent``.

        Parameters
        ----------
        parent, fraction
            Number of the segment that each piece is of, and its share of the length.

        Returns
        -------
        pieces
            Crowds on the pieces. Streets of grids are never split: their models return themselves.
        """
        return self

    def going_on_from(self, latest: LatestCounts) -> "FlowModel":  # noqa: ARG002 - for models of sensors
        """Crowds that go on from the latest counts of all sensors.

        Raises
        ------
        CountsError
            Crowds that are not known from sensors.
        """
        raise CountsError("these crowds are not known from sensors; leave out the current counts", field="live")
