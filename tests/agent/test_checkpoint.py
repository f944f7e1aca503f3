"""Models and training runs on disk: what is loaded is what was saved, and what cannot be read is named."""

import json
import os
import resource
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import Checkpoint, CheckpointError, Metadata
from sidestep.agent.config import TrainConfig
from sidestep.agent.presets import PRESETS, preset
from sidestep.agent.q_networks import QNetwork
from sidestep.agent.train import TrainState, prepare, uniform_draws
from sidestep.environment.types import Observation
from sidestep.errors import SidestepWarning
from sidestep.files import OutputError
from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.maps import draw_training_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.walkers import ADULT

CONFIG = PRESETS["default"].changed(rounds=3, round_steps=64, walkers=8, batch=16, capacity=256, hidden=(8,))
LOCAL = preset("default", "local").changed(
    rounds=1, round_steps=32, walkers=8, batch=16, capacity=64, hidden=(8,), places=2,
    n_step=2, futures=4, fresh_futures=2, test_walks=2,
)  # fmt: skip
PROBLEM = scenario("paper-congested", side=3, crowded_nodes=1)
SHIFTING = scenario("shifting-crowds", side=3, crowded_nodes=1, horizon=3600.0)
UNSEEN = scenario("unseen-maps", side=3, larger=(4,), crowded_nodes=1, training_maps=2, horizon=3600.0)


def as_if_trained(config: TrainConfig, problem: Scenario, seed: int = 4, index: int = 2) -> Checkpoint:
    """A training whose state has random numbers everywhere."""
    drawn = draw_training_map(problem, seed, index)
    _, _, state = prepare(config, problem, drawn, uniform_draws(config, [], 0, start=True))
    rng = np.random.default_rng(0)

    def shaken(leaf: jax.Array) -> jax.Array:
        if leaf.dtype == bool:
            return leaf
        return jax.device_put((np.asarray(leaf) + rng.integers(1, 9, leaf.shape) / 8).astype(leaf.dtype))

    learner = jax.tree.map(shaken, state.learner)
    state = eqx.tree_at(lambda s: (s.learner, s.kept, s.iteration), state, (learner, learner.target, jnp.int32(8)))
    metadata = Metadata(
        scenario=problem, seed=seed, map=index, config=config, curve=((7.0, 8.25),), fingerprint=drawn.fingerprint
    )
    return Checkpoint(metadata, state)


def plain(state: TrainState | QNetwork) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(state)]


@eqx.filter_jit
def values(network: QNetwork, seen: Observation) -> jax.Array:
    return jax.vmap(network)(seen)


@pytest.mark.parametrize(
    ("config", "problem"),
    [
        (CONFIG.changed(keep="best"), PROBLEM),
        (PRESETS["tabular-q"].changed(rounds=1, round_steps=640), PROBLEM),
        (LOCAL, SHIFTING),
        (LOCAL.changed(level="map", places=0, destinations=2), UNSEEN),
    ],
    ids=["position", "table", "local", "unseen"],
)
def test_what_is_read_is_what_was_saved(config: TrainConfig, problem: Scenario, tmp_path: Path) -> None:
    saved = as_if_trained(config, problem)
    checkpoint.save(saved, tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["checkpoint-1.eqx", "model.eqx"]
    model, again = checkpoint.load_model(tmp_path), checkpoint.load(tmp_path)
    assert model.metadata == again.metadata == saved.metadata  # lists are tuples again
    assert checkpoint.read_metadata(tmp_path) == saved.metadata
    assert jax.tree.structure((model.q_network, again.state)) == jax.tree.structure(
        (saved.model.q_network, saved.state)
    )
    for read, kept in ((model.q_network, saved.model.q_network), (again.state, saved.state)):
        for one, other in zip(plain(read), plain(kept), strict=True):
            np.testing.assert_array_equal(one, other, strict=True)
    # and so it decides as before
    seen = saved.state.walkers.observation
    before, after = (values(one.q_network, seen) for one in (saved.model, model))
    np.testing.assert_array_equal(before, after)
    assert np.ptp(before) > 0


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Checkpoint]:
    folder = tmp_path_factory.mktemp("model")
    trained = as_if_trained(CONFIG, PROBLEM)
    checkpoint.save(trained, folder)
    return folder, trained


