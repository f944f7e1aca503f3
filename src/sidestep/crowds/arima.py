"""The paper's model of pedestrian flow: ARIMA(p, d, q), eqs. arima_1 to arima_5, on one street and on a network.

Fitted by statsmodels (imported late, and only here), simulated and forecast in JAX by one recursion. The functions of
the JAX half are pure and may be jitted and vmapped, over the coefficients of the model too.
"""

import json
import math
import warnings
from functools import partial
from importlib.resources import files

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Key

from sidestep.crowds.base import Counts, FlowField, FlowModel, Hours, Index, Scalar
from sidestep.crowds.normals import standard_normal
from sidestep.errors import SidestepError
from sidestep.programs import on_device

_SHORTEST = 30  # observations; fewer cannot tell even an AR(1) from noise
_MOST_DIFFERENCES = 2
_KPSS_LEVEL = 0.05

History = Float[Array, "lag *batch"]
Path = Float[Array, "slot *batch"]
Value = Float[Array, " *batch"]


class SeriesError(SidestepError):
    """A series that a model does not fit, or a request that a model does not serve."""


class Arima(eqx.Module):
    """(1 - sum ar_k B^k) ((1 - B)^d y - mean) = (1 - sum ma_k B^k) e, with e ~ N(0, sigma^2).

    `ar` and `ma` have the paper's signs (lambda and mu of eqs. arima_4 and arima_5); statsmodels' MA has the opposite.
    """

    ar: Float[Array, " p"]
    """Autoregressive coefficients."""
    ma: Float[Array, " q"]
    """Moving-average coefficients."""
    mean: Float[Array, ""]
    """Mean of the d times differenced series in persons; 0 if d > 0."""
    sigma: Float[Array, ""]
    """Standard deviation of the innovations, persons."""
    d: int = eqx.field(static=True, default=0)
    """How many times the series is differenced."""
    step: float = eqx.field(static=True, default=3600.0)
    """Seconds from one value to the next."""

    @property
    def order(self) -> tuple[int, int, int]:
        """The numbers p, d and q."""
        return self.ar.shape[0], self.d, self.ma.shape[0]


# --- Simulating and forecasting -------------------------------------------------------------------------------------

# The p + d last values and the q last innovations, newest first.
_State = tuple[Float[Array, "order *batch"], Float[Array, "q *batch"]]


def _coefficients(model: Arima) -> Float[Array, " order"]:
    """Make differencing a recursion on the levels: (1 - sum ar_k B^k)(1 - B)^d = 1 - sum phi_k B^k."""
    polynomial = jnp.concatenate([jnp.ones(1), -model.ar])
    for _ in range(model.d):
        polynomial = jnp.convolve(polynomial, jnp.array([1.0, -1.0]))
    return -polynomial[1:]


def _expected(model: Arima, state: _State) -> Value:
    """Conditional mean of the next value."""
    values, shocks = state
    mean = jnp.broadcast_to(model.mean * (1 - model.ar.sum()), values.shape[1:])
    # Sums over the few lags, written out, fuse into one loop over the segments; a matrix product would not.
    for coefficient, value in zip((*_coefficients(model), *-model.ma), (*values, *shocks), strict=True):
        mean = mean + coefficient * value
    return mean


def _push(rows: Float[Array, "rows *batch"], newest: Value) -> Float[Array, "rows *batch"]:
    # A state keeps its type, whatever mixture of precisions goes in.
    return jnp.concatenate([newest[None].astype(rows.dtype), rows])[: rows.shape[0]]


def _observe(model: Arima, state: _State, observed: Value) -> tuple[_State, Value]:
    """Take in one value and return the expected one, which also stands in for a missing value (NaN)."""
    values, shocks = state
    expected = _expected(model, state)
    value = jnp.where(jnp.isnan(observed), expected, observed)
    return (_push(values, value), _push(shocks, value - expected)), expected


