"""Agents of venues: what is learned there, which futures are renewed, and where their models may walk."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import Checkpoint, Metadata
from sidestep.agent.config import TrainConfigError
from sidestep.agent.presets import preset_for
from sidestep.agent.train import prepare
from sidestep.planners.learned import ModelError, load_planners, trainable
from sidestep.scenarios import build
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import replace_futures, sample_futures
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import ObjectiveSpec

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))
CONFIG = preset_for(HELSINKI, "default").changed(
    rounds=1, round_steps=8, walkers=4, batch=4, capacity=8, hidden=(4,), n_step=2, destinations=2, futures=4,
    fresh_futures=2, test_walks=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def learned():
    here = draw_map(HELSINKI, 1)
    return here, *prepare(CONFIG, HELSINKI, here)


def save(problem, state, folder) -> Metadata:
    metadata = Metadata(scenario=problem, seed=1, map=0, config=CONFIG, curve=((7.0, 8.0),), fingerprint="a place")
    checkpoint.save(Checkpoint(metadata, state), folder)
    return metadata


def test_fresh_futures_are_others_at_the_same_sensors(learned) -> None:
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


def test_a_model_can_be_read_where_its_files_are_gone(learned, tmp_path, monkeypatch) -> None:
    _, problem, state = learned
    gone = HELSINKI.changed(streets=str(tmp_path / "gone.npz"), file=str(tmp_path / "gone.csv"), destinations=(3,))
    saved = save(gone, state, tmp_path)

    def never(*_):
        raise AssertionError

    monkeypatch.setattr(checkpoint, "draw_training_map", never)
    monkeypatch.setattr(build, "town_of", never)
    model = checkpoint.load_model(tmp_path)
    assert model.metadata == saved
    kept = Checkpoint(saved, state).model.q_network
    for read, written in zip(jax.tree.leaves(model.q_network), jax.tree.leaves(kept), strict=True):
        np.testing.assert_array_equal(read, written)
    # It has the numbers of its own town's streets, not those that it was read with.
    assert float(model.q_network.metres) == pytest.approx(float(problem.params.network.length.mean()))


def test_models_of_grids_do_not_walk_towns_nor_the_reverse(learned, tmp_path) -> None:
    _, _, state = learned
    save(HELSINKI, state, tmp_path)
    assert load_planners([tmp_path], scenario("helsinki"), 0).index is None
    with pytest.raises(ModelError, match="unseen-maps"):
        load_planners([tmp_path], scenario("unseen-maps"), 0)


def test_models_walk_for_the_objective_that_they_learned_for(learned, tmp_path) -> None:
    _, _, state = learned
    exposed = HELSINKI.changed(objective=ObjectiveSpec(exposure=0.5, max_density=4.0))
    save(exposed, state, tmp_path)
    assert checkpoint.load_model(tmp_path).metadata.scenario == exposed
    assert load_planners([tmp_path], exposed, 0).index is None
    with pytest.raises(ModelError) as caught:
        load_planners([tmp_path], HELSINKI, 0)
    assert caught.value.field == "objective"


def test_no_agent_walks_a_town_by_its_position() -> None:
    for name in ("default", "paper", "tabular-q"):
        with pytest.raises(TrainConfigError) as caught:
            preset_for(HELSINKI, name, "position")
        assert caught.value.field == "level"
    assert set(trainable(HELSINKI, 0, "map", "default")) == {"darp", "dqn"}