def test_a_model_is_the_network_that_the_configuration_keeps(saved: tuple[Path, Checkpoint]) -> None:
    _, trained = saved
    for keep, kept in (
        ("last", trained.state.learner.q_network),
        ("best", trained.state.kept),
        ("mean", trained.state.kept),
    ):
        metadata = trained.metadata.model_copy(update={"config": CONFIG.changed(keep=keep)})
        assert Checkpoint(metadata, trained.state).model.q_network is kept


def test_margins_can_be_changed_after_training() -> None:
    config = LOCAL.changed(correction_margin_seconds=30.0, estimate_when_revisiting=True)
    model = as_if_trained(config, SHIFTING).model
    assert (model.policy.margin, model.policy.estimate_when_revisiting) == (0.5, True)
    without = model.changed(correction_margin_seconds=0.0, estimate_when_revisiting=False)
    assert (without.policy.margin, without.policy.estimate_when_revisiting) == (0, False)
    assert without.q_network is model.q_network
    assert without.metadata.map == model.metadata.map


@pytest.mark.parametrize("name", BUILT_IN)
def test_metadata_there_and_back_through_json(name: str) -> None:
    metadata = Metadata(scenario=BUILT_IN[name], seed=1, map=2, config=CONFIG, curve=((1.0, 2.5),), fingerprint="a")
    assert Metadata.model_validate_json(metadata.model_dump_json()) == metadata


def test_models_from_before_there_were_walkers_learned_for_the_adult(saved, tmp_path) -> None:
    folder, trained = saved

    def before(header, numbers):
        del header["scenario"]["walker"]
        return json.dumps(header).encode() + b"\n" + numbers

    for name in ("checkpoint-1.eqx", "model.eqx"):
        line, numbers = (folder / name).read_bytes().split(b"\n", 1)
        (tmp_path / name).write_bytes(before(json.loads(line), numbers))
    for found in (checkpoint.load_model(tmp_path), checkpoint.load(tmp_path)):
        assert found.metadata == trained.metadata
        assert found.metadata.scenario.walker == ADULT


def test_models_from_before_replays_were_packed_are_read_and_their_trainings_refused(saved, tmp_path):
    for name in ("checkpoint-1.eqx", "model.eqx"):
        change(saved[0], tmp_path, name, lambda head, numbers: whole(head | {"format": 5}, numbers))
    assert eqx.tree_equal(checkpoint.load_model(tmp_path).q_network, saved[1].model.q_network)
    with pytest.raises(CheckpointError) as caught:
        checkpoint.load(tmp_path)
    assert caught.value.field == "format"


# --- What cannot be read --------------------------------------------------------------------------------------------

BOTH = pytest.mark.parametrize(
    ("read", "name"),
    [(checkpoint.load, "checkpoint-1.eqx"), (checkpoint.load_model, "model.eqx")],
    ids=["checkpoint", "model"],
)


def change(folder, into, name, edit):
    line, numbers = (folder / name).read_bytes().split(b"\n", 1)
    (into / name).write_bytes(edit(json.loads(line), numbers))


def whole(header, numbers):
    return json.dumps(header).encode() + b"\n" + numbers


def edited(header, part, **changes):
    return header | {part: header[part] | changes}


