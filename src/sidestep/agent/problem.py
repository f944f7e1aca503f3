"""What an agent is trained on: an environment, its walks, and how futures are renewed from round to round."""

import itertools
import math
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp

from sidestep.agent.config import TrainConfig
from sidestep.agent.q_networks import QNetwork, tabulated
from sidestep.environment.types import EnvParams, Instance
from sidestep.scenarios.episodes import InstanceSampler, destinations_of, instances, sampler
from sidestep.scenarios.futures import make_environment, replace_futures, sample_futures
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import Scenario


class Problem(eqx.Module):
    """What an agent is trained on in one round."""

    params: EnvParams
    sampler: InstanceSampler
    """Walks to learn from."""
    tests: Instance
    """Greedy test walks, through futures of their own."""

    def evaluated(self, config: TrainConfig, q_network: QNetwork) -> QNetwork:
        """Evaluate a network once where all walkers who are at the same node observe the same.

        An iteration evaluates it on three batches otherwise, which takes longer on all but large maps.

        Parameters
        ----------
        config, q_network
            The walkers' level and the size of a batch, and what is evaluated.

        Returns
        -------
        QNetwork
            The same function of the observations of this problem: a table, or the network itself.
        """
        if config.level != "position" or self.params.network.nodes > 2 * config.batch:
            return q_network
        return tabulated(q_network, self.params.network, self.sampler.destinations[0, 0])


def pose(config: TrainConfig, scenario: Scenario, scenario_map: ScenarioMap) -> tuple[Problem, InstanceSampler]:
    """Draw futures, and choose walks on one map; those to learn from begin at the scenario's origin.

    Parameters
    ----------
    config
        How many futures, destinations and test walks, and the walkers' level.
    scenario, scenario_map
        What is learned, and where.

    Returns
    -------
    problem
        That of rounds whose walks begin where the scenario's do.
    from_anywhere
        Walks from anywhere to the same destinations.
    """
    destinations = destinations_of(scenario_map, config.destinations)
    futures = config.futures + config.test_walks
    near = as_far_as_futures_reach(config, scenario)
    params = make_environment(
        near,
        scenario_map,
        "learn",
        futures,
        level=config.level,
        destinations=destinations,
        samples=None if config.level in ("map", "live") else 0,  # below, nobody knows what is expected
    )
    params = replace(params, horizon=jnp.float32(scenario.horizon))  # walks go on beyond
    here, from_anywhere = (
        sampler(scenario, scenario_map, params, config.futures, destinations=destinations, anywhere=everywhere)
        for everywhere in (False, True)
    )
    several = destinations if config.destinations > 1 else None
    tests = instances(scenario, scenario_map, params, config.test_walks, first=config.futures, destinations=several)
    return Problem(params, here, tests), from_anywhere


def renewed(
    config: TrainConfig,
    scenario: Scenario,
    scenario_map: ScenarioMap,
    params: EnvParams,
    before: int,
    executor: Executor,
) -> Iterator[EnvParams]:
    """Yield the environment of every round after those ``before``.

    Fresh futures are drawn during the round before. Walkers that are on their way when their future is replaced go on
    in the new one.

    Parameters
    ----------
    config
        How many futures there are, and how many of them are renewed after every round.
    scenario, scenario_map, params
        What is learned, where, and its environment before any renewal.
    before
        Rounds that are done.
    executor
        Draws the futures.

    Yields
    ------
    EnvParams
        With the futures of the next round.
    """
    scenario = as_far_as_futures_reach(config, scenario)
    if not config.fresh_futures:
        yield from itertools.repeat(params)

    def renew(params: EnvParams, number: int) -> EnvParams:
        count, among = config.fresh_futures, config.futures
        fresh = sample_futures(scenario, scenario_map, params, number, futures=count, among=among)
        return replace_futures(params, fresh, jnp.int32(number * count % among), among=among)

    # Earlier ones have been replaced again.
    latest = before - math.ceil(config.futures / config.fresh_futures)
    for number in range(max(latest, 0) + 1, before + 1):
        params = renew(params, number)
    for number in range(before + 1, config.rounds):
        upcoming = executor.submit(renew, params, number)
        yield params
        params = upcoming.result()
    yield params


def as_far_as_futures_reach(config: TrainConfig, scenario: Scenario) -> Scenario:
    """Give a scenario the horizon up to which futures of training walks are drawn.

    Parameters
    ----------
    config
        How far they reach.
    scenario
        What is learned.

    Returns
    -------
    Scenario
        The same where they reach as far as its walks.
    """
    if not config.futures_reach:
        return scenario
    reach = config.futures_reach * scenario.place.across / scenario.walker.free_speed
    return scenario.changed(horizon=min(reach, scenario.horizon))
