"""What may be expected of a scenario's crowds beforehand: the mean crowds, and mean times to cross the streets."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from sidestep.crowds.base import FlowModel
from sidestep.network.graph import RoadNetwork
from sidestep.programs import on_device, program
from sidestep.scenarios.maps import ScenarioMap, purpose_key
from sidestep.scenarios.model import Scenario
from sidestep.walking.crossing_time import CrossingRule, mean_crossing_times
from sidestep.walking.expected_times import ExpectedTimes, Speeds
from sidestep.walking.speed_field import KnownSpeeds, walking_speeds
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

    @property
    def is_certain(self) -> bool:
        """Whether times are those in the mean crowds."""
        return self.crowds.as_expected or self.crowds.flow.certain or self.samples == 0

    def speeds(self, scale: float = 1.0, pace: Float[Array, "segment step"] | None = None) -> Speeds:
        """Work out mean crowds, and mean times to cross.

        Parameters
        ----------
        scale
            Factor of all densities; 1 where crowds are not interpolated.
        pace
            Mean seconds for each metre at the only hour, as :meth:`pace` gives them, if they are known already.

        Returns
        -------
        Speeds
            Expected times; speeds in the mean crowds where crowds always come as these, or no times are asked for.
        """
        crowds = self.crowds
        field = crowds.flow.expected(self.hours, crowds.slots)
        mean = walking_speeds(self.network, field, crowds.law, densities=self.densities)
        mean = mean.scaled(scale) if mean.interpolated else mean
        if self.is_certain:
            return mean
        paces = self.pace(self.hours[: mean.count], scale) if pace is None else pace[None]
        length = self.network.length
        return ExpectedTimes(mean, paces * length[:, None], length, self._every(mean) * mean.slot_seconds)

    def pace(
        self, hours: Float[Array, " hour"], scale: float = 1.0, first: int | None = None
    ) -> Float[Array, "hour segment step"]:
        """Work out mean seconds to cross each metre of the segments, entered as steps begin.

        Parameters
        ----------
        hours, scale
            As in :meth:`speeds`.
        first
            Slots that crowds are drawn for, the first ones, for which time and memory are taken; by default all. All
            are where crowds are interpolated, and by the rule of entry.

        Returns
        -------
        Float[Array, "hour segment step"]
            NaN where the slots are too few. The rest is the same to the bit: futures are as many, and their crowds
            the same.
        """
        crowds, length = self.crowds, self.network.length
        shapes = jax.eval_shape(lambda: self._drawn(1, self.key, hours[0], crowds.slots, scale))
        every = self._every(shapes)
        steps = math.ceil((crowds.slots - 1) / every) + 1
        slots = every * (steps - 1) + 1
        # Between counters steps are few. By the rule of entry XLA adds up the futures of fewer slots in another order.
        if first is None or shapes.interpolated or self.rule == "entry":
            first = slots
        drawn = min(first, slots)
        times = steps * self.network.segments
        samples = self.samples or min(
            max(TIMES // times, FEW_SAMPLES), MOST_SAMPLES, max(MOST_TIMES // times, FEWEST_SAMPLES)
        )
        chunk = min(max(AT_ONCE // times, 1), samples)
        keys = jax.random.split(self.key, math.ceil(samples / chunk))

        def one(hour: Float[Array, ""]) -> Float[Array, "segment step"]:
            def add(total: Array, key: Key[Array, ""]) -> tuple[Array, None]:
                speeds = self._drawn(chunk, key, hour, drawn, scale)
                told = None if drawn == slots else steps
                return total + mean_crossing_times(speeds, length, self.rule, every, told), None

            total, _ = jax.lax.scan(add, jnp.zeros((self.network.segments, steps)), keys)
            return total / (len(keys) * length[:, None])

        return jax.lax.map(one, hours)

    def _drawn(
        self, futures: int, key: Key[Array, ""], hour: Float[Array, ""], slots: int, scale: float
    ) -> KnownSpeeds:
        crowds = self.crowds
        drawn = crowds.flow.draw(key, jnp.full(futures, hour), slots)
        speeds = walking_speeds(self.network, drawn, crowds.law)
        return speeds.scaled(scale) if speeds.interpolated else speeds

    @staticmethod
    def _every(speeds: KnownSpeeds) -> int:
        """Slots in a step: crowds between counters are linear from hour to hour."""
        return max(1, round(HOUR / speeds.slot_seconds)) if speeds.interpolated else 1


def expected_pace(
    scenario: Scenario, scenario_map: ScenarioMap, hour: float, first: int | None = None
) -> Float[Array, "segment step"] | None:
    """Mean seconds to cross each metre of a map's segments, for several environments of the same hour.

    Parameters
    ----------
    scenario, scenario_map
        The problem, and its map.
    hour
        Hour of the week at clock 0.
    first
        Slots that crowds are drawn for, as in :meth:`Expectation.pace`; by default all.

    Returns
    -------
    Float[Array, "segment step"] or None
        As :func:`sidestep.scenarios.futures.make_environment` takes them; None where crowds come as they are expected.
    """
    key, crowds = purpose_key(scenario_map, "expect"), Crowds.of(scenario, scenario_map.flow)
    hours = on_device(np.array([hour]))
    expectation = Expectation(crowds, scenario_map.network, key, hours, scenario.rule, None, densities=False)
    return None if expectation.is_certain else _pace(expectation, first=first)


@program("first")
def _pace(expectation: Expectation, *, first: int | None) -> Float[Array, "segment step"]:
    return expectation.pace(expectation.hours, first=first)[0]
