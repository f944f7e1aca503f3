"""Crowds from a table of all segments: volumes at each time of the day, the week or the event."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.base import FlowField, FlowModel
from sidestep.crowds.profile import day_and_time
from sidestep.crowds.rush import lasting_noise

HOUR, DAY, WEEK = 3600.0, 24 * 3600.0, 7 * 24 * 3600.0
FEWEST = 1e-6  # persons; fewer count as nobody where logarithms are taken


class TableFlow(FlowModel):
    """Volume = the table's · exp(noise), with the noise of :class:`sidestep.crowds.rush.RushFlow`.

    A slot takes the row that holds at its middle. A table of whole days that has times repeats after its end. Before
    the first row of other tables the first one holds, after the last one the last. Without times, clock 0 is the
    beginning of the table.
    """

    volume: Float[Array, "row segment"]
    """Persons on every segment; the median where there is noise."""
    row_seconds: float = eqx.field(static=True)
    """How long a row holds."""
    phi: float = eqx.field(static=True)
    """Coefficient of the noise from slot to slot, 0 to below 1."""
    sigma: float = eqx.field(static=True)
    """Standard deviation of the noise in every slot; at 0, crowds come exactly as in the table."""
    slot_seconds: float = eqx.field(static=True)
    """Length of a slot."""
    begins: float | None = eqx.field(static=True, default=None)
    """Hour of the week at which the first row begins, 0 is Monday 0:00; None where the table has no times."""

    @property
    def timed(self) -> bool:
        return self.begins is not None

    @property
    def span(self) -> float:
        """Seconds from the beginning of the first row to the end of the last."""
        return self.volume.shape[0] * self.row_seconds

    @property
    def repeats(self) -> bool:
        """Whether the table is of whole days, which repeat."""
        return self.begins is not None and self.span % DAY == 0

    def covers(self, hour: float) -> bool:
        return self.begins is None or self.repeats or HOUR * (hour - self.begins) % WEEK < self.span

    @property
    def coverage(self) -> str:
        if self.begins is None or self.repeats:
            return super().coverage
        return f"{self.span / HOUR:g} hours from {day_and_time(self.begins)} on"

    def expected(self, hours: Float[Array, " hour"], slots: int) -> FlowField:
        """Mean volumes, for each of the hours."""
        volume = self._medians(hours if self.timed else hours[:1], slots)
        return FlowField(volume * jnp.exp(self.sigma**2 / 2), self.slot_seconds)

    def draw(self, key: Key[Array, ""], hours: Float[Array, " future"], slots: int) -> FlowField:
        """Possible futures; without noise they differ only by when they begin."""
        volume = self._medians(hours, slots)
        if self.sigma:
            volume = volume * jnp.exp(
                lasting_noise(key, (hours.shape[0], slots, self.volume.shape[1]), self.phi, self.sigma)
            )
        return FlowField(volume, self.slot_seconds)

    def ahead(
        self, now: Float[Array, " segment"], hour: Float[Array, ""], slot: Int[Array, ""], slots: int
    ) -> Float[Array, "slots segment"]:
        """Mean volumes in this and the next slots, given those in this one.

        Where nobody is expected now, the counts tell nothing about the noise; people who are there all the same stay
        for this slot.
        """
        median = self._median(hour, slot + jnp.arange(slots))
        known = median[0] > FEWEST
        log_density_ratio = jnp.log(jnp.maximum(now, FEWEST)) - jnp.log(jnp.maximum(median[0], FEWEST))
        fading = jnp.where(known, self.phi ** jnp.arange(slots, dtype=float)[:, None], 0.0)
        half_variance = self.sigma**2 * (1 - fading**2) / 2
        return (median * jnp.exp(fading * log_density_ratio + half_variance)).at[0].set(now)

    def on_pieces(self, parent: Int[Array, " piece"], fraction: Float[Array, " piece"]) -> "TableFlow":
        # Of the persons on a segment, each piece has as large a share as of the length.
        return replace(self, volume=self.volume[:, parent] * fraction)

    def _medians(self, hours: Float[Array, " hour"], slots: int) -> Float[Array, "hour slots segment"]:
        return jax.vmap(self._median, (0, None))(hours, jnp.arange(slots))

    def _median(self, hour: Float[Array, ""], slot: Int[Array, " slots"]) -> Float[Array, "slots segment"]:
        since = (slot + 0.5) * self.slot_seconds
        if self.begins is not None:
            # Half of the week outside the table comes before it, the other half after it.
            before = 0.0 if self.repeats else max(WEEK - self.span, 0.0) / 2
            since = since + (HOUR * (hour - self.begins) + before) % WEEK - before
        if self.repeats:
            since = since % self.span
        row = jnp.floor(since / self.row_seconds).astype(jnp.int32)
        return self.volume[jnp.clip(row, 0, self.volume.shape[0] - 1)]
