"""Current counts, from which simulated crowds and forecasts go on."""

import difflib
import reprlib
from collections.abc import Sequence
from datetime import datetime

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from sidestep.crowds.counts import CountsError, CountTable
from sidestep.crowds.profile import hour_of_week

HOUR = 3600.0


class CurrentCounts(eqx.Module):
    """What the sensors counted in the last whole hour before a departure, or are counting in its hour."""

    residual: Float[Array, " sensor"]
    """log(1 + count) less its expected value in that hour; NaN where nothing was counted."""
    since: Float[Array, ""]
    """Hours from the middle of the counted hour to clock 0, from -1/2 to 3/2."""


def current_counts(
    table: CountTable,
    sensors: Sequence[str],
    expected: Float[Array, "168 sensor"],
    departure: datetime,
) -> CurrentCounts:
    """What the last hour of a table says about the crowds at a departure.

    Parameters
    ----------
    table
        Counts as the sensors count them; sensors that are missing in its last hour are not known.
    sensors
        The sensor behind each counter of a flow model; one may stand there several times.
    expected
        Mean of log(1 + count) at each of them by hour of the week.
    departure
        Local wall time of clock 0.

    Raises
    ------
    CountsError
        Sensors that are not among these, counts of another hour than that of the departure or the one before it, no
        count at all.
    """
    names = list(dict.fromkeys(sensors))
    for name in table.sensors:
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(map(repr, names))}"
            raise CountsError(f"{table.source}: no sensor {reprlib.repr(name)} in this place; {hint}")
    counted, leaves = table.times[-1], np.datetime64(departure, "h")
    if counted not in (leaves, leaves - 1):
        raise CountsError(
            f"{table.source}: the last counts are of the hour from {counted}:00, but the departure is "
            f"{departure.isoformat(timespec='minutes')}; they must be of the hour of the departure or the one before"
        )
    last = {name: table.series(name)[-1] for name in table.sensors}
    if not np.isfinite(list(last.values())).any():
        raise CountsError(f"{table.source}: nothing was counted in the last hour, from {counted}:00")
    logs = np.log1p(np.array([last.get(name, np.nan) for name in sensors]))
    residual = logs - np.asarray(expected)[hour_of_week(table.times[-1:])[0]]
    since = (np.datetime64(departure, "s") - counted.astype("datetime64[s]")).astype(float) / HOUR - 0.5
    return CurrentCounts(jnp.asarray(residual, jnp.float32), jnp.asarray(since, jnp.float32))
