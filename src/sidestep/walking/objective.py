"""What walkers minimise: travel time, or a weighted sum of time, distance and exposure to crowds."""

from collections.abc import Callable
from typing import ClassVar, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from sidestep.walking.speed_laws import FREE_SPEED

PENALTY_SECONDS = 3600.0
"""Entering a segment above the maximum density costs as much as walking for so many seconds."""

Deferred = Callable[[], Float[Array, "*n"]]
"""Numbers that are worked out only by the objectives that need them."""


class Crossing(eqx.Module):
    """One segment walked, or each of many."""

    seconds: Float[Array, "*n"]
    """Time it takes, with the wait before it, in s."""
    cost: Float[Array, "*n"]
    """What the objective makes of it, in s."""
    measures: dict[str, Float[Array, "*n"]]
    """What else the objective counts, by the names in :attr:`Objective.measures`."""


@runtime_checkable
class Objective(Protocol):
    """What walkers keep low. Costs are in seconds, or what counts as much."""

    needs_density: ClassVar[bool]
    """Whether it asks for densities, so that they must be kept beside speeds."""
    earliest_is_best: ClassVar[bool]
    """Whether it never pays to arrive later at a node on the way."""
    measures: ClassVar[tuple[str, ...]]
    """What it counts beside the cost: ``metres``, ``exposure`` (person·s/m²) and ``too_dense`` (segments)."""

    @property
    def jumps(self) -> bool:
        """Whether costs change abruptly with the time of entry."""
        ...

    def measured(self) -> "WeightedObjective":
        """The same, but with all measures."""
        ...

    def crossing(
        self, seconds: Float[Array, "*n"], metres: Float[Array, "*n"], exposure: Deferred, density: Deferred, /
    ) -> Crossing:
        """Cost of segments.

        Parameters
        ----------
        seconds, metres
            Time that they take, and their length.
        exposure
            The density integrated over that time, in person·s/m².
        density
            The density at entry, in persons/m².
        """
        ...

    def step_cost(self, crossed: Crossing, elapsed: Float[Array, "*n"], /) -> Float[Array, "*n"]:
        """Cost of a step during which a walker's clock has gone on by ``elapsed`` seconds."""
        ...

    def walk_cost(
        self,
        total: Float[Array, "*n"],
        seconds: Float[Array, "*n"],
        arrived: Bool[Array, "*n"],
        horizon: Float[Array, ""],
        /,
    ) -> Float[Array, "*n"]:
        """Cost of a walk from the total of its steps and its travel time, which is the horizon if it did not arrive."""
        ...

    def penalty(self, density: Deferred, /) -> Float[Array, "*n"] | float:
        """The part of the cost that is paid for entering where it is too dense."""
        ...

    def without_penalty(self, crossed: Crossing, /) -> Float[Array, "*n"]:
        """The rest of the cost."""
        ...

    def turning_back(self, recent: Bool[Array, "*n"], /) -> Float[Array, "*n"] | float:
        """What an estimate adds for going back to nodes that were left recently.

        A walker who turns away from a street that is too dense would else be led back to it by the next estimate.
        """
        ...

    def waiting(self, seconds: Float[Array, "*n"], density: Deferred, /) -> Float[Array, "*n"]:
        """Cost of standing in a crowd for some seconds more."""
        ...


class TravelTime(eqx.Module):
    """Time alone, the neutral element: nothing but seconds is worked out, and cost is what the clock says."""

    needs_density: ClassVar[bool] = False
    earliest_is_best: ClassVar[bool] = True
    measures: ClassVar[tuple[str, ...]] = ()
    jumps: ClassVar[bool] = False

    def measured(self) -> "WeightedObjective":
        return WeightedObjective()

    def crossing(
        self, seconds: Float[Array, "*n"], _metres: Float[Array, "*n"], _exposure: Deferred, _density: Deferred
    ) -> Crossing:
        return Crossing(seconds, seconds, {})

    def step_cost(self, _crossed: Crossing, elapsed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return elapsed  # rounding included

    def walk_cost(
        self,
        _total: Float[Array, "*n"],
        seconds: Float[Array, "*n"],
        _arrived: Bool[Array, "*n"],
        _horizon: Float[Array, ""],
    ) -> Float[Array, "*n"]:
        return seconds

    def penalty(self, _density: Deferred) -> float:
        return 0.0

    def without_penalty(self, crossed: Crossing) -> Float[Array, "*n"]:
        return crossed.cost

    def turning_back(self, _recent: Bool[Array, "*n"]) -> float:
        return 0.0

    def waiting(self, seconds: Float[Array, "*n"], _density: Deferred) -> Float[Array, "*n"]:
        return seconds


class WeightedObjective(eqx.Module):
    """A weighted sum of time, distance and the crowd that walkers meet, with a density above which nobody should enter.

    Entering a segment above that density costs as much more as walking for ``PENALTY_SECONDS`` in such a crowd, so
    that walkers do it only where there is no other way.
    """

    needs_density: ClassVar[bool] = True
    earliest_is_best: ClassVar[bool] = False
    measures: ClassVar[tuple[str, ...]] = ("metres", "exposure", "too_dense")

    time: float | Float[Array, ""] = 1.0
    """Weight of each second."""
    distance: float | Float[Array, ""] = 0.0
    """Weight of each metre, in s."""
    exposure: float | Float[Array, ""] = 0.0
    """Weight of each person·s/m² met, in s: of the density, integrated over the walk."""
    max_density: float | Float[Array, ""] | None = None
    """Density in persons/m² above which nobody should enter a segment; None where there is no such density."""

    @property
    def jumps(self) -> bool:
        return self.max_density is not None

    def measured(self) -> "WeightedObjective":
        return self

    def crossing(
        self, seconds: Float[Array, "*n"], metres: Float[Array, "*n"], exposure: Deferred, density: Deferred
    ) -> Crossing:
        met, too_dense = exposure(), self._too_dense(density)
        cost = self.time * seconds + self.distance * metres + self.exposure * met
        measures = {"metres": metres, "exposure": met, "too_dense": too_dense}
        return Crossing(seconds, cost + self._penalty * too_dense, measures)

    def step_cost(self, crossed: Crossing, _elapsed: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return crossed.cost

    def walk_cost(
        self,
        total: Float[Array, "*n"],
        _seconds: Float[Array, "*n"],
        arrived: Bool[Array, "*n"],
        horizon: Float[Array, ""],
    ) -> Float[Array, "*n"]:
        return total + jnp.where(arrived, 0.0, horizon)

    def penalty(self, density: Deferred) -> Float[Array, "*n"] | float:
        return self._penalty * self._too_dense(density)

    def without_penalty(self, crossed: Crossing) -> Float[Array, "*n"]:
        return crossed.cost - self._penalty * crossed.measures["too_dense"]

    def turning_back(self, recent: Bool[Array, "*n"]) -> Float[Array, "*n"] | float:
        return self._penalty * recent if self.jumps else 0.0

    def waiting(self, seconds: Float[Array, "*n"], density: Deferred) -> Float[Array, "*n"]:
        return seconds * (self.time + self.exposure * density())

    @property
    def _penalty(self) -> float | Float[Array, ""]:
        dense = 0.0 if self.max_density is None else self.max_density
        return PENALTY_SECONDS * (self.time + self.distance * FREE_SPEED + self.exposure * dense)

    def _too_dense(self, density: Deferred) -> Float[Array, "*n"]:
        """1 where nobody should enter, elsewhere 0."""
        found = density()
        return jnp.zeros_like(found) if self.max_density is None else (found > self.max_density).astype(float)
