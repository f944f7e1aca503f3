"""Crowds of a real place as its sensors would count them, on every segment around the sensors.

Counts are hourly: between the middles of two hours, logarithms are linear.
"""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.arima import stationary_ar1
from sidestep.crowds.base import Counts, FlowModel, Hours, Index, Scalar, SensedField, Slots
from sidestep.crowds.counts import LatestCounts
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.normals import standard_normal
from sidestep.crowds.profile import HOURS_OF_WEEK, hour_of_week
from sidestep.crowds.sensor_model import SensorModel
from sidestep.programs import on_device, program

HOUR = 3600.0

Sensors = Float[Array, " sensor"]
Levels = Float[Array, "slots sensor"]
"""Logarithms of one more than the count in persons/h, or what is added to them."""
Lasting = Float[Array, "future sensor"]
Residuals = Float[Array, "future knot sensor"]
Knots = Int[Array, "slots #sensor"]
"""Numbers of hours, the same for all sensors or each its own."""
Since = Float[Array, "slots #sensor"]
"""Hours, the same for all sensors or each its own."""


def _full_hour() -> Scalar:
    return jnp.zeros(())


class CurrentCounts(eqx.Module):
    """How the counts of an hour, just before or around a departure, differ from the expected ones.

    Sensors are counted in the same hour, or each in its own.
    """

    residual: Sensors
    """log(1 + count) less its expected value in that hour; NaN where nothing was counted."""
    since: Scalar | Sensors
    """Hours from the middle of the counted hour to clock 0, from -1/2 to 2."""
    offset: Scalar | Sensors = eqx.field(default_factory=_full_hour)
    """Hours from the full hour to the begin of the counted one, less than 1."""


