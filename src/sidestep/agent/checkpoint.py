"""Models and training runs on disk: a folder with what was learned, and with what it takes to go on to the bit."""

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import equinox as eqx
import jax
import numpy as np

from sidestep.agent.config import TrainConfig
from sidestep.agent.train import QNetwork, TrainState, fresh_network, learned_place, prepare, selected_params
from sidestep.errors import SidestepError
from sidestep.files import reason, whole_file
from sidestep.network.graph import RoadNetwork, road_network
from sidestep.scenarios.maps import draw_training_map
from sidestep.scenarios.model import Scenario

FORMAT = 4
MODEL = "model.eqx"
CHECKPOINT = "checkpoint.eqx"
Tree = TypeVar("Tree")


class CheckpointError(SidestepError):
    """A model folder that cannot be used: says why."""


@dataclass(frozen=True)
class Training:
    """A training so far: on which map of which scenario, how, and how its greedy test walks went."""

    scenario: Scenario
    seed: int
    index: int  # of the map
    config: TrainConfig
    curve: tuple[tuple[float, ...], ...]  # minutes of the greedy test walks, round by round
    fingerprint: str  # of the map that is learned


@dataclass(frozen=True)
class Model(Training):
    """What was learned."""

    network: QNetwork  # with the numbers that turn observations into inputs


@dataclass(frozen=True)
class TrainingRun(Training):
    """What it takes to go on."""

    state: TrainState

    @property
    def network(self) -> QNetwork:
        """The network that this run has to show."""
        return selected_params(self.config, self.state)


def save(run: TrainingRun, folder: Path) -> None:
    """Write a run into a folder, as ``model.eqx`` and ``checkpoint.eqx``.

    Each is one line of JSON that describes it, then the numbers.
    """
    header = {
        "format": FORMAT,
        "scenario": run.scenario.model_dump(),
        "seed": run.seed,
        "index": run.index,
        "config": dataclasses.asdict(run.config),
        "curve": run.curve,
        "fingerprint": run.fingerprint,
    }
    for name, tree in ((CHECKPOINT, _plain(run.state)), (MODEL, run.network)):
        with whole_file(folder / name) as temporary, temporary.open("wb") as file:
            file.write(json.dumps(header).encode() + b"\n")
            eqx.tree_serialise_leaves(file, tree)


def load(folder: Path) -> TrainingRun:
    """Read a run back, to go on with it.

    Raises
    ------
    CheckpointError
        The folder holds no run, one of another format, or a damaged one; streets or crowds that are others by now.
    """

    def template(run: Training) -> TrainState:
        drawn = draw_training_map(run.scenario, run.seed, run.index)
        if drawn.fingerprint != run.fingerprint:
            raise CheckpointError(
                f"the streets or crowds of {run.scenario.name} have changed since the model in {folder} was saved; "
                "it cannot go on"
            )
        scenario_map = learned_place(run.config, run.scenario, drawn)
        return jax.eval_shape(lambda here: _plain(prepare(run.config, run.scenario, here)[1]), scenario_map)

    training, state = _read(folder, CHECKPOINT, template)
    return TrainingRun(**_fields(training), state=_keyed(state))


def load_model(folder: Path) -> Model:
    """Read what was learned.

    Raises
    ------
    CheckpointError
        The folder holds no model, one of another format, or a damaged one.
    """

    def template(run: Training) -> QNetwork:
        # A model that remembers no places can be read without the map that it was trained on.
        bound = run.config.level == "position" or run.config.places
        network = draw_training_map(run.scenario, run.seed, run.index).network if bound else _any_streets()
        return jax.eval_shape(partial(fresh_network, run.config, run.scenario), network, jax.random.key(0))

    training, network = _read(folder, MODEL, template)
    return Model(**_fields(training), network=network)


def _any_streets() -> RoadNetwork:
    return road_network(np.zeros((2, 2)), [0], [1], [1.0])


def _read(folder: Path, name: str, template: Callable[[Training], Tree]) -> tuple[Training, Tree]:
    path = folder / name
    try:
        file = path.open("rb")
    except OSError as error:
        raise CheckpointError(f"no model in {folder}: cannot read {name} ({reason(error)})") from error
    with file:
        try:
            header = json.loads(file.readline())
            version = header["format"]
        except (ValueError, KeyError, TypeError) as error:
            raise CheckpointError(f"{path} is not a Sidestep model, or its beginning is damaged") from error
        if version != FORMAT:
            raise CheckpointError(f"{path} has model format {version}; this version reads format {FORMAT}")
        try:
            training = Training(
                scenario=Scenario.model_validate_json(json.dumps(header["scenario"])),
                seed=int(header["seed"]),
                index=int(header["index"]),
                config=_revived(TrainConfig, header["config"]),
                curve=tuple(tuple(map(float, walks)) for walks in header["curve"]),
                fingerprint=str(header["fingerprint"]),
            )
            tree = eqx.tree_deserialise_leaves(file, template(training))
        except SidestepError:
            raise
        except Exception as error:  # whatever a damaged file makes the reader say
            raise CheckpointError(f"{path} is damaged or cut short: {error or type(error).__name__}") from error
    return training, tree


def _fields(training: Training) -> dict[str, Any]:
    return {field.name: getattr(training, field.name) for field in dataclasses.fields(training)}


def _plain(state: TrainState) -> TrainState:
    """The state with its random key as plain numbers, which is all that files can hold."""
    return eqx.tree_at(lambda s: s.key, state, jax.random.key_data(state.key))


def _keyed(state: TrainState) -> TrainState:
    return eqx.tree_at(lambda s: s.key, state, jax.random.wrap_key_data(state.key))


def _revived(kind: Any, value: Any) -> Any:
    """What JSON made of a dataclass of a ``kind``, or of one of its values, as it was.

    Dataclasses come back as objects and tuples as lists, however deep one is in the other.
    """
    kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if isinstance(value, dict):
        (made,) = (one for one in kinds if dataclasses.is_dataclass(one))
        hints = get_type_hints(made)
        return made(**{name: _revived(hints.get(name, object), item) for name, item in value.items()})  # type: ignore[operator]
    if isinstance(value, list):
        (row,) = (get_args(one) for one in kinds if get_origin(one) is tuple)
        items = row[:1] * len(value) if row[1:] == (...,) else row
        return tuple(_revived(item_kind, item) for item_kind, item in zip(items, value, strict=True))
    return value
