"""Crowds of a real place: what its sensors usually count, how today differs, and how both spread along the streets.

Each sensor has a usual level for every hour of the week and an AR(1) of how the logarithm of its count differs from it
(:mod:`sidestep.flow.profile`); the sensors' innovations go together as they were counted to. Counts are hourly: in
between, logarithms are linear from one middle of an hour to the next.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from sidestep.flow.arima import SeriesError
from sidestep.flow.counts import CountTable
from sidestep.flow.field import SensedField
from sidestep.flow.profile import HOURS_OF_WEEK, hour_of_week
from sidestep.network.spread import Spread

HOUR = 3600.0
MOST_MEMORY = 0.99  # of the residuals from hour to hour; one that never fades has no stationary deviation
FEWEST_HOURS = 4 * HOURS_OF_WEEK  # counted hours to fit to


class SensorModel(eqx.Module):
    """What sensors usually count, and how that varies."""

    usual: Float[Array, "168 sensor"]  # mean of log(1 + persons/h) in each hour of the week, from Monday 0:00 on
    memory: Float[Array, " sensor"]  # of the residual, from hour to hour
    deviation: Float[Array, " sensor"]  # standard deviation of the residual
    together: Float[Array, "sensor sensor"]  # lower Cholesky factor of the innovations' correlations


def fit_sensors(table: CountTable, sensors: Sequence[str] | None = None) -> SensorModel:
    """Fit usual weeks and residuals to hourly counts; by default of all sensors of the table.

    Memory is the lag-one autocorrelation of the residuals; correlations are those of the innovations in hours that both
    sensors counted.

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
    deviation = np.nanstd(residual, axis=0)
    before, after = residual[:-1], residual[1:]
    paired = np.isfinite(before) & np.isfinite(after)
    products = np.where(paired, before * after, 0.0).sum(axis=0)
    memory = products / np.maximum(np.where(paired, before**2, 0.0).sum(axis=0), 1e-12)
    memory = np.clip(memory, 0.0, MOST_MEMORY)
    innovation = np.where(paired, after - memory * before, 0.0)
    squares = (innovation**2).T @ paired  # of each sensor over the hours that each other counted
    correlation = innovation.T @ innovation / np.sqrt(np.maximum(squares * squares.T, 1e-24))
    np.fill_diagonal(correlation, 1.0)
    return SensorModel(*(jnp.asarray(part, jnp.float32) for part in (usual, memory, deviation, _cholesky(correlation))))


def _cholesky(correlation: Float[np.ndarray, "sensor sensor"]) -> Float[np.ndarray, "sensor sensor"]:
    """Of the nearest matrix that has one: correlations over different hours need not fit together."""
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
    residual = logs - np.asarray(model.usual)[hours]
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


class Known(eqx.Module):
    """What the sensors counted last before people set out, or are counting as they do."""

    residual: Float[Array, " sensor"]  # log(1 + count) less the usual level of that hour; NaN where nothing was counted
    since: Float[Array, ""]  # h from the middle of that hour to clock 0, from -1/2 to 3/2


