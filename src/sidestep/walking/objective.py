"""What walkers minimise: travel time, or a weighted sum of time, distance and exposure to crowds."""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sidestep.walking.speed_laws import FREE_SPEED

PENALTY_SECONDS = 3600.0
"""Entering a segment above the maximum density costs as much as walking for so many seconds."""

Scalar = Float[Array, ""]
Numbers = Float[Array, "*n"]
Deferred = Callable[[], Numbers]
"""Numbers that are worked out only for the objectives that need them."""


class Crossing(eqx.Module):
    """One segment walked, or each of many."""

    seconds: Numbers
    """Time it takes, with the wait before it, in s."""
    cost: Numbers
    """By the objective, in s."""
    measures: dict[str, Numbers]
    """What else the objective counts: the names in :attr:`TravelTime.measures`."""


class TravelTime(eqx.Module):
    """Time alone, the neutral element: nothing but seconds is worked out, and cost is what the clock says.

    Costs are in seconds, or what counts as much.
    """

    needs_density: ClassVar[bool] = False
    """Whether more than time counts, so that densities must be kept beside speeds, and arriving late may be better."""
    measures: ClassVar[tuple[str, ...]] = ()
    """What it counts beside the cost: ``metres``, ``exposure`` (person·s/m²) and ``too_dense`` (segments)."""
    jumps: ClassVar[bool] = False
    """Whether costs jump as it becomes too dense somewhere."""
    penalty: ClassVar[float] = 0.0
    """Cost of entering a segment where it is too dense."""

    def too_dense(self, _density: Deferred) -> float:
        """1 where a density in persons/m² is such that nobody should enter, elsewhere 0."""
        return 0.0

    def crossing(self, seconds: Numbers, _metres: Numbers, _exposure: Deferred, _density: Deferred) -> Crossing:
        """Cost of segments.

        Parameters
        ----------
        seconds, metres
            Time that they take, and their length.
        exposure
            The density integrated over that time, in person·s/m².
        density
            The density at entry, in persons/m².

        Returns
        -------
        crossing
            Its cost, and the measures that this objective needs.
        """
        return Crossing(seconds, seconds, {})

    def step_cost(self, _crossed: Crossing, elapsed: Numbers) -> Numbers:
        """Cost of a step during which a walker's clock has gone on by ``elapsed`` seconds, rounding included."""
        return elapsed

    def walk_cost(self, _total: Numbers, seconds: Numbers, _arrived: Bool[Array, "*n"], _horizon: Scalar) -> Numbers:
        """Cost of a walk from the total of its steps and its travel time, which is the horizon if it did not arrive."""
        return seconds

    def waiting(self, seconds: Numbers, _density: Deferred) -> Numbers:
        """Cost of standing in a crowd for some seconds more."""
        return seconds

    def measured(self) -> "WeightedObjective":
        """The same objective with all measures."""
        return WeightedObjective()


class WeightedObjective(eqx.Module):
    """A weighted sum of time, distance and the crowd that walkers meet, with a density above which nobody should enter.

    Entering a segment above that density costs as much more as walking for ``PENALTY_SECONDS`` in such a crowd, so
    that walkers do it only where there is no other way.
    """

    needs_density: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ("metres", "exposure", "too_dense")

    time: float | Scalar = 1.0
    """Weight of each second."""
    distance: float | Scalar = 0.0
    """Weight of each metre, in s."""
    exposure: float | Scalar = 0.0
    """Weight of each person·s/m² met, in s: of the density, integrated over the walk."""
    max_density: float | Scalar | None = None
    """Density in persons/m² above which nobody should enter a segment; None where there is no such density."""

    @property
    def jumps(self) -> bool:
        return self.max_density is not None

    @property
    def penalty(self) -> float | Scalar:
        if self.max_density is None:
            return 0.0
        return PENALTY_SECONDS * (self.time + self.distance * FREE_SPEED + self.exposure * self.max_density)

    def too_dense(self, density: Deferred) -> Numbers:
        found = density()
        return jnp.zeros_like(found) if self.max_density is None else (found > self.max_density).astype(float)

    def crossing(self, seconds: Numbers, metres: Numbers, exposure: Deferred, density: Deferred) -> Crossing:
        met, too_dense = exposure(), self.too_dense(density)
        cost = self.time * seconds + self.distance * metres + self.exposure * met + self.penalty * too_dense
        return Crossing(seconds, cost, {"metres": metres, "exposure": met, "too_dense": too_dense})

    def step_cost(self, crossed: Crossing, _elapsed: Numbers) -> Numbers:
        return crossed.cost

    def walk_cost(self, total: Numbers, _seconds: Numbers, arrived: Bool[Array, "*n"], horizon: Scalar) -> Numbers:
        return total + jnp.where(arrived, 0.0, horizon)

    def waiting(self, seconds: Numbers, density: Deferred) -> Numbers:
        return seconds * (self.time + self.exposure * density())

    def measured(self) -> "WeightedObjective":
        return self


Objective = TravelTime | WeightedObjective
"""What walkers keep low; both have the methods of :class:`TravelTime`."""
