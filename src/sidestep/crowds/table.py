"""Crowds as a table has them: so many people on each segment at each time of the day, the week or the event."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.base import FlowField, FlowModel
from sidestep.crowds.rush import lasting_noise

HOUR, DAY, WEEK = 3600.0, 24 * 3600.0, 7 * 24 * 3600.0
FEWEST = 1e-6  # persons that count as nobody, where logarithms are taken


class TableFlow(FlowModel):
    """Volume = the table's · exp(noise), its noise as that of :class:`sidestep.crowds.rush.RushFlow`.

    A row of the table holds for ``row_seconds``; a slot takes the row of its middle. Where the table knows its time, a
    table of whole days repeats after its end; elsewhere clock 0 is its beginning. Before its first row the first one
    holds, after its last one the last.
    """

    volume: Float[Array, "row segment"]  # persons, the median where there is noise
    row_seconds: float = eqx.field(static=True)
    phi: float = eqx.field(static=True)  # of the noise, from slot to slot
    sigma: float = eqx.field(static=True)  # of the logarithm; 0: crowds come exactly as in the table
    slot_seconds: float = eqx.field(static=True)
    begins: float | None = eqx.field(static=True, default=None)  # hour of the week of the first row, 0 is Monday 0:00

    @property
    def timed(self) -> bool:
        return self.begins is not None

    @property
    def span(self) -> float:
        """Seconds from the beginning of the first row to the end of the last."""
        return self.volume.shape[0] * self.row_seconds

    @property
    def repeats(self) -> bool:
        """Whether it is of whole days."""
        return self.begins is not None and self.span % DAY == 0

    def covers(self, hour: float) -> bool:
        """Whether it says anything about an hour of the week."""
        return self.begins is None or self.repeats or HOUR * (hour - self.begins) % WEEK < self.span

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
        """Mean volumes of this and the next slots, given those of this one.

        Where nobody is expected now, the counts tell nothing about the noise; people who are there all the same stay
        for this slot.
        """
        median = self._median(hour, slot + jnp.arange(slots))
        known = median[0] > FEWEST
        log_density_ratio = jnp.log(jnp.maximum(now, FEWEST)) - jnp.log(jnp.maximum(median[0], FEWEST))
        fading = jnp.where(known, self.phi ** jnp.arange(slots, dtype=float)[:, None], 0.0)
        spread = self.sigma**2 * (1 - fading**2) / 2
        return (median * jnp.exp(fading * log_density_ratio + spread)).at[0].set(now)

    def on_pieces(self, parent: Int[Array, " piece"], fraction: Float[Array, " piece"]) -> "TableFlow":
        """Of the persons on a segment, each piece has as large a share as of its length."""
        return replace(self, volume=self.volume[:, parent] * fraction)

    def _medians(self, hours: Float[Array, " hour"], slots: int) -> Float[Array, "hour slots segment"]:
        return jax.vmap(self._median, (0, None))(hours, jnp.arange(slots))

    def _median(self, hour: Float[Array, ""], slot: Int[Array, " slots"]) -> Float[Array, "slots segment"]:
        since = (slot + 0.5) * self.slot_seconds
        if self.begins is not None:
            # What lies outside of the table is split between what comes before it and what comes after.
            before = 0.0 if self.repeats else max(WEEK - self.span, 0.0) / 2
            since = since + (HOUR * (hour - self.begins) + before) % WEEK - before
        if self.repeats:
            since = since % self.span
        row = jnp.floor(since / self.row_seconds).astype(jnp.int32)
        return self.volume[jnp.clip(row, 0, self.volume.shape[0] - 1)]