def _start(model: Arima, history: History) -> _State:
    """The state before the second row of a history, as if its oldest value had always been there."""
    first = jnp.argmax(~jnp.isnan(history), axis=0, keepdims=True)
    oldest = jnp.take_along_axis(history, first, axis=0)[0]
    oldest = jnp.where(jnp.isnan(oldest), model.mean, oldest)  # nothing observed at all
    dtype = jnp.result_type(float, oldest)
    values = jnp.broadcast_to(oldest.astype(dtype), (model.ar.shape[0] + model.d, *oldest.shape))
    return values, jnp.zeros((model.ma.shape[0], *oldest.shape), dtype)


def latent(model: Arima, history: History, innovations: Path) -> Path:
    """Like `simulate`, but values may be negative."""
    state, _ = jax.lax.scan(partial(_observe, model), _start(model, history), history[1:])

    def advance(state: _State, innovation: Value) -> tuple[_State, Value]:
        values, shocks = state
        shock = model.sigma * innovation
        value = _expected(model, state) + shock
        return (_push(values, value), _push(shocks, shock)), value

    _, path = jax.lax.scan(advance, state, innovations)
    return path


def simulate(model: Arima, history: History, innovations: Path) -> Path:
    """Continue a series with simulated volumes, which are never negative.

    Only the returned numbers are cut at zero. Cutting the recursion behind them too would push the mean up and change
    the correlation from slot to slot: it would not be the fitted model any more.

    Parameters
    ----------
    model
        The model; its step is the slot.
    history
        Volumes so far in persons, oldest first; NaN where missing. An ARIMA(p, d, 0) needs p + d rows; before a shorter
        history the oldest value is repeated. With q > 0 a longer history tells more about the past innovations, which
        are recovered from it (they count as zero before it).
    innovations
        Standard normal numbers, one for each slot.

    Returns
    -------
    volumes
        One row for each row of `innovations`, the first one step after the last of the history.
    """
    return jnp.maximum(latent(model, history, innovations), 0.0)


def forecast(model: Arima, history: History, slots: int) -> Float[Array, "slots *batch"]:
    """Forecast the next `slots` steps: `simulate` without innovations."""
    return simulate(model, history, jnp.zeros((slots, *history.shape[1:])))


def one_step(model: Arima, series: Float[Array, "hour *batch"]) -> Float[Array, "hour *batch"]:
    """Forecast each value from all values before it; NaN until a value has been observed."""
    return jnp.maximum(latent_one_step(model, series), 0.0)


def latent_one_step(model: Arima, series: Float[Array, "hour *batch"]) -> Float[Array, "hour *batch"]:
    """Like `one_step`, but forecasts may be negative."""
    _, expected = jax.lax.scan(partial(_observe, model), _start(model, series), series[1:])
    seen = jnp.cumsum(~jnp.isnan(series[:-1]), axis=0) > 0
    nothing = jnp.full((1, *series.shape[1:]), jnp.nan)
    return jnp.concatenate([nothing, jnp.where(seen, expected, jnp.nan)])


def change_step(model: Arima, step: float) -> Arima:
    """The same process sampled every `step` seconds; exact for an AR(1).

    With r = step / model.step, phi becomes phi^r and the innovation variance sigma^2 (1 - phi^2r) / (1 - phi^2). The
    values keep their unit: a rate in persons/h sampled more often is still in persons/h.

    Returns
    -------
    model
        An AR(1) whose step is ``step`` seconds.

    Raises
    ------
    SeriesError
        A model that is no AR(1) with 0 < phi < 1, or a step that is not positive.
    """
    if not 0 < step < math.inf:
        raise SeriesError(f"the step must be a positive number of seconds, not {step}", field="step")
    if model.order != (1, 0, 0):
        same = "only an ARIMA(1, 0, 0) has the same form at another step"
        raise SeriesError(f"{same}; this one is {model.order}", field="order")
    phi = float(np.asarray(model.ar)[0])
    if not 0 < phi < 1:
        raise SeriesError(f"an AR(1) at another step needs a coefficient between 0 and 1, not {phi:g}", field="ar")
    r = step / model.step
    sigma = float(model.sigma) * math.sqrt((1 - phi ** (2 * r)) / (1 - phi**2))
    return _model(np.array([phi**r]), model.ma, model.mean, sigma, 0, step)


