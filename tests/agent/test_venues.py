"""Agents of venues: what is learned there, which futures are renewed, and where their models may walk."""

import dataclasses
import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import TrainingRun
from sidestep.agent.config import TrainConfigError
from sidestep.agent.presets import preset_for
from sidestep.agent.train import fresh_network, learned_place, prepare
from sidestep.network.graph import road_network
from sidestep.planners.learned import ModelError, load_planners, trainable
from sidestep.scenarios import build
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import replace_futures, sample_futures
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import ObjectiveSpec
from sidestep.scenarios.places import Sensor

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))
CONFIG = dataclasses.replace(
    preset_for(HELSINKI, "default"), rounds=1, round_steps=8, walkers=4, batch=4, capacity=8, hidden=(4,), n_step=2,
    destinations=2, futures=4, fresh_futures=2, test_walks=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def learned():
    here = learned_place(CONFIG, HELSINKI, draw_map(HELSINKI, 1))
    return here, *prepare(CONFIG, HELSINKI, here)


def save(problem, state, folder) -> None:
    checkpoint.save(TrainingRun(problem, 1, 0, CONFIG, ((7.0, 8.0),), "a place", state), folder)


def test_fresh_crowds_are_others_at_the_same_sensors(learned) -> None:
    here, problem, _ = learned
    params = problem.params
    after = replace_futures(params, sample_futures(HELSINKI, here, params, 1, 2), jnp.int32(2))
    new, old = (np.asarray(each.futures.speeds.crowds.sensed) for each in (after, params))
    assert (new[2:4] != old[2:4]).all(axis=(1, 2)).all()
    np.testing.assert_array_equal(new[[0, 1, 4, 5, 6]], old[[0, 1, 4, 5, 6]])
    for one, other in zip(
        jax.tree.leaves(after.futures.speeds.crowds.weights), jax.tree.leaves(here.flow.weights), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_a_model_can_be_read_without_its_place(learned, tmp_path, monkeypatch) -> None:
    _, problem, state = learned
    sensors = (Sensor(name="somewhere", place=(60.17, 24.94)), *HELSINKI.place.crowd_source.sensors)
    told = HELSINKI.changed(sensors=sensors, streets_per_sensor=1)
    save(told, state, tmp_path)

    def never(*_):
        raise AssertionError

    monkeypatch.setattr(checkpoint, "draw_training_map", never)
    monkeypatch.setattr(build, "town_of", never)
    model = checkpoint.load_model(tmp_path)
    assert (model.scenario, model.config, model.fingerprint) == (told, CONFIG, "a place")
    for read, kept in zip(jax.tree.leaves(model.network), jax.tree.leaves(state.network), strict=True):
        np.testing.assert_array_equal(read, kept)
    # It has the numbers of its own town's streets, not those that it was read with.
    assert float(model.network.metres) == pytest.approx(float(problem.params.network.length.mean()))


def test_models_of_grids_do_not_walk_towns_nor_the_reverse(learned, tmp_path) -> None:
    _, _, state = learned
    save(HELSINKI, state, tmp_path)
    assert load_planners([tmp_path], scenario("helsinki"), 0).index is None
    with pytest.raises(ModelError, match=r"learned to walk in a town whose crowds .* sensors; unseen-maps is another"):
        load_planners([tmp_path], scenario("unseen-maps"), 0)


def test_models_walk_for_the_objective_that_they_learned_for(learned, tmp_path) -> None:
    _, _, state = learned
    exposed = HELSINKI.changed(objective=ObjectiveSpec(exposure=0.5, max_density=4.0))
    save(exposed, state, tmp_path)
    assert checkpoint.load_model(tmp_path).scenario == exposed
    assert load_planners([tmp_path], exposed, 0).index is None
    with pytest.raises(ModelError, match="learned for another objective"):
        load_planners([tmp_path], HELSINKI, 0)


def test_no_agent_walks_a_town_by_its_position() -> None:
    for name in ("default", "paper", "tabular-q"):
        with pytest.raises(TrainConfigError, match="cannot learn to walk anywhere in helsinki"):
            preset_for(HELSINKI, name, "position")
    assert set(trainable(HELSINKI, 0, "map", "default")) == {"darp", "dqn"}


def test_a_model_needs_no_scenario_file_to_walk_elsewhere(tmp_path) -> None:
    gone = HELSINKI.changed(streets=str(tmp_path / "gone.npz"), file=str(tmp_path / "gone.csv"), destinations=(3,))
    two = road_network(np.zeros((2, 2)), [0, 1], [1, 0], [1.0, 1.0])
    network = fresh_network(CONFIG, gone, two, jax.random.key(0))
    header = {
        "format": checkpoint.FORMAT,
        "scenario": gone.model_dump(),
        "seed": 0,
        "index": 0,
        "config": dataclasses.asdict(CONFIG),
        "curve": [],
        "fingerprint": "",
    }
    with (tmp_path / checkpoint.MODEL).open("wb") as file:
        file.write(json.dumps(header).encode() + b"\n")
        eqx.tree_serialise_leaves(file, network)
    model = checkpoint.load_model(tmp_path)
    assert (model.scenario, model.config) == (gone, CONFIG)
