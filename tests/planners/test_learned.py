"""Models as planners: which maps each of them can walk, and to where; agents that are trained before they walk."""

from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import CheckpointError, Metadata, Model
from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.agent.policy import Policy
from sidestep.agent.presets import PRESETS, preset, preset_for
from sidestep.agent.q_networks import QTable, untrained
from sidestep.planners import learned
from sidestep.planners.learned import Darp, ModelError, load_planners, trainable, trained_darp
from sidestep.scenarios import maps
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import destinations_of
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.walkers import Older

GRID = scenario("paper-congested", side=3, crowded_nodes=1)
TOWN = scenario("helsinki")
SMALL = {"round_steps": 8, "walkers": 4, "batch": 4, "capacity": 8, "hidden": (4,), "n_step": 1}
POSITION = PRESETS["default"].changed(**SMALL)
PLACES = preset("default", "local").changed(**SMALL, destinations=2, futures=2, fresh_futures=0, test_walks=2)
ANYWHERE = PLACES.changed(places=0, level="map")
IN_TOWN = preset_for(TOWN, "default").changed(**SMALL)


def save(
    folder: Path,
    config: TrainConfig,
    problem: Scenario,
    index: int = 0,
    fingerprint: str = "",
    known_as: Scenario | None = None,
) -> Path:
    """A model as it is saved; what it has learned does not matter."""
    q_network = untrained(config, problem, draw_map(problem, 0, index).network, jax.random.key(0))
    metadata = Metadata(
        scenario=known_as or problem, seed=0, map=index, config=config, curve=((7.0, 8.0),), fingerprint=fingerprint
    )
    folder.mkdir(exist_ok=True)
    with (folder / checkpoint.MODEL).open("wb") as file:
        file.write(metadata.model_dump_json().encode() + b"\n")
        eqx.tree_serialise_leaves(file, q_network)
    return folder


def test_a_model_walks_as_darp(tmp_path: Path) -> None:
    found = load_planners([save(tmp_path, ANYWHERE, GRID)], GRID, 5)
    assert list(found.planners) == ["darp"]
    darp = found.planners["darp"]
    assert isinstance(darp, Darp)
    assert (darp.level, darp.observes, darp.curve.tolist()) == ("map", "map", [[7, 8]])
    # It remembers no places, so it walks any map, to anywhere.
    assert (found.index, found.destinations) == (None, None)
    found.check_destination(3)


def test_margins_come_with_the_model() -> None:
    metadata = Metadata(scenario=TOWN, seed=0, map=0, config=IN_TOWN, curve=((7.0,),), fingerprint="")
    model = Model(metadata, untrained(IN_TOWN, TOWN, draw_map(TOWN, 0).network, jax.random.key(0)))
    assert trained_darp(model).policy.margin == pytest.approx(3 / 60)
    assert trained_darp(model).policy.estimate_when_revisiting
    without = model.changed(correction_margin_seconds=0.0, estimate_when_revisiting=False)
    assert trained_darp(without).policy.margin == 0
    assert not trained_darp(without).policy.estimate_when_revisiting


def test_a_model_of_places_walks_its_own_map(tmp_path: Path) -> None:
    folder = save(tmp_path, PLACES, GRID, index=2, fingerprint=draw_map(GRID, 0, 2).fingerprint)
    found = load_planners([folder], GRID, 0)
    ends = destinations_of(draw_map(GRID, 0, 2), 2).ravel().tolist()
    assert (found.index, found.destinations) == (2, frozenset(ends))
    found.check_destinations(draw_map(GRID, 0, 2), 2)
    with pytest.raises(ModelError) as caught:
        found.check_destinations(draw_map(GRID, 0, 2), 3)
    assert caught.value.field == "destination"
    # Of another seed, and of another size.
    for problem, seed in ((GRID, 1), (scenario("paper-congested"), 0)):
        with pytest.raises(ModelError) as caught:
            load_planners([folder], problem, seed)
        assert caught.value.field == "fingerprint"


def test_several_models_are_called_by_their_folders(tmp_path: Path) -> None:
    first = save(tmp_path / "a", POSITION, GRID, fingerprint=draw_map(GRID, 0).fingerprint)
    second = save(tmp_path / "b", PLACES, GRID, fingerprint=draw_map(GRID, 0).fingerprint)
    found = load_planners([first, second], GRID, 0)
    assert list(found.planners) == ["darp-a", "darp-b"]
    assert (found.index, found.destinations) == (0, frozenset([8]))  # what both of them learned
    elsewhere = save(tmp_path / "c", PLACES, GRID, index=1, fingerprint=draw_map(GRID, 0, 1).fingerprint)
    (tmp_path / "d").mkdir()
    again = save(tmp_path / "d" / "a", ANYWHERE, GRID)
    for folders, field in (([first, elsewhere], "map"), ([first, again], "model")):
        with pytest.raises(ModelError) as caught:
            load_planners(folders, GRID, 0)
        assert caught.value.field == field


