"""What may be expected of a scenario's crowds beforehand: the mean crowds, and mean times to cross the streets."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from sidestep.crowds.base import FlowModel
from sidestep.network.graph import RoadNetwork
from sidestep.scenarios.model import Scenario
from sidestep.walking.crossing_time import CrossingRule, mean_crossing_times
from sidestep.walking.expected_times import ExpectedTimes, Speeds
from sidestep.walking.speed_field import walking_speeds
from sidestep.walking.speed_laws import SpeedLaw

HOUR = 3600.0
FEWEST_SAMPLES, FEW_SAMPLES, MOST_SAMPLES = 16, 256, 1024
"""Futures that expected times are means over, for each hour: the fewest on large maps, the fewest and the most on
others."""
TIMES = 2**23
"""Times to cross a segment in all of the futures, up to which there are more than a few of these."""
MOST_TIMES = 2**26
"""The same, above which there are fewer: on large maps."""
AT_ONCE = 2**23
"""Times worked out side by side."""


class Crowds(eqx.Module):
    """Where futures come from."""

    flow: FlowModel
    law: SpeedLaw
    slots: int = eqx.field(static=True)
    as_expected: bool = eqx.field(static=True)
    """Whether crowds come as they are expected, without noise."""

    @staticmethod
    def of(scenario: Scenario, flow: FlowModel) -> "Crowds":
        """The crowds of a scenario that one of its models gives."""
        return Crowds(flow, scenario.speed_law, scenario.slots, scenario.flows == "forecast")


class Expectation(eqx.Module):
    """Speeds that may be expected, at each hour at which people set out."""

    crowds: Crowds
    """Those to learn from."""
    network: RoadNetwork
    key: Key[Array, ""]
    """Random stream of futures that serve no other purpose."""
    hours: Float[Array, " hour"]
    """Hours of the week at clock 0."""
    rule: CrossingRule = eqx.field(static=True)
    samples: int | None = eqx.field(static=True)
    """Futures for each hour; None: as many as the size of the map allows; 0: times are those in the mean crowds."""
    densities: bool = eqx.field(static=True)
    """Whether densities are kept beside speeds."""

    def speeds(self, scale: float = 1.0) -> Speeds:
        """Work out mean crowds, and mean times to cross.

        Parameters
        ----------
        scale
            Factor of all densities; 1 where crowds are not interpolated.

        Returns
        -------
        Speeds
            Expected times; speeds in the mean crowds where crowds always come as these, or no times are asked for.
        """
        crowds = self.crowds
        mean = walking_speeds(
            self.network, crowds.flow.expected(self.hours, crowds.slots), crowds.law, densities=self.densities
        )
        # Crowds between counters are linear from hour to hour.
        every = max(1, round(HOUR / mean.slot_seconds)) if mean.interpolated else 1
        if mean.interpolated:
            mean = mean.scaled(scale)
        if crowds.as_expected or crowds.flow.certain or self.samples == 0:
            return mean
        steps = math.ceil((mean.slots - 1) / every) + 1
        times = steps * self.network.segments
        samples = self.samples or min(
            max(TIMES // times, FEW_SAMPLES), MOST_SAMPLES, max(MOST_TIMES // times, FEWEST_SAMPLES)
        )
        chunk = min(max(AT_ONCE // times, 1), samples)
        keys = jax.random.split(self.key, math.ceil(samples / chunk))

        def one(hour: Float[Array, ""]) -> Float[Array, "segment step"]:
            def add(total: Array, key: Key[Array, ""]) -> tuple[Array, None]:
                drawn = crowds.flow.draw(key, jnp.full(chunk, hour), every * (steps - 1) + 1)
                speeds = walking_speeds(self.network, drawn, crowds.law)
                speeds = speeds.scaled(scale) if speeds.interpolated else speeds
                return total + mean_crossing_times(speeds, self.network.length, self.rule, every), None

            total, _ = jax.lax.scan(add, jnp.zeros((self.network.segments, steps)), keys)
            return total / len(keys)

        seconds = jax.lax.map(one, self.hours[: mean.count])
        return ExpectedTimes(mean, seconds, self.network.length, every * mean.slot_seconds)
