"""Several devices: walkers are divided among them, and walk as on one."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

SAID = """
import json
import jax, jax.numpy as jnp, numpy as np, sidestep
from sidestep.agent.train import train_round
from sidestep.planners.base import walk_plan
from sidestep.programs import over_devices

problem = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
drawn = sidestep.draw_map(problem, seed=0)
params = sidestep.make_environment(problem, drawn, "test", 8)
walks = sidestep.instances(problem, drawn, params, 8)
planner = sidestep.find_planner("random-progress")
small = sidestep.preset("default").changed(
    rounds=3, round_steps=64, walkers=8, batch=16, capacity=64, futures=4, test_walks=4, n_step=2, hidden=(8,),
    random_origins=1.0, learning_rate=0.03,
)

def found():
    run = sidestep.train(problem, small)
    walked = walk_plan(planner, params, planner.plan(params, walks), walks, jax.random.key(0))
    return {
        "curve": run.metadata.curve,
        "weights": np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(run.model.q_network)]).tolist(),
        "walkers": [np.asarray(leaf).tolist() for leaf in jax.tree.leaves(run.state.walkers)],
        "walked": walked.seconds.tolist(),
    }

several = found()
[compiled] = train_round._variants.values()
jax.config.update("jax_default_device", jax.devices()[0])
one = found()
jax.config.update("jax_default_device", None)
def divided(number):
    made = jax.jit(over_devices(jnp.sin, number, (0,)))(jnp.ones(number))
    return len({str(shard.index) for shard in made.addressable_shards})

parts = [divided(number) for number in (1, 6, 8)]
gathers = compiled._executable.as_text().count("all-gather")
print(json.dumps({"several": several, "one": one, "parts": parts, "gathers": gathers}))
"""


@pytest.fixture(scope="module")
def four_devices() -> dict[str, Any]:
    told = {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=4"}
    done = subprocess.run([sys.executable, "-c", SAID], env=os.environ | told, text=True, capture_output=True)
    assert not done.returncode, done.stderr
    return json.loads(done.stdout)


def test_trainings_on_several_devices_end_with_the_same_walks(four_devices):
    several, one = four_devices["several"], four_devices["one"]
    assert several["curve"] == one["curve"]
    assert several["walkers"] == one["walkers"]
    # Not to the bit: sums of gradients are compiled otherwise.
    assert several["weights"] == pytest.approx(one["weights"], rel=1e-5, abs=1e-6)


def test_planners_walk_on_several_devices_as_on_one(four_devices):
    assert four_devices["several"]["walked"] == four_devices["one"]["walked"]


def test_walkers_are_divided_as_far_as_their_number_allows(four_devices):
    assert four_devices["parts"] == [1, 2, 4]
    assert four_devices["gathers"] > 0