class SensorFlow(eqx.Module):
    """Crowds as sensors would count them.

    Crowd number c begins at hour ``start[c modulo its length]`` of the week. With ``known``, simulated crowds go on
    from what was counted; sensors that are not known begin anywhere. With ``record``, crowds are not simulated: each is
    one of the recorded weeks.
    """

    model: SensorModel
    spread: Spread
    per_count: Float[Array, " sensor"]  # persons/m² for each person an hour
    start: Float[Array, " world"]  # hour of the week at clock 0, 0 is Monday 0:00
    slot_seconds: float = eqx.field(static=True)
    record: Float[Array, "week 168 sensor"] | None = None
    known: Known | None = None

    def expected(self, slots: int) -> SensedField:
        """Mean densities, for each of the starts."""
        level = jax.vmap(lambda start: self._usual(start, jnp.arange(slots)))(self.start)
        if self.known is None:
            return self._field(level + self.model.deviation**2 / 2)
        hours = jnp.maximum(self.known.since + (jnp.arange(slots) + 0.5) * (self.slot_seconds / HOUR), 0.0)[:, None]
        whole = jnp.floor(hours)
        # Straight from hour to hour, as futures are.
        left = self.model.memory**whole * (1 - (hours - whole) * (1 - self.model.memory))
        counted = jnp.isfinite(self.known.residual)
        residual = jnp.where(counted, self.known.residual, 0.0)
        return self._field(level + self._fading_residual(residual, jnp.where(counted, left, 0.0)))

    def draw(self, key: Key[Array, ""], crowds: int, slots: int) -> SensedField:
        """Possible futures, or recorded ones."""
        starts = self.start[jnp.arange(crowds) % self.start.shape[0]]
        hours = math.ceil(slots * self.slot_seconds / HOUR) + 2
        knots = self._simulated(key, crowds, hours) if self.record is None else self._recorded(key, starts, hours)

        def one(start: Float[Array, ""], knots: Float[Array, "hour sensor"]) -> Float[Array, "slot sensor"]:
            _, hour, part = self._hours(start, jnp.arange(slots))
            return self._usual(start, jnp.arange(slots)) + _between(knots, hour, part)

        return self._field(jax.vmap(one)(starts, knots))

    def ahead(
        self, now: Float[Array, " sensor"], slot: Int[Array, ""], slots: int, crowd: Int[Array, ""] | int = 0
    ) -> Float[Array, "slots sensor"]:
        """Mean densities of this and the next slots, given those of this one: the AR(1) fades to the usual."""
        usual = self._usual(self.start[crowd % self.start.shape[0]], slot + jnp.arange(slots))
        surprise = jnp.log1p(now / self.per_count) - usual[0]
        fading = self.model.memory ** (jnp.arange(slots)[:, None] * (self.slot_seconds / HOUR))
        return self._density(usual + self._fading_residual(surprise, fading))

    def _fading_residual(
        self, residual: Float[Array, " sensor"], fading: Float[Array, "slots sensor"]
    ) -> Float[Array, "slots sensor"]:
        """What the residual adds to the logarithm of the mean, when so much of it is left."""
        return fading * residual + self.model.deviation**2 * (1 - fading**2) / 2

    def _hours(
        self, start: Float[Array, ""], slot: Int[Array, " slots"]
    ) -> tuple[Int[Array, ""], Int[Array, " slots"], Float[Array, " slots"]]:
        """The hour whose middle comes before clock 0, and how many hours and parts of one later slots have theirs."""
        middle = start + (slot + 0.5) * (self.slot_seconds / HOUR) - 0.5
        first = jnp.floor(start - 0.5)
        hour = jnp.floor(middle - first)
        return first.astype(jnp.int32), hour.astype(jnp.int32), middle - first - hour

    def _usual(self, start: Float[Array, ""], slot: Int[Array, " slots"]) -> Float[Array, "slots sensor"]:
        first, hour, part = self._hours(start, slot)
        weeks = self.model.usual
        return (1 - part)[:, None] * weeks[(first + hour) % HOURS_OF_WEEK] + part[:, None] * weeks[
            (first + hour + 1) % HOURS_OF_WEEK
        ]

    def _simulated(self, key: Key[Array, ""], crowds: int, hours: int) -> Float[Array, "crowd hour sensor"]:
        memory = self.model.memory
        steps = hours if self.known is None else hours + 1  # since the counts may be of the hour before the first one
        independent = jax.random.normal(key, (steps, crowds, memory.shape[0]))
        innovations = independent @ self.model.together.T * self.model.deviation
        fresh = jnp.sqrt(1 - memory**2)
        first = innovations[0]
        if self.known is not None:
            first = jnp.where(jnp.isfinite(self.known.residual), self.known.residual, first)

        def later(residual: Array, innovation: Array) -> tuple[Array, Array]:
            residual = memory * residual + fresh * innovation
            return residual, residual

        _, rest = jax.lax.scan(later, first, innovations[1:])
        chain = jnp.moveaxis(jnp.concatenate([first[None], rest]), 0, 1)
        if self.known is None:
            return chain
        # The chain begins at the hour that was counted. What comes before its middle is taken to be as counted.
        after = jnp.arange(hours) + jnp.floor(self.known.since).astype(jnp.int32)
        return chain[:, jnp.clip(after, 0, steps - 1)]

    def _recorded(
        self, key: Key[Array, ""], starts: Float[Array, " crowd"], hours: int
    ) -> Float[Array, "crowd hour sensor"]:
        if self.record is None:
            raise ValueError("nothing was recorded")
        weeks, _, sensors = self.record.shape
        whole = self.record.reshape(weeks * HOURS_OF_WEEK, sensors)
        week = jax.random.randint(key, starts.shape, 0, weeks)
        first = week * HOURS_OF_WEEK + jnp.floor(starts - 0.5).astype(jnp.int32)
        # The last hours of the record go on with its first ones, if anybody walks then.
        return whole[(first[:, None] + jnp.arange(hours)) % len(whole)]

    def _density(self, level: Float[Array, "*lead sensor"]) -> Float[Array, "*lead sensor"]:
        return jnp.maximum(jnp.expm1(level), 0.0) * self.per_count

    def _field(self, level: Float[Array, "crowd slot sensor"]) -> SensedField:
        return SensedField(self._density(level), self.spread, self.slot_seconds)


def _between(
    knots: Float[Array, "hour sensor"], hour: Int[Array, " slot"], part: Float[Array, " slot"]
) -> Float[Array, "slot sensor"]:
    return (1 - part)[:, None] * knots[hour] + part[:, None] * knots[hour + 1]