@pytest.mark.parametrize(
    ("config", "trained_on", "walks", "level", "field"),
    [
        (ANYWHERE, GRID, GRID, "live", "level"),
        (ANYWHERE, GRID.changed(objective={"exposure": 0.5}), GRID, None, "objective"),
        (ANYWHERE, GRID, GRID.changed(objective={"exposure": 0.5}), None, "objective"),
        (ANYWHERE, GRID.changed(walker="older"), GRID, None, "walker"),
        (ANYWHERE, GRID, GRID.changed(walker=Older(free_speed=1.34)), None, "walker"),
        (IN_TOWN, TOWN, scenario("unseen-maps"), None, "scenario"),
        (ANYWHERE, GRID, TOWN, None, "scenario"),
    ],
)
def test_models_walk_what_they_were_trained_for(
    tmp_path: Path, config: TrainConfig, trained_on: Scenario, walks: Scenario, level: Any, field: str
) -> None:
    save(tmp_path, config, trained_on)
    with pytest.raises(ModelError) as caught:
        load_planners([tmp_path], walks, 0, level)
    assert caught.value.field == field
    # And there they do walk.
    assert load_planners([tmp_path], trained_on, 0, config.level).index is None


def test_a_model_can_be_read_where_its_files_are_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = TOWN.changed(streets=str(tmp_path / "gone.npz"), file=str(tmp_path / "gone.csv"), destinations=(3,))
    save(tmp_path, IN_TOWN, TOWN, known_as=gone)
    metres = float(jnp.mean(draw_map(TOWN, 0).network.length))

    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr(checkpoint, "draw_training_map", never)
    monkeypatch.setattr(maps, "town_of", never)
    model = checkpoint.load_model(tmp_path)
    assert (model.metadata.scenario, model.metadata.config) == (gone, IN_TOWN)
    # It has the numbers of its own town's streets, not those that it was read with.
    assert float(model.q_network.metres) == pytest.approx(metres)


def test_a_folder_without_a_model_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError) as caught:
        load_planners([tmp_path], GRID, 0)
    assert caught.value.field == "model.eqx"


# --- Trained before they walk ---------------------------------------------------------------------------------------


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[TrainConfig, int, int]]:
    """What is asked to be trained: how, with which seed, and on which map."""
    runs: list[tuple[TrainConfig, int, int]] = []

    nobody = Darp(Policy(QTable(jnp.zeros((9, 4)))), np.zeros((1, 1)))

    class Run:
        model = None

    def train(_scenario: Scenario, config: TrainConfig, *, seed: int, index: int) -> Run:
        runs.append((config, seed, index))
        return Run()

    monkeypatch.setattr(learned, "train", train)
    monkeypatch.setattr(learned, "trained_darp", lambda _model: nobody)
    return runs


def test_agents_learn_each_map_once(asked: list[tuple[TrainConfig, int, int]]) -> None:
    factory = trainable(GRID, 4, "local", "default", destinations=2)
    for index in (0, 1, 0):
        factory(draw_map(GRID, 4, index), index)
    config = preset("default", "local").changed(destinations=2)
    assert asked == [(config, 4, 0), (config, 4, 1)]


def test_training_maps_are_learned_once_for_all(asked: list[tuple[TrainConfig, int, int]]) -> None:
    unseen = scenario("unseen-maps")
    factory = trainable(unseen, 0, "map", "dqn")
    for index in (0, 3):
        factory(draw_map(unseen, 0, index), index)
    # As many destinations as the preset has.
    assert asked == [(preset_for(unseen, "dqn", "map"), 0, 0)]
    assert asked[0][0].destinations == 4


@pytest.mark.parametrize(
    ("problem", "level", "name", "destinations", "field"),
    [
        (TOWN, "position", "default", 1, "level"),
        (TOWN, "position", "tabular-q", 1, "level"),
        (scenario("unseen-maps"), "position", "tabular-q", 1, "level"),
        (GRID, "position", "tabular-q", 2, "destinations"),
        (GRID, "local", "paper", 1, "preset"),
    ],
)
def test_what_cannot_be_learned_is_refused(
    problem: Scenario, level: Any, name: Any, destinations: int, field: str
) -> None:
    with pytest.raises(TrainConfigError) as caught:
        trainable(problem, 0, level, name, destinations)
    assert caught.value.field == field
