"""Crowds of a real place: what its sensors usually count, how today differs, and how both spread along the streets.

The logarithm of a count (of one more, so that nobody is no trouble) is the sum of three: the usual level of the hour
of the week; how this whole week differs from it; and an AR(1), in units of how much counts vary at that hour of the
day, as nights do more than noons. The sensors' innovations go together as they were counted to. Counts are hourly: in
between, logarithms are linear from one middle of an hour to the next.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.arima import SeriesError
from sidestep.crowds.base import FlowModel, SensedField
from sidestep.crowds.counts import CountTable
from sidestep.crowds.interpolation import InterpolationWeights
from sidestep.crowds.live import CurrentCounts
from sidestep.crowds.profile import HOURS_OF_WEEK, hour_of_week

HOUR = 3600.0
MOST_MEMORY = 0.99  # of the residuals from hour to hour; one that never fades has no stationary deviation
LEAST_DEVIATION = 0.001  # of a logarithm
WILDEST = 4.0  # deviations
_NORMAL_QUARTILES = 1.349  # between the quartiles of a standard normal number
FEWEST_HOURS = 4 * HOURS_OF_WEEK  # counted hours to fit to


class SensorModel(eqx.Module):
    """What sensors usually count, and how that varies."""

    expected: Float[Array, "168 sensor"]  # mean of log(1 + persons/h) in each hour of the week, from Monday 0:00 on
    weekly: Float[Array, " sensor"]  # standard deviation of whole weeks from the usual one
    sigma: Float[Array, "24 sensor"]  # of the residual beyond that, in each hour of the day
    phi: Float[Array, " sensor"]  # of this residual in units of its deviation, from hour to hour
    cholesky: Float[Array, "sensor sensor"]  # lower Cholesky factor of the innovations' correlations


def fit_sensors(table: CountTable, sensors: Sequence[str] | None = None) -> SensorModel:
    """Fit usual weeks and residuals to hourly counts; by default of all sensors of the table.

    Weeks begin on Monday; those counted for half or more have a level. Deviations are 0.74 times the distance of the
    quartiles, which holidays and broken sensors hardly change; for the same reason residuals count as
    ``WILDEST`` deviations at most. Memory is their lag-one autocorrelation; correlations
    are those of the innovations in hours that both sensors counted.

    Raises
    ------
    SeriesError
        A sensor with too few counts, or none in some hour of the week.
    CountsError
        An unknown sensor.
    """
    names = table.sensors if sensors is None else tuple(sensors)
    logs = np.log1p(np.stack([table.series(name) for name in names], axis=1))
    hours = hour_of_week(table.times)
    counted = np.isfinite(logs)
    for name, known in zip(names, counted.T, strict=True):
        if known.sum() < FEWEST_HOURS:
            raise SeriesError(
                f"{table.source}: sensor {name!r} has {known.sum()} counted hours; a usual week takes {FEWEST_HOURS}"
            )
        if len(np.unique(hours[known])) < HOURS_OF_WEEK:
            raise SeriesError(f"{table.source}: sensor {name!r} has no count in some hours of the week")
    usual = np.stack([np.nanmean(logs[hours == hour], axis=0) for hour in range(HOURS_OF_WEEK)])
    residual = logs - usual[hours]
    week = np.cumsum(hours == 0)
    of_week = np.stack([_mean(residual[week == number]) for number in range(week[-1] + 1)])
    weekly = _robust_deviation(of_week)
    residual -= np.where(np.isfinite(of_week), of_week, 0.0)[week]
    deviation = np.stack([_robust_deviation(residual[hours % 24 == hour]) for hour in range(24)])
    deviation = np.maximum(deviation, LEAST_DEVIATION)
    residual = np.clip(residual / deviation[hours % 24], -WILDEST, WILDEST)
    before, after = residual[:-1], residual[1:]
    paired = np.isfinite(before) & np.isfinite(after)
    products = np.where(paired, before * after, 0.0).sum(axis=0)
    memory = products / np.maximum(np.where(paired, before**2, 0.0).sum(axis=0), 1e-12)
    memory = np.clip(memory, 0.0, MOST_MEMORY)
    innovation = np.where(paired, after - memory * before, 0.0)
    squares = (innovation**2).T @ paired  # of each sensor over the hours that each other counted
    correlation = innovation.T @ innovation / np.sqrt(np.maximum(squares * squares.T, 1e-24))
    np.fill_diagonal(correlation, 1.0)
    return SensorModel(
        *(jnp.asarray(part, jnp.float32) for part in (usual, weekly, deviation, memory, cholesky_factor(correlation)))
    )


def _mean(hours: Float[np.ndarray, "hour sensor"]) -> Float[np.ndarray, " sensor"]:
    """Of the hours that were counted, if those are half a week or more."""
    counted = np.isfinite(hours)
    mean = np.where(counted, hours, 0.0).sum(axis=0) / np.maximum(counted.sum(axis=0), 1)
    return np.where(counted.sum(axis=0) >= HOURS_OF_WEEK // 2, mean, np.nan)


def _robust_deviation(values: Float[np.ndarray, "n sensor"]) -> Float[np.ndarray, " sensor"]:
    """Standard deviation of normal numbers with these quartiles; 0 where there are none."""
    found = []
    for column in values.T:
        known = column[np.isfinite(column)]
        found.append(np.diff(np.quantile(known, (0.25, 0.75)))[0] / _NORMAL_QUARTILES if len(known) > 1 else 0.0)
    return np.array(found)


def cholesky_factor(correlation: Float[np.ndarray, "sensor sensor"]) -> Float[np.ndarray, "sensor sensor"]:
    """Lower factor of the nearest matrix that has one: correlations over different hours need not fit together."""
    values, vectors = np.linalg.eigh(correlation)
    fitting = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    scale = 1 / np.sqrt(np.diag(fitting))
    return np.linalg.cholesky(fitting * scale * scale[:, None])


def recorded_weeks(
    model: SensorModel, table: CountTable, sensors: Sequence[str]
) -> Float[np.ndarray, "week 168 sensor"]:
    """How whole weeks that were counted differ from the usual one: log(1 + count) - usual.

    Hours without a count are as if the residual went on linearly between those around them.

    Raises
    ------
    SeriesError
        Less than two whole weeks, or a sensor that counted nothing in them.
    """
    hours = hour_of_week(table.times)
    logs = np.log1p(np.stack([table.series(name) for name in sensors], axis=1))
    residual = logs - np.asarray(model.expected)[hours]
    first = int(np.argmax(hours == 0))
    weeks = (len(hours) - first) // HOURS_OF_WEEK
    if weeks < 2:
        raise SeriesError(f"{table.source}: walks are tested on two whole weeks of counts or more, not on {weeks}")
    residual = residual[first : first + weeks * HOURS_OF_WEEK]
    number = np.arange(len(residual))
    for name, column in zip(sensors, residual.T, strict=True):
        known = np.isfinite(column)
        if not known.any():
            raise SeriesError(f"{table.source}: sensor {name!r} counted nothing in the weeks to test on")
        column[~known] = np.interp(number[~known], number[known], column[known])
    return residual.reshape(weeks, HOURS_OF_WEEK, -1).astype(np.float32)


class SensorFlow(FlowModel):
    """Crowds as sensors would count them.

    With ``current``, simulated crowds go on from current counts; sensors without one begin anywhere. With ``record``,
    weeks are not simulated: each future is one of the recorded ones. ``uneven`` is how much, beyond that, every
    future's demand differs from place to place: by a lognormal factor of mean 1 at each sensor, the standard deviation
    of whose logarithm it is.
    """

    model: SensorModel
    weights: InterpolationWeights
    per_count: Float[Array, " sensor"]  # persons/m² for each person an hour
    slot_seconds: float = eqx.field(static=True)
    record: Float[Array, "week 168 sensor"] | None = None
    uneven: float = eqx.field(static=True, default=0.0)
    current: CurrentCounts | None = None

    @property
    def timed(self) -> bool:
        return True

    def on_pieces(self, parent: Int[Array, " piece"], _fraction: Float[Array, " piece"]) -> "SensorFlow":
        return replace(self, weights=self.weights.of(parent))

    @property
    def _lasting(self) -> Float[Array, " sensor"]:
        """Variance of what differs from the usual for as long as anybody walks."""
        return self.model.weekly**2 + self.uneven**2

    def expected(self, hours: Float[Array, " hour"], slots: int) -> SensedField:
        """Mean densities, for each of the hours."""
        number = jnp.arange(slots)
        current = self.current

        def one(start: Float[Array, ""]) -> Float[Array, "slot sensor"]:
            usual, deviation = self._usual(start, number)
            since = self._since(start, number)
            variance = self._lasting + self._together(since, since) * deviation**2
            if current is None:
                return usual + variance / 2
            log_density_ratio, then = self._log_ratio(current, hours[0])
            covariance = self._lasting + self._together(jnp.zeros(1), since) * then * deviation
            counted = jnp.isfinite(current.residual)
            return usual + _given(
                log_density_ratio, self._lasting + then**2, jnp.where(counted, covariance, 0.0), variance
            )

        return self._field(jax.vmap(one)(hours))

    def draw(self, key: Key[Array, ""], hours: Float[Array, " future"], slots: int) -> SensedField:
        """Possible futures, or recorded ones."""
        knots_needed = math.ceil(slots * self.slot_seconds / HOUR) + 2
        for_lasting, for_hours = jax.random.split(key)
        lasting = jax.random.normal(for_lasting, (*hours.shape, *self.model.weekly.shape))
        if self.record is None:
            lasting, knots = self._simulated(for_hours, lasting * jnp.sqrt(self._lasting), hours, knots_needed)
        else:
            # How the whole week differs was recorded.
            lasting, knots = lasting * self.uneven, self._recorded(for_hours, hours, knots_needed)

        def one(
            start: Float[Array, ""], lasting: Float[Array, " sensor"], knots: Float[Array, "hour sensor"]
        ) -> Float[Array, "slot sensor"]:
            _, hour, part = self._hours(start, jnp.arange(slots))
            usual, deviation = self._usual(start, jnp.arange(slots))
            residual = (1 - part)[:, None] * knots[hour] + part[:, None] * knots[hour + 1]
            return usual + lasting + residual * (deviation if self.record is None else 1.0)

        return self._field(jax.vmap(one)(hours, lasting, knots))

    def ahead(
        self, now: Float[Array, " sensor"], hour: Float[Array, ""], slot: Int[Array, ""], slots: int
    ) -> Float[Array, "slots sensor"]:
        """Mean densities of this and the next slots, given those of this one; a part of the surprise fades."""
        after = slot + jnp.arange(slots)
        usual, deviation = self._usual(hour, after)
        since = self._since(hour, after)
        variance = self._lasting + self._together(since, since) * deviation**2
        log_density_ratio = jnp.log1p(now / self.per_count) - usual[0]
        covariance = self._lasting + self._together(since[:1], since) * deviation[0] * deviation
        return self._density(usual + _given(log_density_ratio, variance[0], covariance, variance))

    def _log_ratio(
        self, current: CurrentCounts, hour: Float[Array, ""]
    ) -> tuple[Float[Array, " sensor"], Float[Array, " sensor"]]:
        """How what is known differs from what was to be expected then, 0 where it is not, and the deviation then."""
        counted = jnp.round(hour - current.since - 0.5).astype(jnp.int32)
        residual = jnp.where(jnp.isfinite(current.residual), current.residual + self.uneven**2 / 2, 0.0)
        return residual, self.model.sigma[counted % len(self.model.sigma)]

    def _hours(
        self, start: Float[Array, ""], slot: Int[Array, " slots"]
    ) -> tuple[Int[Array, ""], Int[Array, " slots"], Float[Array, " slots"]]:
        """The hour whose middle comes before clock 0, and how many hours and parts of one later slots have theirs."""
        middle = start + (slot + 0.5) * (self.slot_seconds / HOUR) - 0.5
        first = jnp.floor(start - 0.5)
        hour = jnp.floor(middle - first)
        return first.astype(jnp.int32), hour.astype(jnp.int32), middle - first - hour

    def _usual(
        self, start: Float[Array, ""], slot: Int[Array, " slots"]
    ) -> tuple[Float[Array, "slots sensor"], Float[Array, "slots sensor"]]:
        """Usual logarithms of counts, and the deviations from them."""
        first, hour, part = self._hours(start, slot)

        def at(table: Float[Array, "hours sensor"]) -> Float[Array, "slots sensor"]:
            before, after = table[(first + hour) % len(table)], table[(first + hour + 1) % len(table)]
            return (1 - part)[:, None] * before + part[:, None] * after

        return at(self.model.expected) - self.uneven**2 / 2, at(self.model.sigma)

    def _since(self, start: Float[Array, ""], slot: Int[Array, " slots"]) -> Float[Array, " slots"]:
        """Hours of residuals: they are drawn at the whole ones, the middles of hours, and go straight in between.

        0 is the middle before clock 0, or that of the counted hour, before which residuals are as counted.
        """
        if self.current is None:
            _, hour, part = self._hours(start, slot)
            return hour + part
        return jnp.maximum(self.current.since + (slot + 0.5) * (self.slot_seconds / HOUR), 0.0)

    def _together(self, early: Float[Array, " #slots"], late: Float[Array, " slots"]) -> Float[Array, "slots sensor"]:
        """Covariance of residuals in units of their deviations, those of ``early`` with those of ``late``."""
        first, second = jnp.floor(early), jnp.floor(late)
        begun, passed, apart = ((early - first)[:, None], (late - second)[:, None], (second - first)[:, None])
        # Of the two whole hours around each, every one with every other: memory to the power of hours between.
        memory = self.model.phi
        same = (1 - begun) * (1 - passed) + begun * passed
        outer, inner = (1 - begun) * passed, begun * (1 - passed)
        return memory**apart * (same + outer * memory) + inner * memory ** jnp.abs(apart - 1)

    def _simulated(
        self, key: Key[Array, ""], lasting: Float[Array, "future sensor"], hours: Float[Array, " future"], knots: int
    ) -> tuple[Float[Array, "future sensor"], Float[Array, "future knot sensor"]]:
        """What lasts, and residuals in units of their standard deviations at ``knots`` middles of hours."""
        phi, current = self.model.phi, self.current
        steps = knots if current is None else knots + 1  # since the counts may be of the hour before the first one
        innovations = jax.random.normal(key, (steps, *lasting.shape)) @ self.model.cholesky.T
        fresh, first = jnp.sqrt(1 - phi**2), innovations[0]
        if current is not None:
            # Matheron's rule: what was drawn is corrected by as much of the miss as falls on each part.
            log_density_ratio, then = self._log_ratio(current, hours[0])
            miss = jnp.where(jnp.isfinite(current.residual), log_density_ratio - lasting - then * first, 0.0)
            variance = jnp.maximum(self._lasting + then**2, 1e-12)
            lasting, first = lasting + self._lasting / variance * miss, first + then / variance * miss

        def later(residual: Array, innovation: Array) -> tuple[Array, Array]:
            residual = phi * residual + fresh * innovation
            return residual, residual

        _, rest = jax.lax.scan(later, first, innovations[1:])
        chain = jnp.moveaxis(jnp.concatenate([first[None], rest]), 0, 1)
        if current is None:
            return lasting, chain
        # The chain begins at the hour that was counted. What comes before its middle is taken to be as counted.
        after = jnp.arange(knots) + jnp.floor(current.since).astype(jnp.int32)
        return lasting, chain[:, jnp.clip(after, 0, steps - 1)]

    def _recorded(
        self, key: Key[Array, ""], hours: Float[Array, " future"], knots: int
    ) -> Float[Array, "future knot sensor"]:
        """Residuals as they were counted."""
        if self.record is None:
            raise ValueError("nothing was recorded")
        weeks, _, sensors = self.record.shape
        whole = self.record.reshape(weeks * HOURS_OF_WEEK, sensors)
        week = jax.random.randint(key, hours.shape, 0, weeks)
        first = week * HOURS_OF_WEEK + jnp.floor(hours - 0.5).astype(jnp.int32)
        # The last hours of the record go on with its first ones, if anybody walks then.
        return whole[(first[:, None] + jnp.arange(knots)) % len(whole)]

    def _density(self, level: Float[Array, "*lead sensor"]) -> Float[Array, "*lead sensor"]:
        return jnp.maximum(jnp.expm1(level), 0.0) * self.per_count

    def _field(self, level: Float[Array, "future slot sensor"]) -> SensedField:
        return SensedField(self._density(level), self.weights, self.slot_seconds)


def _given(
    log_density_ratio: Float[Array, " sensor"],
    variance_then: Float[Array, " sensor"],
    covariance: Float[Array, "slot sensor"],
    variance: Float[Array, "slot sensor"],
) -> Float[Array, "slot sensor"]:
    """What a normal number that is known adds to the logarithm of the mean of later lognormal ones."""
    share = covariance / jnp.maximum(variance_then, 1e-12)
    return share * log_density_ratio + (variance - share * covariance) / 2
