"""Crowds as a table has them: so many people on each segment at each time of the day, the week or the event."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from sidestep.crowds.base import FlowField
from sidestep.crowds.rush import lasting_noise

HOUR, DAY, WEEK = 3600.0, 24 * 3600.0, 7 * 24 * 3600.0
FEWEST = 1e-6  # persons that count as nobody, where logarithms are taken


class TableFlow(eqx.Module):
    """Volume = the table's · exp(noise), its noise as that of :class:`sidestep.crowds.rush.RushFlow`.

    A row of the table holds for ``row_seconds``; a slot takes the row of its middle. Where the table knows its time,
    crowd number c begins at hour ``start[c modulo its length]`` of the week, and a table of whole days repeats after
    its end; elsewhere clock 0 is its beginning. Before its first row the first one holds, after its last one the last.
    """

    usual: Float[Array, "row segment"]  # persons, the median where there is noise
    row_seconds: float = eqx.field(static=True)
    memory: float = eqx.field(static=True)  # of the noise, from slot to slot
    deviation: float = eqx.field(static=True)  # of the logarithm; 0: crowds come exactly as in the table
    slot_seconds: float = eqx.field(static=True)
    begins: float | None = eqx.field(static=True, default=None)  # hour of the week of the first row, 0 is Monday 0:00
    start: Float[Array, " world"] | None = None  # hour of the week at clock 0; given where `begins` is

    @property
    def span(self) -> float:
        """Seconds from the beginning of the first row to the end of the last."""
        return self.usual.shape[0] * self.row_seconds

    @property
    def repeats(self) -> bool:
        """Whether it is of whole days."""
        return self.begins is not None and self.span % DAY == 0

    def covers(self, hour: float) -> bool:
        """Whether it says anything about an hour of the week."""
        return self.begins is None or self.repeats or HOUR * (hour - self.begins) % WEEK < self.span

    def expected(self, slots: int) -> FlowField:
        """Mean volumes, for each of the starts."""
        number = jnp.arange(slots)
        volume = (
            self._usual(None, number) if self.start is None else jax.vmap(self._usual, (0, None))(self.start, number)
        )
        return FlowField(volume * jnp.exp(self.deviation**2 / 2), self.slot_seconds)

    def draw(self, key: Key[Array, ""], futures: int, slots: int) -> FlowField:
        """Possible futures; without noise they differ only by when they begin."""
        number = jnp.arange(slots)
        shape = (futures, slots, self.usual.shape[1])
        if self.start is None:
            volume = jnp.broadcast_to(self._usual(None, number), shape)
        else:
            starts = self.start[jnp.arange(futures) % self.start.shape[0]]
            volume = jax.vmap(self._usual, (0, None))(starts, number)
        if self.deviation:
            volume = volume * jnp.exp(lasting_noise(key, shape, self.memory, self.deviation))
        return FlowField(volume, self.slot_seconds)

    def ahead(
        self, now: Float[Array, " segment"], slot: Int[Array, ""], slots: int, future: Int[Array, ""] | int = 0
    ) -> Float[Array, "slots segment"]:
        """Mean volumes of this and the next slots, given those of this one.

        Where nobody is usual now, the counts tell nothing about the noise; whoever is there all the same stays for
        this slot.
        """
        start = None if self.start is None else self.start[future % self.start.shape[0]]
        usual = self._usual(start, slot + jnp.arange(slots))
        known = usual[0] > FEWEST
        log_density_ratio = jnp.log(jnp.maximum(now, FEWEST)) - jnp.log(jnp.maximum(usual[0], FEWEST))
        fading = jnp.where(known, self.memory ** jnp.arange(slots, dtype=float)[:, None], 0.0)
        spread = self.deviation**2 * (1 - fading**2) / 2
        return (usual * jnp.exp(fading * log_density_ratio + spread)).at[0].set(now)

    def _usual(self, start: Float[Array, ""] | None, slot: Int[Array, " slots"]) -> Float[Array, "slots segment"]:
        since = (slot + 0.5) * self.slot_seconds
        if start is not None and self.begins is not None:
            # What lies outside of the table is split between what comes before it and what comes after.
            before = 0.0 if self.repeats else max(WEEK - self.span, 0.0) / 2
            since = since + (HOUR * (start - self.begins) + before) % WEEK - before
        if self.repeats:
            since = since % self.span
        row = jnp.floor(since / self.row_seconds).astype(jnp.int32)
        return self.usual[jnp.clip(row, 0, self.usual.shape[0] - 1)]
