"""Crowds from a table of all segments: volumes at each time of the day, the week or the event."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.crowds.base import Counts, Index, Scalar, Slots
from sidestep.crowds.noisy_flow import NoisyFlow
from sidestep.crowds.profile import day_and_time

HOUR, DAY, WEEK = 3600.0, 24 * 3600.0, 7 * 24 * 3600.0


class TableFlow(NoisyFlow):
    """The median volume is the table's.

    A slot takes the row that holds at its middle. A table of whole days that has times repeats after its end. Before
    the first row of other tables the first one holds, after the last one the last. Without times, clock 0 is the
    beginning of the table.
    """

    volume: Float[Array, "row segment"]
    """Persons on every segment; the median where there is noise."""
    row_seconds: float = eqx.field(static=True)
    """How long a row holds."""
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

    def ahead(self, now: Counts, hour: Scalar, slot: Index, slots: int) -> Float[Array, "slots counter"]:
        """Mean volumes from this slot on; counts hold for this slot, even where nobody was expected."""
        return super().ahead(now, hour, slot, slots).at[0].set(now)

    def on_pieces(self, parent: Int[Array, " piece"], fraction: Float[Array, " piece"]) -> "TableFlow":
        # Of the persons on a segment, each piece has as large a share as of the length.
        return replace(self, volume=self.volume[:, parent] * fraction)

    def median(self, hour: Scalar, slot: Slots) -> Float[Array, "slots segment"]:
        since = (slot + 0.5) * self.slot_seconds
        if self.begins is not None:
            # Half of the week outside the table comes before it, the other half after it.
            before = 0.0 if self.repeats else max(WEEK - self.span, 0.0) / 2
            since = since + (HOUR * (hour - self.begins) + before) % WEEK - before
        if self.repeats:
            since = since % self.span
        row = jnp.floor(since / self.row_seconds).astype(jnp.int32)
        return self.volume[jnp.clip(row, 0, self.volume.shape[0] - 1)]
