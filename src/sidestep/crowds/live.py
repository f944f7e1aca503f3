"""Current counts, from which simulated crowds and forecasts go on."""

import equinox as eqx
from jaxtyping import Array, Float


class CurrentCounts(eqx.Module):
    """What the sensors counted in the last whole hour before a departure, or are counting in its hour."""

    residual: Float[Array, " sensor"]
    """log(1 + count) less its expected value in that hour; NaN where nothing was counted."""
    since: Float[Array, ""]
    """Hours from the middle of the counted hour to clock 0, from -1/2 to 3/2."""
