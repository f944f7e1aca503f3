"""Models and training runs on disk: a folder with what was learned, and with what it takes to go on to the bit."""

import json
import math
import os
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from statistics import fmean
from typing import Any, BinaryIO, Literal, TypeVar

import equinox as eqx
import jax
import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from sidestep.agent.config import TrainConfig, settings_by_name
from sidestep.agent.policy import Policy, deployed
from sidestep.agent.q_networks import QNetwork, untrained
from sidestep.agent.train import TrainState, prepare, uniform_draws
from sidestep.arguments import PATH, checked
from sidestep.errors import SidestepError, SidestepWarning
from sidestep.files import reason, whole_file
from sidestep.network.graph import road_network
from sidestep.scenarios.maps import draw_training_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.spec import faults

MODEL = "model.eqx"
FORMAT: Literal[6] = 6
MODEL_FORMATS = (5, FORMAT)
"""Formats of models that can be read: 6 packs the replay, of which a model has none."""
_NUMBERED = re.compile(r"checkpoint-(\d+)\.eqx")
Tree = TypeVar("Tree")
Rest = Callable[[BinaryIO, "Metadata"], Tree]
"""Reads what comes after the first line of a file."""


class CheckpointError(SidestepError):
    """A model folder that cannot be read, or whose training cannot go on."""


class DamagedError(CheckpointError):
    """A file that is damaged or cut short; one of before may be whole."""


