"""Walks in the shape of gymnax's environments, for learners that are written for these.

gymnax itself is not needed; where it is loaded, spaces are its own, which learners ask for by their class.
"""

import sys
from dataclasses import replace
from functools import partial
from typing import Any, Literal, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, UInt32

from sidestep.environment.types import EnvState, Observation
from sidestep.gym.options import EnvError, GymnaxOptions, read_options
from sidestep.gym.spaces import KEYS
from sidestep.gym.task import Task, task_of

Api = Literal["0.0.9", "1.0"]
"""Versions of gymnax that return different values from a step."""
MOST_STEPS = 1_000
AnyKey = Key[Array, ""] | UInt32[Array, "2"]
"""A key of ``jax.random``, new style or old."""


class Discrete:
    """Whole numbers below ``n``, as ``gymnax.environments.spaces.Discrete``."""

    def __init__(self, num_categories: int) -> None:
        self.n, self.shape, self.dtype = num_categories, (), jnp.int32

    def sample(self, key: AnyKey) -> Array:
        return jax.random.randint(key, self.shape, 0, self.n, self.dtype)

    def contains(self, x: Array) -> Array:
        return (x >= 0) & (x < self.n)


class Box:
    """Arrays of numbers within limits, as ``gymnax.environments.spaces.Box``."""

    def __init__(self, low: Any, high: Any, shape: tuple[int, ...], dtype: Any = jnp.float32) -> None:
        self.low, self.high, self.shape, self.dtype = low, high, shape, dtype

    def sample(self, key: AnyKey) -> Array:
        return jax.random.uniform(key, self.shape, minval=self.low, maxval=self.high).astype(self.dtype)

    def contains(self, x: Array) -> Array:
        return jnp.all((x >= self.low) & (x <= self.high))


class Dict:
    """Spaces by name, as ``gymnax.environments.spaces.Dict``."""

    def __init__(self, spaces: dict[str, Any]) -> None:
        self.spaces, self.num_spaces = spaces, len(spaces)

    def sample(self, key: AnyKey) -> dict[str, Array]:
        keys = jax.random.split(key, self.num_spaces)
        return {name: space.sample(one) for (name, space), one in zip(self.spaces.items(), keys, strict=True)}

    def contains(self, x: dict[str, Array]) -> Array:
        return jnp.all(jnp.array([space.contains(x[name]) for name, space in self.spaces.items()]))


class GymnaxParams(eqx.Module):
    """What a gymnax environment calls its parameters."""

    task: Task
    max_steps_in_episode: int = MOST_STEPS
    """Segments after which a walk is cut off, beside the scenario's horizon."""

    def replace(self, **changes: Any) -> "GymnaxParams":
        """Change some of them, as gymnax's own parameters do."""
        return replace(self, **changes)