def stationary_ar1(
    phi: Float[Array, "#series"] | float,
    first: Float[Array, "future series"],
    innovations: Float[Array, "later future series"],
) -> Float[Array, "future slot series"]:
    """Paths of AR(1) processes with standard deviation 1: the first values, then one for each slot of innovations."""
    fresh = jnp.sqrt(1 - phi**2)

    def advance(value: Array, innovation: Array) -> tuple[Array, Array]:
        value = phi * value + fresh * innovation
        return value, value

    _, later = jax.lax.scan(advance, first, innovations)
    return jnp.moveaxis(jnp.concatenate([first[None], later]), 0, 1)


def ar1(phi: float, mean: float, sigma: float) -> Arima:
    """An hourly ARIMA(1, 0, 0) with these coefficients."""
    return _model(np.array([phi]), np.array([]), mean, sigma, 0)


def _model(ar: ArrayLike, ma: ArrayLike, mean: ArrayLike, sigma: ArrayLike, d: int, step: float = 3600.0) -> Arima:
    ar, ma, mean, sigma = map(on_device, (ar, ma, mean, sigma))
    return Arima(ar, ma, mean, sigma, d, float(step))


# --- Crowds on a network --------------------------------------------------------------------------------------------


class ArimaFlow(FlowModel):
    """The paper's crowds: every segment starts at its own volume and follows one fitted ARIMA model (section V-A)."""

    initial: Float[Array, " segment"]
    """Persons at clock 0."""
    model: Arima
    """The model of every segment; its step is the slot."""
    floor: float = eqx.field(static=True, default=1.0)
    """Persons that are always there: the power law gives zero time to a segment without people."""

    def expected(self, _hours: Hours, slots: int) -> FlowField:
        return self._field(forecast(self.model, self.initial[None, None], slots - 1))

    def draw(self, key: Key[Array, ""], hours: Hours, slots: int) -> FlowField:
        shape = (hours.shape[0], self.initial.shape[0])
        innovations = standard_normal(key, (slots - 1, *shape))
        return self._field(simulate(self.model, jnp.broadcast_to(self.initial, (1, *shape)), innovations))

    def ahead(self, now: Counts, _hour: Scalar, _slot: Index, slots: int) -> Float[Array, "slots counter"]:
        """The model's forecast from the counts of this slot alone, which is all that an AR(1) needs."""
        volume = jnp.concatenate([now[None], forecast(self.model, now[None], slots - 1)])
        return jnp.maximum(volume, self.floor)

    def _field(self, later: Float[Array, "later future segment"]) -> FlowField:
        now = jnp.broadcast_to(self.initial, later.shape[1:])[None]
        volume = jnp.moveaxis(jnp.concatenate([now, later]), 0, -2)
        return FlowField(jnp.maximum(volume, self.floor), self.model.step)


# --- Fitting --------------------------------------------------------------------------------------------------------


def fit_arima(series: Float[np.ndarray, " hour"], p: int = 1, d: int | None = None, q: int = 0) -> Arima:
    """Fit an ARIMA(p, d, q) to a series by maximum likelihood (statsmodels' state-space filter).

    Parameters
    ----------
    series
        Hourly values in persons; NaN where missing.
    p, d, q
        Its order; with d None `choose_d` decides.

    Returns
    -------
    model
        In the paper's signs.

    Raises
    ------
    SeriesError
        An impossible order; a series that is too short, infinite or constant; a fit that does not converge.
    """
    if p < 0 or q < 0 or not (d is None or 0 <= d <= _MOST_DIFFERENCES):
        raise SeriesError(f"ARIMA({p}, {d}, {q}): p and q must not be negative, d must be 0, 1 or 2", field="order")
    _check(series, enough=_SHORTEST + 10 * (p + q))
    d = choose_d(series) if d is None else d
    if np.nanstd(np.diff(series, n=d)) == 0:
        raise SeriesError(f"the series does not vary after differencing {d} times; an ARIMA needs one that does")

    from statsmodels.tools.sm_exceptions import ConvergenceWarning  # type: ignore[import-untyped]
    from statsmodels.tsa.arima.model import ARIMA  # type: ignore[import-untyped]

    scale = float(np.nanstd(series))  # the optimiser is made for numbers near one
    problem = ARIMA(series / scale, order=(p, d, q), trend="n" if d else "c")
    with warnings.catch_warnings():
        # Convergence is looked up below, and unusable starting values are replaced by statsmodels itself.
        warnings.simplefilter("ignore", ConvergenceWarning)
        warnings.filterwarnings("ignore", "Non-(stationary|invertible) starting", UserWarning)
        fit = problem.fit()
        if not fit.mle_retvals["converged"]:
            fit = problem.fit(start_params=fit.params, method_kwargs={"method": "nm", "maxiter": 2000})
    if not (fit.mle_retvals["converged"] and np.isfinite(fit.params).all()):
        raise SeriesError(f"the fit of ARIMA({p}, {d}, {q}) to this series does not converge; try a smaller order")
    mean = 0.0 if d else float(fit.params[0]) * scale
    sigma = math.sqrt(float(fit.params[-1])) * scale
    return _model(fit.arparams, -np.asarray(fit.maparams), mean, sigma, d)