@BOTH
@pytest.mark.parametrize(
    ("field", "edit"),
    [
        ("seed", lambda header, numbers: whole(header | {"seed": "x"}, numbers)),
        ("config.colour", lambda header, numbers: whole(edited(header, "config", colour=3), numbers)),
        ("config.gamma", lambda header, numbers: whole(edited(header, "config", gamma=2.0), numbers)),
        ("config.n_step", lambda header, numbers: whole(edited(header, "config", n_step=1_000), numbers)),
        ("colour", lambda header, numbers: whole(header | {"colour": "red"}, numbers)),
        ("curve", lambda header, numbers: whole(header | {"curve": 3}, numbers)),
        ("scenario", lambda header, numbers: whole({"format": header["format"]}, numbers)),
        (None, lambda header, numbers: whole(header, b"\0" * len(numbers))),
        ("format", lambda head, nums: whole(head | {"format": 0}, nums)),
        ("format", lambda head, nums: whole(head | {"format": 4}, nums)),
        ("format", lambda head, nums: whole(head | {"format": 7}, nums)),
        ("format", lambda head, nums: whole(head | {"format": "6"}, nums)),
        ("format", lambda _, numbers: numbers),
        ("format", lambda *_: b""),
        ("format", lambda *_: b"[]\n"),
        ("format", lambda *_: b"{}\n"),
        ("format", lambda *_: b"\x93NUMPY\x01\x00\xff\xfe"),
        ("format", lambda *_: b"time,a\n2024-01-01T00,5\n"),
    ],
)
def test_what_cannot_be_read_is_named(saved, tmp_path, read, name, field, edit):
    change(saved[0], tmp_path, name, edit)
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert caught.value.field == field
    assert str(caught.value).startswith(f"{tmp_path / name} ")
    assert len(str(caught.value).splitlines()) == 1


@BOTH
@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 1.0])
def test_files_cut_short(saved, tmp_path, read, name, share):
    # nothing but the line of JSON, some of the numbers, all but the last byte
    change(saved[0], tmp_path, name, lambda head, numbers: whole(head, numbers[: int(share * (len(numbers) - 1))]))
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / name} ")
    assert caught.value.field is None


@BOTH
@pytest.mark.parametrize("size", [1, 40, 400])
def test_files_cut_short_in_their_description(saved, tmp_path, read, name, size):
    (tmp_path / name).write_bytes((saved[0] / name).read_bytes()[:size])
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert caught.value.field == "format"


@BOTH
def test_a_folder_without_a_model(tmp_path, read, name):
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(CheckpointError) as caught:
            read(folder)
        assert caught.value.field == ("checkpoint" if read is checkpoint.load else name)
    (tmp_path / name).mkdir()
    with pytest.raises(CheckpointError) as caught:
        read(tmp_path)
    assert caught.value.field == name


def test_training_does_not_go_on_where_the_map_has_changed(saved, tmp_path):
    # What is left of the file does not matter: states of another map may not fit it.
    change(saved[0], tmp_path, "checkpoint-1.eqx", lambda head, _: whole(head | {"fingerprint": "of old"}, b""))
    with pytest.raises(CheckpointError) as caught:
        checkpoint.load(tmp_path)
    assert caught.value.field == "fingerprint"


def test_each_file_serves_alone(saved, tmp_path):
    (tmp_path / "model.eqx").write_bytes((saved[0] / "model.eqx").read_bytes())
    assert checkpoint.load_model(tmp_path).metadata.seed == 4
    with pytest.raises(CheckpointError) as caught:
        checkpoint.load(tmp_path)
    assert caught.value.field == "checkpoint"


# --- Several checkpoints --------------------------------------------------------------------------------------------


def after(rounds: int, trained: Checkpoint) -> Checkpoint:
    curve = tuple((float(number),) for number in range(rounds))
    return Checkpoint(trained.metadata.model_copy(update={"curve": curve}), trained.state)


def names(folder: Path) -> list[str]:
    return [path.name for path in checkpoint.checkpoints(folder)]