class GymnaxEnv:
    """Walks of a scenario with the methods of ``gymnax.environments.environment.Environment``.

    Steps begin the next walk by themselves. Its parameters are a PyTree with all streets and crowds: hand them on to
    compiled functions as an argument.

    Parameters
    ----------
    scenario
        A scenario, its name or its file.
    api
        What ``step`` returns: observation, state, reward, done and info in ``0.0.9`` (which rejax wants), or
        observation, state, reward, terminated, truncated and info in ``1.0``.
    **options
        Fields of :class:`sidestep.gym.options.GymnaxOptions`.

    Raises
    ------
    SidestepError
        Unknown and wrong options, with their field, and files that cannot be read or do not fit.

    Examples
    --------
    >>> import jax
    >>> from sidestep.gym.gymnax import GymnaxEnv
    >>> env = GymnaxEnv("paper-congested", futures=2)
    >>> params, key = env.default_params, jax.random.key(0)
    >>> observation, state = env.reset(key, params)
    >>> observation, state, reward, terminated, truncated, info = env.step(key, state, 2, params)
    >>> int(state.node), bool(terminated), info["action_mask"].tolist()
    (1, False, [1, 0, 1, 1])
    """

    def __init__(self, scenario: object, *, api: str = "1.0", **options: Any) -> None:
        if api not in get_args(Api):
            raise EnvError(f"api must be one of {', '.join(get_args(Api))}, not {api!r:.60}", field="api")
        self.options = read_options(GymnaxOptions, scenario, options)
        self.api = api
        self.default_params = GymnaxParams(task_of(self.options))

    @property
    def name(self) -> str:
        """The scenario's name."""
        return self.options.scenario.name

    @property
    def num_actions(self) -> int:
        """Exits."""
        return self.default_params.task.exits

    def reset(self, key: AnyKey, params: GymnaxParams | None = None) -> tuple[Any, EnvState]:
        """Begin a walk; observation and state."""
        return _reset(self.options.mask, key, self.default_params if params is None else params)

    def step(
        self, key: AnyKey, state: EnvState, action: Int[Array, ""] | int, params: GymnaxParams | None = None
    ) -> tuple[Any, ...]:
        """Walk to the next crossing, and begin another walk where one is over; see ``api`` for what comes back."""
        params = self.default_params if params is None else params
        shown, state, reward, terminated, truncated, info = _step(self.options.mask, key, state, action, params)
        if self.api == "1.0":
            return shown, state, reward, terminated, truncated, info
        return shown, state, reward, terminated | truncated, info

    reset_env = reset

    def step_env(
        self, key: AnyKey, state: EnvState, action: Int[Array, ""] | int, params: GymnaxParams
    ) -> tuple[Any, EnvState, Float[Array, ""], Bool[Array, ""], dict[str, Array]]:
        """Walk to the next crossing; observation, state, reward, end and info. In ``1.0`` only arrival is an end."""
        after, told, (reward, terminated, truncated, info) = _walked(self.options.mask, state, action, params)
        return told, after, reward, terminated if self.api == "1.0" else terminated | truncated, info

    def get_obs(self, state: EnvState, params: GymnaxParams | None = None, key: Any = None) -> Any:
        """What is seen in a state."""
        task = (self.default_params if params is None else params).task
        return _shown(self.options.mask, task, task.observe(state))

    def action_mask(self, state: EnvState, params: GymnaxParams | None = None) -> Bool[Array, " exit"]:
        """Which exits may be taken."""
        return (self.default_params if params is None else params).task.mask(state)

    def is_terminated(self, state: EnvState, params: GymnaxParams) -> Bool[Array, ""]:
        """Whether the walker has arrived."""
        return state.node == state.instance.destination

    def is_truncated(self, state: EnvState, params: GymnaxParams) -> Bool[Array, ""]:
        """Whether time is up."""
        late = state.clock - state.instance.departure >= params.task.params.horizon
        return ~self.is_terminated(state, params) & (late | (state.steps >= params.max_steps_in_episode))

    def is_terminal(self, state: EnvState, params: GymnaxParams) -> Bool[Array, ""]:
        """Whether the walk is over; in ``1.0`` only arrival counts."""
        arrived = self.is_terminated(state, params)
        return arrived if self.api == "1.0" else arrived | self.is_truncated(state, params)

    def discount(self, state: EnvState, params: GymnaxParams) -> Float[Array, ""]:
        """0 where the walk is over, else 1."""
        return jnp.where(self.is_terminal(state, params), 0.0, 1.0)

    def action_space(self, params: GymnaxParams | None = None) -> Any:
        """The exits."""
        return _spaces().Discrete(self.num_actions)

    def observation_space(self, params: GymnaxParams | None = None) -> Any:
        """What is shown."""
        spaces, encoder = _spaces(), self.default_params.task.encoder
        match self.options.observation:
            case "features":
                shown = spaces.Box(encoder.low, encoder.high, encoder.low.shape, jnp.float32)
            case "node":
                shown = spaces.Discrete(encoder.nodes)
            case "one-hot":
                shown = spaces.Box(0.0, 1.0, (encoder.nodes,), jnp.float32)
        if self.options.mask == "info":
            return shown
        mask = spaces.Box(0, 1, (self.num_actions,), jnp.int8)
        return spaces.Dict(dict(zip(KEYS[self.options.mask], (shown, mask), strict=True)))


def _spaces() -> Any:
    """Spaces of gymnax where it is loaded, else those of this module."""
    if "gymnax" in sys.modules:
        from gymnax.environments import spaces

        return spaces
    return sys.modules[__name__]


def _shown(mask_form: str, task: Task, seen: Observation) -> Any:
    shown = task.encode(seen)
    if mask_form == "info":
        return shown
    return dict(zip(KEYS[mask_form], (shown, seen.valid.astype(jnp.int8)), strict=True))


@partial(jax.jit, static_argnums=0)
def _reset(mask_form: str, key: AnyKey, params: GymnaxParams) -> tuple[Any, EnvState]:
    state = params.task.start(key)
    return _shown(mask_form, params.task, params.task.observe(state)), state


def _walked(
    mask_form: str, state: EnvState, action: Any, params: GymnaxParams
) -> tuple[EnvState, Any, tuple[Any, ...]]:
    after, outcome = params.task.step(state, jnp.asarray(action, jnp.int32))
    terminated = outcome.terminated
    truncated = ~terminated & (outcome.truncated | (after.steps >= params.max_steps_in_episode))
    info = {
        "action_mask": outcome.observation.valid.astype(jnp.int8),
        "seconds": after.clock - after.instance.departure,
        "discount": 1.0 - terminated,
    }
    told = _shown(mask_form, params.task, outcome.observation)
    return after, told, (outcome.reward, terminated, truncated, info)


@partial(jax.jit, static_argnums=0)
def _step(
    mask_form: str, key: AnyKey, state: EnvState, action: Any, params: GymnaxParams
) -> tuple[Any, EnvState, Float[Array, ""], Bool[Array, ""], Bool[Array, ""], dict[str, Any]]:
    after, final, (reward, terminated, truncated, info) = _walked(mask_form, state, action, params)
    over = terminated | truncated
    going = jax.tree.map(partial(jnp.where, over), params.task.start(key), after)
    seen = params.task.observe(going)
    info |= {"action_mask": seen.valid.astype(jnp.int8), "terminated": terminated, "truncated": truncated}
    info["final_observation"] = final
    return _shown(mask_form, params.task, seen), going, reward, terminated, truncated, info
