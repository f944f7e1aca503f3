"""How long a decision takes."""

from functools import partial
from time import perf_counter

import jax

from sidestep.environment.dynamics import reset
from sidestep.environment.types import EnvParams, Instance
from sidestep.planners.base import DecideByPlan, Plan, Planner


def decision_seconds(planner: Planner, params: EnvParams, plan: Plan, todo: Instance, key: jax.Array) -> float:
    """Seconds that one decision takes in a batch of one for each walk, all at their origins."""
    decide = partial(_decide_all, planner.decide, params, plan, todo, key)
    decide().block_until_ready()
    began = perf_counter()
    decide().block_until_ready()
    return (perf_counter() - began) / todo.origin.shape[0]


@partial(jax.jit, static_argnames="decide")
def _decide_all(decide: DecideByPlan, params: EnvParams, plan: Plan, todo: Instance, key: jax.Array) -> jax.Array:
    def one(own: object, instance: Instance) -> jax.Array:
        _, observation = reset(params, instance)
        return decide(plan.shared, own, observation, key)

    return jax.vmap(one)(plan.own, todo)
