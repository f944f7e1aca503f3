"""Learn a congested map in JAX: Q-learning of one's own by 64 walkers at once, in one compiled program."""

import jax
import jax.numpy as jnp
from jax import Array

from sidestep.environment.types import EnvState
from sidestep.gym import Task, make_task


def best(task: Task, values: Array, state: EnvState) -> Array:
    """Values of the exits that may be taken."""
    return jnp.where(task.mask(state), values[state.node], -jnp.inf)


@jax.jit
def learn(task: Task, key: Array) -> Array:
    """Learn a value for every crossing and exit."""

    def step(values: Array, state: EnvState, key: Array) -> tuple[EnvState, tuple[Array, Array, Array]]:
        explore, which, anew = jax.random.split(key, 3)
        known = best(task, values, state)
        random = jax.random.categorical(which, jnp.where(task.mask(state), 0.0, -jnp.inf))
        action = jnp.where(jax.random.bernoulli(explore, 0.2), random, known.argmax())
        after, outcome = task.step(state, action)
        onward = jnp.where(outcome.terminated, 0.0, best(task, values, after).max())
        error = outcome.reward + onward - values[state.node, action]
        over = outcome.terminated | outcome.truncated
        going = jax.tree.map(lambda new, old: jnp.where(over, new, old), task.start(anew), after)
        return going, (state.node, action, error)

    def all_walk(carry: tuple[Array, EnvState], key: Array) -> tuple[tuple[Array, EnvState], None]:
        values, states = carry
        states, (node, action, error) = jax.vmap(step, (None, 0, 0))(values, states, jax.random.split(key, 64))
        return (values.at[node, action].add(0.02 * error), states), None

    keys = jax.random.split(key, 2_001)
    states = jax.vmap(task.start)(jax.random.split(keys[0], 64))
    (values, _), _ = jax.lax.scan(all_walk, (jnp.zeros((36, 4)), states), keys[1:])
    return values


task = make_task("paper-congested", walks="anywhere")
values = learn(task, jax.random.key(0))

test = make_task("paper-congested", purpose="test")
state, over = test.start(jax.random.key(1)), False
step = jax.jit(Task.step)
while not over:
    state, outcome = step(test, state, best(test, values, state).argmax())
    over = bool(outcome.terminated | outcome.truncated)
print(f"{state.clock / 60:.0f} min, {'arrived' if outcome.terminated else 'did not arrive'}")