class SensorFlow(FlowModel):
    """Crowds as sensors would count them: simulated, or those of recorded weeks.

    Levels are logarithms of one more than the count, in persons/h. A level is the sum of the expected one of the hour
    of the week, a part that lasts as long as anybody walks, and a residual that fades from hour to hour.
    """

    model: SensorModel
    """What the sensors are expected to count, and how counts vary."""
    weights: InterpolationWeights
    """How densities on the segments follow from those at the sensors."""
    per_count: Sensors
    """Density at each sensor in persons/m² for one person/h."""
    slot_seconds: float = eqx.field(static=True)
    """Length of a slot."""
    record: Float[Array, "week 168 sensor"] | None = None
    """Levels of recorded weeks less the expected ones; if given, each future is one of these weeks."""
    uneven: float = eqx.field(static=True, default=0.0)
    """How much the demand of every future differs from sensor to sensor: standard deviation of the logarithm of a
    lognormal factor of mean 1."""
    current: CurrentCounts | None = None
    """Counts that crowds go on from; sensors without one begin anywhere."""

    @property
    def timed(self) -> bool:
        return True

    def expected(self, hours: Hours, slots: int) -> SensedField:
        """Mean densities for each of the hours."""
        number, current = jnp.arange(slots), self.current

        def one(start: Scalar) -> Levels:
            level, sigma = self._levels(start, number)
            since = self._since(start, number)
            variance = self._lasting + self._covariance(since, since) * sigma**2
            if current is None:
                return level + variance / 2
            log_density_ratio, sigma_then = self._counted(current, hours[0])
            covariance = self._lasting + self._covariance(jnp.zeros((1, 1)), since) * sigma_then * sigma
            covariance = jnp.where(jnp.isfinite(current.residual), covariance, 0.0)
            return level + _conditional_mean(log_density_ratio, self._lasting + sigma_then**2, covariance, variance)

        return self._field(jax.vmap(one)(hours))

    def draw(self, key: Key[Array, ""], hours: Hours, slots: int) -> SensedField:
        """Possible futures, or recorded ones."""
        knots = math.ceil(slots * self.slot_seconds / HOUR) + 2
        for_lasting, for_hours = jax.random.split(key)
        lasting = jax.random.normal(for_lasting, (*hours.shape, *self.model.weekly.shape))
        if self.record is None:
            lasting, residual = self._simulated(for_hours, lasting * jnp.sqrt(self._lasting), hours, knots)
        else:
            # How the whole week differs was recorded.
            lasting, residual = lasting * self.uneven, self._recorded(self.record, for_hours, hours, knots)

        def one(start: Scalar, lasting: Sensors, residual: Float[Array, "knot sensor"]) -> Levels:
            _, hour, fraction = self._knots(start, jnp.arange(slots))
            level, sigma = self._levels(start, jnp.arange(slots))
            between = (1 - fraction) * _rows(residual, hour) + fraction * _rows(residual, hour + 1)
            return level + lasting + between * (sigma if self.record is None else 1.0)

        return self._field(jax.vmap(one)(hours, lasting, residual))

    def ahead(self, now: Counts, hour: Scalar, slot: Index, slots: int) -> Float[Array, "slots counter"]:
        """Mean densities in this and the next slots, given those in this one; what was not expected fades in part."""
        after = slot + jnp.arange(slots)
        level, sigma = self._levels(hour, after)
        since = self._since(hour, after)
        variance = self._lasting + self._covariance(since, since) * sigma**2
        log_density_ratio = jnp.log1p(now / self.per_count) - level[0]
        covariance = self._lasting + self._covariance(since[:1], since) * sigma[0] * sigma
        return self._density(level + _conditional_mean(log_density_ratio, variance[0], covariance, variance))

    def expected_counts(self, hour: float) -> Float[np.ndarray, " counter"]:
        return np.asarray(_expected_density(self, on_device(np.array([hour])))) / np.asarray(self.per_count)

    def on_pieces(self, parent: Int[Array, " piece"], _fraction: Float[Array, " piece"]) -> "SensorFlow":
        return replace(self, weights=self.weights.of(parent))

    def going_on_from(self, latest: LatestCounts) -> "SensorFlow":
        """Simulated crowds that go on from the latest counts of all sensors."""
        table, sensor = np.asarray(self.model.expected), np.arange(len(latest.counts))
        begins = np.asarray(latest.hour)
        whole = begins.astype("datetime64[h]")
        offset = (begins - whole) / np.timedelta64(1, "h")
        hour = hour_of_week(np.broadcast_to(whole, sensor.shape))
        after = (hour + 1) % len(table)
        expected = (1 - offset) * table[hour, sensor] + offset * table[after, sensor]
        floats = (np.log1p(latest.counts) - expected, latest.since, offset)
        return replace(self, current=CurrentCounts(*(jnp.asarray(each, jnp.float32) for each in floats)), record=None)

    @property
    def _lasting(self) -> Sensors:
        """Variance of the part of the level that lasts as long as anybody walks."""
        return self.model.weekly**2 + self.uneven**2

    def _counted(self, current: CurrentCounts, hour: Scalar) -> tuple[Sensors, Sensors]:
        """How current counts differ from the expected ones, 0 where there are none, and the residuals' sigma then."""
        counted, sigma = self._counted_hour(current, hour), self.model.sigma
        sensor = jnp.arange(sigma.shape[1])
        before, after = sigma[counted % len(sigma), sensor], sigma[(counted + 1) % len(sigma), sensor]
        log_density_ratio = jnp.where(jnp.isfinite(current.residual), current.residual + self.uneven**2 / 2, 0.0)
        return log_density_ratio, (1 - current.offset) * before + current.offset * after

    @staticmethod
    def _counted_hour(current: CurrentCounts, hour: Scalar) -> Int[Array, "*sensor"]:
        """The full hour in which the counted one begins, where clock 0 is at an hour of the week."""
        return jnp.round(hour - current.since - 0.5 - current.offset).astype(jnp.int32)

    def _hours(self, start: Scalar, slot: Slots) -> tuple[Index, Slots, Float[Array, " slots"]]:
        """The hour whose middle comes before clock 0, and whole hours and fractions from there to middles of slots."""
        middle = start + (slot + 0.5) * (self.slot_seconds / HOUR) - 0.5
        first = jnp.floor(start - 0.5)
        hour = jnp.floor(middle - first)
        return first.astype(jnp.int32), hour.astype(jnp.int32), middle - first - hour

    def _knots(self, start: Scalar, slot: Slots) -> tuple[Int[Array, "*sensor"], Knots, Float[Array, "slots #sensor"]]:
        """As :meth:`_hours`, but of hours that begin as the counted ones do: their middles have the drawn residuals."""
        offset = 0.0 if self.current is None else self.current.offset
        middle = (start + (slot + 0.5) * (self.slot_seconds / HOUR) - 0.5)[:, None] - offset
        first = jnp.floor(start - 0.5 - offset)
        hour = jnp.floor(middle - first)
        return first.astype(jnp.int32), hour.astype(jnp.int32), middle - first - hour

    def _levels(self, start: Scalar, slot: Slots) -> tuple[Levels, Levels]:
        """Median levels in some slots, and the sigma of the residuals from them."""
        first, hour, fraction = self._hours(start, slot)

        def at(table: Float[Array, "hours sensor"]) -> Levels:
            before, after = table[(first + hour) % len(table)], table[(first + hour + 1) % len(table)]
            return (1 - fraction)[:, None] * before + fraction[:, None] * after

        return at(self.model.expected) - self.uneven**2 / 2, at(self.model.sigma)

    def _since(self, start: Scalar, slot: Slots) -> Since:
        """Hours from the first drawn residual to the middles of slots."""
        # Residuals are drawn at the middles of hours and linear in between. The first is that of the hour whose middle
        # comes before clock 0, or that of the counted hour, before which residuals are as counted.
        if self.current is None:
            _, hour, fraction = self._hours(start, slot)
            return (hour + fraction)[:, None]
        return jnp.maximum(self.current.since + ((slot + 0.5) * (self.slot_seconds / HOUR))[:, None], 0.0)

    def _covariance(self, early: Float[Array, "#slots #sensor"], late: Since) -> Levels:
        """Covariance of residuals at two times (in hours since the first) in units of their standard deviations."""
        first, second = jnp.floor(early), jnp.floor(late)
        begun, passed, apart = early - first, late - second, second - first
        # Each of the two drawn residuals around one time with each around the other: phi to the power of hours between.
        phi = self.model.phi
        same = (1 - begun) * (1 - passed) + begun * passed
        outer, inner = (1 - begun) * passed, begun * (1 - passed)
        return phi**apart * (same + outer * phi) + inner * phi ** jnp.abs(apart - 1)

    def _simulated(self, key: Key[Array, ""], lasting: Lasting, hours: Hours, knots: int) -> tuple[Lasting, Residuals]:
        """The lasting part, and residuals in units of their standard deviations at ``knots`` middles of hours."""
        phi, current = self.model.phi, self.current
        steps = knots if current is None else knots + 1  # since the counts may be of the hour before the first one
        innovations = standard_normal(key, (steps, *lasting.shape)) @ self.model.cholesky.T
        first = innovations[0]
        if current is not None:
            # Matheron's rule: what was drawn is corrected by as much of the miss as falls on each part.
            log_density_ratio, sigma = self._counted(current, hours[0])
            miss = jnp.where(jnp.isfinite(current.residual), log_density_ratio - lasting - sigma * first, 0.0)
            variance = jnp.maximum(self._lasting + sigma**2, 1e-12)
            lasting, first = lasting + self._lasting / variance * miss, first + sigma / variance * miss
        chain = stationary_ar1(phi, first, innovations[1:])
        if current is None:
            return lasting, chain
        # The chain begins at the hour that was counted. Before its middle, residuals are as counted.
        first_knot, _, _ = self._knots(hours[0], jnp.arange(1))
        after = jnp.arange(knots)[:, None] + (first_knot - self._counted_hour(current, hours[0]))
        return lasting, jax.vmap(_rows, (0, None))(chain, jnp.clip(after, 0, steps - 1))

    @staticmethod
    def _recorded(record: Float[Array, "week 168 sensor"], key: Key[Array, ""], hours: Hours, knots: int) -> Residuals:
        """Residuals as they were counted."""
        whole = record.reshape(-1, record.shape[-1])
        week = jax.random.randint(key, hours.shape, 0, len(record))
        first = week * HOURS_OF_WEEK + jnp.floor(hours - 0.5).astype(jnp.int32)
        # After the last hour of the record comes its first one, should anybody still walk then.
        return whole[(first[:, None] + jnp.arange(knots)) % len(whole)]

    def _density(self, level: Float[Array, "*lead sensor"]) -> Float[Array, "*lead sensor"]:
        return jnp.maximum(jnp.expm1(level), 0.0) * self.per_count

    def _field(self, level: Float[Array, "future slot sensor"]) -> SensedField:
        return SensedField(self._density(level), self.weights, self.slot_seconds)


@program()
def _expected_density(flow: SensorFlow, hours: Hours) -> Sensors:
    """Mean densities in the first slot from the only hour on."""
    return flow.expected(hours, 1).counted[0, 0]


def _rows(table: Float[Array, "knot sensor"], row: Knots) -> Levels:
    """What a table has in some rows, the same for all sensors or each its own."""
    if row.shape[1] == 1:
        return table[row[:, 0]]
    return jnp.take_along_axis(table, row, axis=0)


def _conditional_mean(
    log_density_ratio: Sensors, variance_then: Sensors, covariance: Levels, variance: Levels
) -> Levels:
    """What a known normal number adds to the logarithm of the mean of later lognormal ones."""
    share = covariance / jnp.maximum(variance_then, 1e-12)
    return share * log_density_ratio + (variance - share * covariance) / 2