def test_the_latest_checkpoints_stay(saved, tmp_path):
    assert names(tmp_path / "nowhere") == []
    for rounds in (1, 9, 10, 11):
        checkpoint.save(after(rounds, saved[1]), tmp_path, keep=3)
    assert names(tmp_path) == ["checkpoint-11.eqx", "checkpoint-10.eqx", "checkpoint-9.eqx"]
    assert len(checkpoint.load(tmp_path).metadata.curve) == len(checkpoint.read_metadata(tmp_path).curve) == 11
    # Those of more rounds are of a training that is replaced.
    checkpoint.save(after(10, saved[1]), tmp_path, keep=1)
    assert names(tmp_path) == ["checkpoint-10.eqx"]


def test_a_checkpoint_goes_once_another_has_its_name(saved, tmp_path, monkeypatch):
    checkpoint.save(after(1, saved[1]), tmp_path)

    def fail(*_: object) -> None:
        raise OSError

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError):
        checkpoint.save(after(2, saved[1]), tmp_path)
    assert names(tmp_path) == ["checkpoint-1.eqx"]


@pytest.mark.parametrize("size", [0, 40, 3_000, -1])
def test_a_damaged_checkpoint_falls_back_to_the_one_before(saved, tmp_path, size):
    for rounds in (1, 2, 3):
        checkpoint.save(after(rounds, saved[1]), tmp_path, keep=3)
    for number in (3, 2):
        latest = tmp_path / f"checkpoint-{number}.eqx"
        latest.write_bytes(latest.read_bytes()[:size])
        with pytest.warns(SidestepWarning) as told:
            found = checkpoint.load(tmp_path)
        assert len(told) == 4 - number
        assert str(latest) in str(told[-1].message)
        assert len(found.metadata.curve) == number - 1
    checkpoint.save(after(2, saved[1]), tmp_path, keep=2)
    assert names(tmp_path) == ["checkpoint-2.eqx", "checkpoint-1.eqx"]
    for path in checkpoint.checkpoints(tmp_path):
        path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(CheckpointError, match=r"checkpoint-2\.eqx"):
        checkpoint.load(tmp_path)


def test_there_is_no_way_back_from_another_format(saved, tmp_path):
    for rounds in (1, 2):
        checkpoint.save(after(rounds, saved[1]), tmp_path, keep=2)
    latest = tmp_path / "checkpoint-2.eqx"
    line, numbers = latest.read_bytes().split(b"\n", 1)
    latest.write_bytes(whole(json.loads(line) | {"format": 5}, numbers))
    with pytest.raises(CheckpointError) as caught:
        checkpoint.load(tmp_path)
    assert caught.value.field == "format"


@pytest.mark.parametrize("rounds", [1, 8])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9, None])
def test_a_full_disk_leaves_all_as_it_was(saved, tmp_path, rounds, share):
    for earlier in (6, 7):
        checkpoint.save(after(earlier, saved[1]), tmp_path, keep=2)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    if share is None:  # full once the checkpoint is written
        (tmp_path / f".model.eqx.{os.getpid()}.part").symlink_to("/dev/full")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    limit = soft if share is None else int(share * len(before["checkpoint-7.eqx"]))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        with pytest.raises(OutputError):
            checkpoint.save(after(rounds, saved[1]), tmp_path, keep=2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_training_that_is_killed_as_it_saves_its_last_round_goes_on_to_the_end(saved, tmp_path):
    checkpoint.save(after(2, saved[1]), tmp_path)
    (tmp_path / "checkpoint-3.eqx").mkdir()  # a checkpoint that can't get its name
    with pytest.raises(OutputError):
        checkpoint.save(after(3, saved[1]), tmp_path)
    (tmp_path / "checkpoint-3.eqx").rmdir()
    # Not a checkpoint of all rounds beside a model of fewer: then there would be nothing to go on with.
    assert [len(read.metadata.curve) for read in (checkpoint.load_model(tmp_path), checkpoint.load(tmp_path))] == [3, 2]
