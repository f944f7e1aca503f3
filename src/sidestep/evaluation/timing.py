"""How long decisions take."""

from functools import partial
from time import perf_counter

import jax
import numpy as np
from jaxtyping import Array, Int, Key

from sidestep.environment.dynamics import reset
from sidestep.environment.observation import at_level
from sidestep.environment.types import EnvParams, Instance
from sidestep.planners.base import DecideByPlan, Plan, Planner


def decision_us(
    planner: Planner, params: EnvParams, plan: Plan, instances: Instance, key: Key[Array, ""], decisions: int
) -> float:
    """Measure how long a planner plans and decides, in microseconds for each decision.

    Planning is repeated and shared out among the decisions of all walks; deciding is measured at the origins. Neither
    counts tables of costs to go and forecasts, which belong to the environment.

    Parameters
    ----------
    planner, params, plan, instances, key
        As for :func:`sidestep.planners.base.walk_plan`. The plan was made before, so that nothing is compiled here
        that planning compiles.
    decisions
        Number of decisions that all walks took together.

    Returns
    -------
    float
        Microseconds.
    """
    began = perf_counter()
    jax.tree.map(np.asarray, planner.plan(params, instances).own)  # waits until it is there
    planning = perf_counter() - began
    decide = partial(_decide_all, planner.decide, at_level(params, planner.observes), plan, instances, key)
    decide().block_until_ready()
    began = perf_counter()
    decide().block_until_ready()
    return 1e6 * (planning / max(decisions, 1) + (perf_counter() - began) / instances.origin.shape[0])


@partial(jax.jit, static_argnames="decide")
def _decide_all(
    decide: DecideByPlan, params: EnvParams, plan: Plan, instances: Instance, key: Key[Array, ""]
) -> Int[Array, " walk"]:
    def one(own: object, instance: Instance) -> Int[Array, ""]:
        _, observation = reset(params, instance)
        return decide(plan.shared, own, observation, key)

    return jax.vmap(one)(plan.own, instances)
