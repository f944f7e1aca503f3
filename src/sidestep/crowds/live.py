"""Current counts, from which forecasts and simulated crowds go on."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.counts import CountsError, CountTable, unknown_sensor


class CurrentCounts(eqx.Module):
    """How the counts of one hour, just before or around a departure, differ from the expected ones."""

    residual: Float[Array, " sensor"]
    """log(1 + count) less its expected value in that hour; NaN where nothing was counted."""
    since: Float[Array, ""]
    """Hours from the middle of the counted hour to clock 0, from -1/2 to 3/2."""


@dataclass(frozen=True, eq=False)
class LatestCounts:
    """What sensors counted in the hour of a departure, or in the hour before."""

    counts: Float[np.ndarray, " sensor"]
    """Persons/h; NaN where nothing was counted."""
    hour: np.datetime64
    """Local wall time at which the counted hour starts."""
    since: float
    """Hours from the middle of the counted hour to the departure, from -1/2 to 3/2."""

    @property
    def known(self) -> int:
        """Number of sensors with a count."""
        return int(np.isfinite(self.counts).sum())


def latest_counts(table: CountTable, sensors: Sequence[str], departure: datetime) -> LatestCounts:
    """The counts of the last hour of a table, for sensors in this order; those that the table lacks are missing.

    Parameters
    ----------
    table
        Counts up to now.
    sensors
        Names of the sensors that crowds are known from.
    departure
        Local wall time.

    Returns
    -------
    latest
        NaN for sensors without a count.

    Raises
    ------
    CountsError
        A sensor in the table that is not among ``sensors``; a last hour that is neither that of the departure nor the
        one before; a last hour without a count.
    """
    for name in table.sensors:
        if name not in sensors:
            raise unknown_sensor(table.source, name, sensors)
    hour, leaves = table.times[-1], np.datetime64(departure, "h")
    if hour not in (leaves, leaves - 1):
        raise CountsError(
            f"{table.source}: the last counts are of the hour from {hour}:00, but the departure is "
            f"{departure.isoformat(timespec='minutes')}; give counts of the hour of the departure or the one before",
            field="time",
        )
    counts = np.array([table.series(name)[-1] if name in table.sensors else np.nan for name in sensors])
    since = (np.datetime64(departure, "s") - hour.astype("datetime64[s]")).astype(float) / 3600 - 0.5
    latest = LatestCounts(counts, hour, float(since))
    if not latest.known:
        raise CountsError(f"{table.source}: nothing was counted in the last hour, from {hour}:00", field="time")
    return latest