class Metadata(BaseModel):
    """What a model was trained on, how, and how its greedy test walks went: the first line of each file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    format: Literal[5, 6] = FORMAT
    """Of the files; other versions of the program may have others."""
    scenario: Scenario
    seed: int
    """Seed of the map, its crowds and the training."""
    map: int
    """Number of the map."""
    config: TrainConfig
    curve: tuple[tuple[float, ...], ...] = ()
    """Minutes of the greedy test walks, round by round."""
    fingerprint: str
    """Of the streets and crowds that were learned."""

    @property
    def settings(self) -> dict[str, Any]:
        """All that the training depends on, by name."""
        return settings_by_name(self.scenario, self.seed, self.map, self.config)

    @property
    def means(self) -> list[float]:
        """Mean of the greedy test walks in minutes, round by round."""
        return [fmean(walks) for walks in self.curve]

    @property
    def finished(self) -> bool:
        """Whether the training is over: all rounds are done, or the test walks have settled."""
        patience, latest = self.config.patience, self.curve[-1 - self.config.patience :]
        settled = 0 < patience < len(latest) and len(set(latest)) == 1
        return len(self.curve) >= self.config.rounds or (settled and max(latest[-1]) < self.scenario.horizon / 60)


@dataclass(frozen=True)
class Model:
    """What was learned."""

    metadata: Metadata
    q_network: QNetwork
    """With the numbers that turn observations into inputs."""

    @property
    def policy(self) -> Policy:
        """The policy that walkers follow, with the margins of the configuration."""
        return deployed(self.metadata.config, self.q_network, self.metadata.scenario.reward.unit_seconds)

    def changed(self, **settings: Any) -> "Model":
        """Copy the model with other settings, such as margins.

        Parameters
        ----------
        **settings
            Fields of :class:`~sidestep.TrainConfig`.

        Returns
        -------
        Model
            With the same network.

        Raises
        ------
        TrainConfigError
            A setting is unknown or out of range.
        """
        config = self.metadata.config.changed(**settings)
        return replace(self, metadata=self.metadata.model_copy(update={"config": config}))


@dataclass(frozen=True)
class Checkpoint:
    """What it takes to go on with a training."""

    metadata: Metadata
    state: TrainState

    @property
    def model(self) -> Model:
        """What was learned so far: the best network in test walks, the last or the mean, as configured."""
        keeps_last = self.metadata.config.keep == "last"
        return Model(self.metadata, self.state.learner.q_network if keeps_last else self.state.kept)


def save(checkpoint: Checkpoint, folder: Path, keep: int = 1) -> None:
    """Write a training into a folder, as ``checkpoint-ROUNDS.eqx`` and ``model.eqx``.

    Each is one line of JSON, the :class:`Metadata`, then the numbers, and is written whole or not at all.

    Parameters
    ----------
    checkpoint, folder
        What is written, and where.
    keep
        How many checkpoints stay, this one included. Those of more rounds go, since they are damaged or of a training
        that this one replaces.
    """
    rounds = len(checkpoint.metadata.curve)
    with whole_file(folder / f"checkpoint-{rounds}.eqx") as temporary:
        _write(temporary, checkpoint.metadata, checkpoint.state)
        # Before the checkpoint has its name: a training that is over by its checkpoint has its last model as well.
        with whole_file(folder / MODEL) as model:
            _write(model, checkpoint.metadata, checkpoint.model.q_network)
    # Only now that it has its name: with the others gone and this one unfinished, nothing could go on.
    there = checkpoints(folder)
    before = [path for path in there if _rounds(path) < rounds]
    for path in there:
        if _rounds(path) > rounds or path in before[keep - 1 :]:
            path.unlink()


def _write(path: Path, metadata: Metadata, tree: Any) -> None:
    written = BytesIO()  # a full disk in the middle of an array would be no OSError to Equinox
    written.write(metadata.model_dump_json().encode() + b"\n")
    eqx.tree_serialise_leaves(written, tree)
    path.write_bytes(written.getbuffer())


def checkpoints(folder: Path) -> list[Path]:
    """List the checkpoints in a folder, the latest first; none where there is no folder."""
    try:
        found = list(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise CheckpointError(f"cannot read {folder}: {reason(error)}", field="folder") from error
    return sorted((path for path in found if _NUMBERED.fullmatch(path.name)), key=_rounds, reverse=True)


def _rounds(path: Path) -> int:
    numbered = _NUMBERED.fullmatch(path.name)
    return int(numbered[1]) if numbered else 0


def load(folder: Path) -> Checkpoint:
    """Read a training back, to go on with it: from its latest checkpoint or, where that is damaged, one before it.

    Parameters
    ----------
    folder
        The folder that :func:`save` wrote.

    Returns
    -------
    Checkpoint
        As it was saved.

    Raises
    ------
    CheckpointError
        The folder holds no training, one of another format, or damaged ones only; or the streets or crowds of its
        scenario have changed.

    Warns
    -----
    SidestepWarning
        A checkpoint is damaged and one before it is read.
    """

    def template(metadata: Metadata) -> TrainState:
        drawn = draw_training_map(metadata.scenario, metadata.seed, metadata.map)
        if drawn.fingerprint != metadata.fingerprint:
            raise CheckpointError(
                f"the streets or crowds of {metadata.scenario.name} have changed since the training in {folder} was "
                "saved; it cannot go on",
                field="fingerprint",
            )
        draws = uniform_draws(metadata.config, [], 0, start=True)
        return prepare.shapes(metadata.config, metadata.scenario, drawn, draws)[-1]

    metadata, state, damaged = _read_latest(folder, _numbers(template))
    for error in damaged:
        said = f"{error}; going on from the checkpoint of round {len(metadata.curve)}"
        warnings.warn(said, SidestepWarning, stacklevel=2)
    return Checkpoint(metadata, state)


@checked(CheckpointError, folder=PATH)
def load_model(folder: Path | str) -> Model:
    """Read what was learned.

    Parameters
    ----------
    folder
        The folder that :func:`sidestep.train` or ``sidestep train --out`` wrote.

    Returns
    -------
    Model
        Its network and :class:`Metadata`; :func:`sidestep.trained_darp` makes a planner of it.

    Raises
    ------
    CheckpointError
        No folder (field ``folder``); it holds no model, one of another format, or a damaged one.

    Examples
    --------
    >>> import sidestep
    >>> sidestep.load_model("nowhere")
    Traceback (most recent call last):
    sidestep.agent.checkpoint.CheckpointError: no model in nowhere: cannot read model.eqx (no such file or directory)
    """

    def template(metadata: Metadata) -> QNetwork:
        config, scenario = metadata.config, metadata.scenario
        # A model that remembers no places can be read without the map that it was trained on.
        network = road_network(np.zeros((2, 2)), [0], [1], [1.0])
        if config.remembers_places:
            network = draw_training_map(scenario, metadata.seed, metadata.map).network
        return jax.eval_shape(partial(untrained, config, scenario), network, jax.random.key(0))

    return Model(*_read(Path(folder) / MODEL, MODEL_FORMATS, _numbers(template)))


def read_metadata(folder: Path) -> Metadata:
    """Read what a training in a folder is of, without its numbers.

    Parameters
    ----------
    folder
        The folder that :func:`save` wrote.

    Returns
    -------
    Metadata
        Of the latest checkpoint, or of the model where there is none. Its ``curve`` has the rounds that were saved.

    Raises
    ------
    CheckpointError
        There is neither, or it cannot be read.
    """
    if not checkpoints(folder):
        return _read(folder / MODEL, MODEL_FORMATS, _pass_over)[0]
    return _read_latest(folder, _pass_over)[0]


def _numbers(template: Callable[[Metadata], Tree]) -> Rest[Tree]:
    """Read the numbers of a file into a tree of such shapes."""
    return lambda file, metadata: eqx.tree_deserialise_leaves(file, template(metadata))


def _pass_over(file: BinaryIO, _metadata: Metadata) -> None:
    """Pass over the arrays of a file, which costs little, to its very end: it may have been cut short."""
    at, size = file.tell(), os.fstat(file.fileno()).st_size
    while at == file.tell() or file.tell() < size:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        file.seek(math.prod(shape) * dtype.itemsize, os.SEEK_CUR)
    if file.tell() > size:
        raise EOFError(f"{file.tell() - size} bytes are missing")


def _read_latest(folder: Path, rest: Rest[Tree]) -> tuple[Metadata, Tree, Sequence[DamagedError]]:
    """Read the latest checkpoint that is whole, and say which later ones are not."""
    damaged: list[DamagedError] = []
    for path in checkpoints(folder):
        try:
            return *_read(path, (FORMAT,), rest), damaged
        except DamagedError as error:
            damaged.append(error)
    if damaged:
        raise damaged[0]
    why = "there is no checkpoint"
    if (folder / MODEL).exists():
        model = _read(folder / MODEL, MODEL_FORMATS, _pass_over)[0]
        done = f"is over after {len(model.curve)} rounds" if model.finished else f"has {len(model.curve)} rounds"
        why = f"it {done} and has no checkpoints any more; use its model, or train anew and --overwrite it"
    raise CheckpointError(f"no training in {folder} that can go on: {why}", field="checkpoint")


def _read(path: Path, known: tuple[int, ...], rest: Rest[Tree]) -> tuple[Metadata, Tree]:
    try:
        file = path.open("rb")
    except OSError as error:
        said = f"no model in {path.parent}: cannot read {path.name} ({reason(error)})"
        raise CheckpointError(said, field=path.name) from error
    with file:
        header = file.readline()
        _check_format(path, header, known)
        try:
            metadata = Metadata.model_validate_json(header)
            return metadata, rest(file, metadata)
        except ValidationError as error:
            place, said = faults(error, Metadata)[0]
            raise DamagedError(f"{path} is damaged: {said}", field=".".join(place)) from error
        except SidestepError:
            raise
        except Exception as error:  # whatever a damaged file makes the reader say
            raise DamagedError(f"{path} is damaged or cut short: {error or type(error).__name__}") from error


def _check_format(path: Path, header: bytes, known: tuple[int, ...]) -> None:
    try:
        version = json.loads(header)["format"]
    except (ValueError, KeyError, TypeError) as error:
        raise DamagedError(f"{path} is not a Sidestep model, or its beginning is damaged", field="format") from error
    if version not in known:
        raise CheckpointError(
            f"{path} has format {version}, and this version reads {' and '.join(map(str, known))}; train it again",
            field="format",
        )
