"""Nobody is faster than the clairvoyant, whatever the map, the crowds and the decisions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.environment.types import EnvParams, Instance
from sidestep.planners.base import Plan, walk_plan
from sidestep.planners.random import RandomProgress, RandomWalk
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.walking.speed_laws import LAWS

SIDE, WALKS, FUTURES = 4, 8, 3
TOLERANCE = 1e-4
# So long that everybody may arrive through the worst of jams: a walk that is cut off counts less than it would take.
HORIZON, SLOT_SECONDS = 48 * 3600.0, 1800.0


class AnyTable:
    """Decides by an arbitrary table of exits."""

    name = "any-table"
    level = observes = "position"
    decide = staticmethod(RandomWalk.decide)

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def plan(self, params: EnvParams, instances: Instance) -> Plan:
        shape = (instances.origin.shape[0], params.network.nodes, params.network.exits)
        return Plan(None, self.rng.random(shape) < 0.4)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("flows", ["arima", "forecast"])
@settings(max_examples=12)
@given(
    seed=st.integers(0, 2**32 - 1),
    crowded_nodes=st.integers(0, SIDE**2 - 2),
    corner_to_corner=st.booleans(),
    latest=st.sampled_from([0.0, 7200.0]),
)
def test_no_planner_beats_the_clairvoyant(
    law: str, flows: str, seed: int, crowded_nodes: int, corner_to_corner: bool, latest: float
) -> None:
    # The number of crowded nodes matters to the map alone, so one compiled environment serves all of them.
    common = dict(side=SIDE, law=law, flows=flows, horizon=HORIZON, slot_seconds=SLOT_SECONDS)
    place = draw_map(scenario("paper-congested", crowded_nodes=crowded_nodes, **common), seed)
    params = make_environment(scenario("paper-congested", **common), place, "test", FUTURES)
    rng = np.random.default_rng(seed)
    ends = rng.integers(SIDE**2, size=(2, WALKS))
    todo = Instance(
        origin=jnp.asarray(ends[0] * (not corner_to_corner), jnp.int32),
        destination=jnp.asarray(np.where(corner_to_corner, SIDE**2 - 1, ends[1]), jnp.int32),
        departure=jnp.asarray(rng.uniform(0, latest, WALKS), jnp.float32),
        future=jnp.asarray(rng.integers(params.futures.count, size=WALKS), jnp.int32),
    )

    def seconds(planner) -> np.ndarray:
        walked = walk_plan(planner, params, planner.plan(params, todo), todo, jax.random.key(seed))
        return np.asarray(walked.seconds, np.float64)

    best = seconds(Clairvoyant())
    assert (best < HORIZON).all()
    for planner in (RandomWalk(), RandomProgress(), ShortestPath(), Expected(), AnyTable(seed)):
        assert (seconds(planner) >= best * (1 - TOLERANCE)).all(), planner.name


def test_the_bound_can_be_missed_and_reached() -> None:
    # Or the property above would hold of a bound that is merely low, or of planners that are all alike.
    congested = scenario("paper-congested", side=SIDE, horizon=HORIZON, slot_seconds=SLOT_SECONDS)
    params = make_environment(congested, draw_map(congested, 0), "test", FUTURES)
    future = jnp.asarray(np.arange(WALKS) % params.futures.count, jnp.int32)  # as many walks as above
    todo = Instance(jnp.zeros(WALKS, jnp.int32), jnp.full(WALKS, SIDE**2 - 1, jnp.int32), jnp.zeros(WALKS), future)
    mean = {
        planner.name: float(
            walk_plan(planner, params, planner.plan(params, todo), todo, jax.random.key(0)).seconds.mean()
        )
        for planner in (RandomWalk(), RandomProgress(), ShortestPath(), Expected(), Clairvoyant())
    }
    assert mean["clairvoyant"] <= mean["expected"] < 1.2 * mean["clairvoyant"]
    assert mean["expected"] < mean["shortest-path"] < mean["random-walk"]
    assert mean["clairvoyant"] < mean["random-progress"] < mean["random-walk"]
