"""Many walkers in one compiled call: how walks begin, and steps after whose end others begin."""

from collections.abc import Callable, Iterable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int8, UInt32

from sidestep.environment.types import EnvState, Instance, Observation
from sidestep.gym.task import Task
from sidestep.scenarios.episodes import DRAWS


class Walkers(NamedTuple):
    """Walkers on their way; each has a random stream of its own, from which its walks are drawn one after the other."""

    state: list[Array]
    """Leaves of their :class:`~sidestep.environment.types.EnvState`: JAX hands on classes much more slowly."""
    stream: UInt32[Array, "*walker word"]
    episode: Int[Array, "*walker"]
    """Number of the walk in the stream."""
    over: Bool[Array, "*walker"]
    """Whether the walk is over."""


class Told(NamedTuple):
    """What is told of walkers, packed into few arrays: each costs as much to hand over as a hundred walkers."""

    shown: Array
    mask: Int8[Array, "*walker exit"]
    floats: Float[Array, "4 *walker"]
    """Reward; cost of the step, s; seconds walked; clock of the departure, s."""
    ints: Int[Array, "3 *walker"]
    """Node; destination; future."""
    flags: Bool[Array, "2 *walker"]
    """Terminated; truncated."""


_AXES = Told(0, 0, 1, 1, 1)  # type: ignore[arg-type] # where walkers are counted


class Programs(NamedTuple):
    """Compiled for one kind of task. The leaves of the task come first: they are no constants of the program."""

    sample: Callable[..., Instance]
    """Streams and episodes to the walks that they stand for."""
    begin: Callable[..., tuple[Walkers, Told]]
    """Walks begun, where the mask says so; else walkers go on."""
    step: Callable[..., tuple[Walkers, Told, Told | None]]
    """Actions to what they bring and, where walks begin in the same step, what was told of those that ended."""


def streams(seeds: Iterable[int]) -> UInt32[np.ndarray, "walker 2"]:
    """Random streams of walkers, two random words each, from a seed of 0 or more for each of them."""
    return np.stack([np.random.SeedSequence(seed).generate_state(2) for seed in seeds])


def uniform(stream: UInt32[Array, "2"], walk: Int[Array, ""]) -> Float[Array, " draw"]:
    """Uniform numbers for one walk of a stream.

    A hash of a counter (lowbias32, Wellons 2018), twice: within a step of a thousand walkers ``jax.random`` takes as
    long as their steps.

    Parameters
    ----------
    stream, walk
        Random words, and the number of the walk.

    Returns
    -------
    Float[Array, " draw"]
        In [0, 1), ``DRAWS`` of them.
    """
    counter = walk.astype(jnp.uint32) * DRAWS + jnp.arange(DRAWS, dtype=jnp.uint32)
    return (_hash(_hash(counter + stream[0]) ^ stream[1]) >> 8) * jnp.float32(2**-24)


def _hash(word: UInt32[Array, " draw"]) -> UInt32[Array, " draw"]:
    word = (word ^ (word >> 16)) * jnp.uint32(0x7FEB352D)
    word = (word ^ (word >> 15)) * jnp.uint32(0x846CA68B)
    return word ^ (word >> 16)


@lru_cache(maxsize=32)
def programs(structure: Any, mode: str, most_steps: int | None) -> Programs:
    """Compile what moves the walkers of a kind of task.

    Parameters
    ----------
    structure
        Of the task, as ``jax.tree.structure`` gives it.
    mode
        When the next walk begins: ``NextStep``, ``SameStep``, or ``Disabled`` for never.
    most_steps
        Segments after which a walk is cut off; None where there is no such limit.

    Returns
    -------
    Programs
        They compile when they are first called, once for every number of walkers.
    """

    def of_task(function: Callable[..., Any], out_axes: Any = 0) -> Callable[..., Any]:
        @jax.jit
        def called(leaves: list[Array], *of_walkers: Any) -> Any:
            task = jax.tree.unflatten(structure, leaves)
            return jax.vmap(partial(function, task), out_axes=out_axes)(*of_walkers)

        return called

    step = partial(_step, mode=mode, most_steps=most_steps)
    final = _AXES if mode == "SameStep" else None
    return Programs(of_task(_drawn), of_task(_begun, (0, _AXES)), of_task(step, (0, _AXES, final)))


def _drawn(task: Task, stream: UInt32[Array, "2"], episode: Int[Array, ""]) -> Instance:
    return task.sampler.sample(uniform(stream, episode))


def _begun(task: Task, before: Walkers, instance: Instance, now: Bool[Array, ""]) -> tuple[Walkers, Told]:
    begun = task.begin(instance)
    state = jax.tree.map(partial(jnp.where, now), begun, _state(begun, before))
    walker = before._replace(state=jax.tree.leaves(state), over=before.over & ~now)
    return walker, _told(task, state, task.observe(state), jnp.float32(0), jnp.float32(0), jnp.zeros(2, bool))


def _step(
    task: Task, before: Walkers, action: Int[Array, ""], *, mode: str, most_steps: int | None
) -> tuple[Walkers, Told, Told | None]:
    episode = before.episode + before.over if mode == "NextStep" else before.episode + 1
    begun = task.begin(_drawn(task, before.stream, episode))
    state, outcome = task.step(_state(begun, before), action)
    truncated = outcome.truncated
    if most_steps is not None:
        truncated |= ~outcome.terminated & (state.steps >= most_steps)
    reward, cost, flags = outcome.reward, outcome.crossed.cost, jnp.stack([outcome.terminated, truncated])
    if mode == "Disabled":
        walker = before._replace(state=jax.tree.leaves(state), over=flags.any())
        return walker, _told(task, state, outcome.observation, reward, cost, flags), None
    anew = before.over if mode == "NextStep" else flags.any()
    after = jax.tree.map(partial(jnp.where, anew), begun, state)
    if mode == "SameStep":
        final = _told(task, state, outcome.observation, reward, cost, flags)
        told = _told(task, after, task.observe(after), reward, jnp.where(anew, 0.0, cost), flags)
        episode = jnp.where(anew, episode, before.episode)
        return Walkers(jax.tree.leaves(after), before.stream, episode, jnp.bool_(False)), told, final
    reward, cost, flags = jnp.where(anew, 0.0, reward), jnp.where(anew, 0.0, cost), flags & ~anew
    walker = Walkers(jax.tree.leaves(after), before.stream, episode, flags.any())
    return walker, _told(task, after, task.observe(after), reward, cost, flags), None


def _state(like: EnvState, walker: Walkers) -> EnvState:
    state: EnvState = jax.tree.unflatten(jax.tree.structure(like), walker.state)
    return state


def _told(
    task: Task,
    state: EnvState,
    seen: Observation,
    reward: Float[Array, ""],
    cost: Float[Array, ""],
    flags: Bool[Array, "2"],
) -> Told:
    instance = state.instance
    return Told(
        shown=task.encode(seen),
        mask=seen.valid.astype(jnp.int8),
        floats=jnp.stack([reward, cost, state.clock - instance.departure, instance.departure]),
        ints=jnp.stack([state.node, instance.destination, instance.future]),
        flags=flags,
    )
