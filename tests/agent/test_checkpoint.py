"""Training runs on disk: what is loaded is what was saved, and training goes on to the bit."""

import dataclasses
import json

import jax
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import CheckpointError, TrainingRun
from sidestep.agent.config import PRESETS
from sidestep.agent.train import train
from sidestep.scenarios import draw_map, scenario

CONFIG = dataclasses.replace(
    PRESETS["default"], rounds=3, round_steps=64, walkers=8, batch=16, capacity=256, hidden=(8,)
)
PROBLEM = scenario("paper-congested", side=3, crowded_nodes=1)


def run_of(state, curve):
    return TrainingRun(PROBLEM, seed=4, index=2, config=CONFIG, curve=tuple(curve), state=state)


def plain(state):
    return [
        np.asarray(jax.random.key_data(leaf) if jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf)
        for leaf in jax.tree.leaves(state)
    ]


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A run saved after its first round, and the state that it would have reached after its last."""
    folder = tmp_path_factory.mktemp("model")
    curve = []
    for state, report in train(CONFIG, PROBLEM, draw_map(PROBLEM, 4, 2)):
        curve.append(tuple(report.test_minutes.tolist()))
        if len(curve) == 1:
            checkpoint.save(run_of(state, curve), folder)
    return folder, plain(state), curve


def test_training_goes_on_to_the_bit(saved):
    folder, straight, curve = saved
    run = checkpoint.load(folder)
    assert (run.scenario, run.seed, run.index, run.config) == (PROBLEM, 4, 2, CONFIG)
    assert run.curve == tuple(curve[:1])
    later = [
        (state, tuple(report.test_minutes.tolist()))
        for state, report in train(CONFIG, PROBLEM, draw_map(PROBLEM, 4, 2), run.state)
    ]
    assert [minutes for _, minutes in later] == curve[1:]
    for resumed, expected in zip(plain(later[-1][0]), straight, strict=True):
        np.testing.assert_array_equal(resumed, expected)


def test_shows_the_network_that_the_configuration_keeps(saved):
    run = checkpoint.load(saved[0])
    assert run.network is run.state.best
    last = dataclasses.replace(run, config=dataclasses.replace(CONFIG, keep="last"))
    assert last.network is last.state.network


def change(folder, into, edit):
    line, numbers = (folder / checkpoint.FILE).read_bytes().split(b"\n", 1)
    (into / checkpoint.FILE).write_bytes(edit(json.loads(line), numbers))


@pytest.mark.parametrize(
    ("says", "edit"),
    [
        ("damaged or cut short", lambda header, numbers: json.dumps(header).encode() + b"\n" + numbers[:-100]),
        ("damaged or cut short", lambda header, _: json.dumps(header).encode() + b"\n"),
        ("damaged or cut short", lambda header, numbers: json.dumps(header | {"seed": "x"}).encode() + b"\n" + numbers),
        ("model format 0", lambda header, numbers: json.dumps(header | {"format": 0}).encode() + b"\n" + numbers),
        ("not a Sidestep model", lambda _, numbers: numbers),
        ("not a Sidestep model", lambda *_: b""),
        ("not a Sidestep model", lambda *_: b"[]\n"),
    ],
)
def test_what_cannot_be_read_is_named(saved, tmp_path, says, edit):
    change(saved[0], tmp_path, edit)
    with pytest.raises(CheckpointError, match=says):
        checkpoint.load(tmp_path)


def test_a_folder_without_a_model(tmp_path):
    with pytest.raises(CheckpointError, match="no model in"):
        checkpoint.load(tmp_path)
