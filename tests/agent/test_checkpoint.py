"""Training runs on disk: what is loaded is what was saved, and training goes on to the bit."""

import dataclasses
import json

import jax
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import CheckpointError, TrainingRun
from sidestep.agent.presets import PRESETS, preset
from sidestep.agent.train import train
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_map, draw_training_map, fingerprint

CONFIG = dataclasses.replace(
    PRESETS["default"], rounds=3, round_steps=64, walkers=8, batch=16, capacity=256, hidden=(8,)
)
PROBLEM = scenario("paper-congested", side=3, crowded_nodes=1)


def run_of(state, curve):
    learned = fingerprint(draw_map(PROBLEM, 4, 2))
    return TrainingRun(PROBLEM, seed=4, index=2, config=CONFIG, curve=tuple(curve), fingerprint=learned, state=state)


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


def looks(tree):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def test_the_model_is_what_the_run_shows(saved):
    model, run = checkpoint.load_model(saved[0]), checkpoint.load(saved[0])
    assert (model.scenario, model.seed, model.index, model.config) == (PROBLEM, 4, 2, CONFIG)
    assert model.curve == run.curve
    assert model.fingerprint == fingerprint(draw_map(PROBLEM, 4, 2))
    for read, kept in zip(looks(model.network), looks(run.network), strict=True):
        np.testing.assert_array_equal(read, kept)


LOCAL = dataclasses.replace(
    preset("default", "local"), rounds=1, round_steps=32, walkers=8, batch=16, capacity=64, hidden=(8,), places=2,
    n_step=2, futures=4, fresh_futures=2, test_walks=2,
)  # fmt: skip
UNSEEN = scenario("unseen-maps", side=3, larger=(4,), crowded_nodes=1, training_maps=2, horizon=3600.0)


@pytest.mark.parametrize(
    ("config", "problem"),
    [
        (dataclasses.replace(CONFIG, rounds=1, keep="last"), PROBLEM),
        (dataclasses.replace(PRESETS["tabular-q"], rounds=1, round_steps=640), PROBLEM),
        (LOCAL, scenario("rush-16", side=3, crowded_nodes=1, horizon=3600.0)),
        (LOCAL, scenario("shifting-crowds", side=3, crowded_nodes=1, horizon=3600.0)),
        (dataclasses.replace(LOCAL, level="map", places=0, destinations=2), UNSEEN),
    ],
    ids=["position", "table", "local", "shifting", "unseen"],
)
def test_a_model_has_the_same_values_when_it_is_read_again(config, problem, tmp_path):
    scenario_map = draw_training_map(problem, 1)
    ((state, report),) = train(config, problem, scenario_map)
    run = TrainingRun(problem, 1, 0, config, (tuple(report.test_minutes.tolist()),), fingerprint(scenario_map), state)
    checkpoint.save(run, tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["checkpoint.eqx", "model.eqx"]
    model = checkpoint.load_model(tmp_path)
    assert (model.scenario, model.config) == (problem, config)  # lists are tuples again
    assert model.fingerprint == fingerprint(scenario_map)
    values = jax.jit(lambda network, seen: jax.vmap(network)(seen))
    seen = state.walkers.observation
    before = np.asarray(values(run.network, seen))
    np.testing.assert_array_equal(values(model.network, seen), before)
    assert np.ptp(before) > 0
    # and so has the run, whose state is the same
    again = checkpoint.load(tmp_path)
    for read, kept in zip(plain(again.state), plain(state), strict=True):
        np.testing.assert_array_equal(read, kept)


# --- What cannot be read --------------------------------------------------------------------------------------------

BOTH = pytest.mark.parametrize(
    ("read", "name"),
    [(checkpoint.load, "checkpoint.eqx"), (checkpoint.load_model, "model.eqx")],
    ids=["checkpoint", "model"],
)


def change(folder, into, name, edit):
    line, numbers = (folder / name).read_bytes().split(b"\n", 1)
    (into / name).write_bytes(edit(json.loads(line), numbers))


def whole(header, numbers):
    return json.dumps(header).encode() + b"\n" + numbers


@BOTH
@pytest.mark.parametrize(
    ("says", "edit"),
    [
        ("is damaged or cut short", lambda header, numbers: whole(header | {"seed": "x"}, numbers)),
        ("is damaged or cut short", lambda header, numbers: whole(header | {"config": {"colour": 3}}, numbers)),
        ("is damaged or cut short", lambda header, numbers: whole(header, b"\0" * len(numbers))),
        ("is damaged or cut short", lambda header, numbers: whole({"format": header["format"]}, numbers)),
        ("has model format 0; this version reads format 4", lambda head, nums: whole(head | {"format": 0}, nums)),
        ("has model format 2; this version reads format 4", lambda head, nums: whole(head | {"format": 2}, nums)),
        ("has model format 5; this version reads format 4", lambda head, nums: whole(head | {"format": 5}, nums)),
        ("is not a Sidestep model", lambda _, numbers: numbers),
        ("is not a Sidestep model", lambda *_: b""),
        ("is not a Sidestep model", lambda *_: b"[]\n"),
        ("is not a Sidestep model", lambda *_: b"{}\n"),
        ("is not a Sidestep model", lambda *_: b"\x93NUMPY\x01\x00\xff\xfe"),
        ("is not a Sidestep model", lambda *_: b"time,a\n2024-01-01T00,5\n"),
    ],
)
def test_what_cannot_be_read_is_named(saved, tmp_path, read, name, says, edit):
    change(saved[0], tmp_path, name, edit)
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / name} {says}")


@BOTH
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 1.0])
def test_files_cut_short(saved, tmp_path, read, name, share):
    # nothing but the line of JSON, some of the numbers, all but the last byte
    change(saved[0], tmp_path, name, lambda head, numbers: whole(head, numbers[: int(share * (len(numbers) - 1))]))
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / name} is damaged or cut short: ")


@BOTH
@pytest.mark.parametrize("size", [1, 40, 400])
def test_files_cut_short_in_their_description(saved, tmp_path, read, name, size):
    (tmp_path / name).write_bytes((saved[0] / name).read_bytes()[:size])
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert str(caught.value) == f"{tmp_path / name} is not a Sidestep model, or its beginning is damaged"


@BOTH
def test_a_folder_without_a_model(tmp_path, read, name):
    with pytest.raises(CheckpointError, match=rf"no model in {tmp_path}: cannot read {name} \(no such file"):
        read(tmp_path)
    with pytest.raises(CheckpointError, match=f"cannot read {name}"):
        read(tmp_path / "nowhere")
    (tmp_path / name).mkdir()
    with pytest.raises(CheckpointError, match=rf"cannot read {name} \(is a directory"):
        read(tmp_path)


def test_training_does_not_go_on_where_the_map_has_changed(saved, tmp_path):
    # What is left of the file does not matter: states of another map may not fit it.
    change(saved[0], tmp_path, "checkpoint.eqx", lambda head, _: whole(head | {"fingerprint": "of old"}, b""))
    with pytest.raises(CheckpointError) as caught:
        checkpoint.load(tmp_path)
    said = f"the streets or crowds of paper-congested have changed since the model in {tmp_path} was saved;"
    assert str(caught.value) == f"{said} it cannot go on"


def test_each_file_serves_alone(saved, tmp_path):
    (tmp_path / "model.eqx").write_bytes((saved[0] / "model.eqx").read_bytes())
    assert checkpoint.load_model(tmp_path).seed == 4
    with pytest.raises(CheckpointError, match=r"cannot read checkpoint.eqx"):
        checkpoint.load(tmp_path)