def choose_d(series: Float[np.ndarray, " hour"]) -> int:
    """Choose how often to difference a series: until the KPSS test does not reject stationarity at 5 %, at most twice.

    Missing values are left out after differencing, so that a gap never looks like a jump.

    Returns
    -------
    d
        0, 1 or 2.

    Raises
    ------
    SeriesError
        A series that is too short or infinite.

    References
    ----------
    Kwiatkowski, Phillips, Schmidt, Shin (1992), doi:10.1016/0304-4076(92)90104-Y.
    """
    _check(series, enough=_SHORTEST)
    from statsmodels.tools.sm_exceptions import InterpolationWarning
    from statsmodels.tsa.stattools import kpss  # type: ignore[import-untyped]

    for d in range(_MOST_DIFFERENCES):
        differenced = np.diff(series, n=d)
        differenced = differenced[~np.isnan(differenced)]
        if np.ptp(differenced) == 0:  # nothing is left to explain, and the test would divide by zero
            return d
        with warnings.catch_warnings():
            # Beyond 1 % and 10 %, where the test's table ends, it warns that p is only a bound. A bound is enough here.
            warnings.simplefilter("ignore", InterpolationWarning)
            # statsmodels 0.15 announces another type of result; the item taken here stays.
            warnings.filterwarnings("ignore", "kpss currently returns", FutureWarning)
            p_value = kpss(differenced, regression="c", nlags="auto")[1]
        if p_value > _KPSS_LEVEL:
            return d
    return _MOST_DIFFERENCES


def _check(series: Float[np.ndarray, " hour"], enough: int) -> None:
    if np.isinf(series).any():
        raise SeriesError("the series contains infinite values; mark missing ones as NaN")
    observed = int((~np.isnan(series)).sum())
    if observed < enough:
        raise SeriesError(f"the series has {observed} values, but the fit needs {enough}")


# --- The fitted model that is shipped -------------------------------------------------------------------------------


def load_fitted(name: str = "auckland") -> Arima:
    """Load a model that was fitted in advance (by scripts/fit_auckland.py), so that no command waits for statsmodels.

    Returns
    -------
    model
        "auckland" is the paper's ARIMA(1, 0, 0) for 45 Queen Street in 2024, hourly, in persons/h.

    Raises
    ------
    SeriesError
        No model of this name.

    References
    ----------
    Heart of the City Auckland, https://www.hotcity.co.nz/pedestrian-counts, CC BY 4.0.
    """
    ending = "_arima.json"
    shipped = {f.name.removesuffix(ending): f for f in files("sidestep.crowds").iterdir() if f.name.endswith(ending)}
    if name not in shipped:
        raise SeriesError(f"no fitted model is named {name!r}; choose from {', '.join(sorted(shipped))}", field="name")
    numbers = json.loads(shipped[name].read_text(encoding="utf-8"))
    ar, ma, mean, sigma = (np.array(numbers[each]) for each in ("ar", "ma", "mean", "sigma"))
    return _model(ar, ma, mean, sigma, numbers["order"][1], numbers["step"])
