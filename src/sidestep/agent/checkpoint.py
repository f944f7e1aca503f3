"""Training runs on disk: save, load, resume to the bit."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax

from sidestep.agent.config import TrainConfig
from sidestep.agent.qnetwork import DuelingQNetwork
from sidestep.agent.train import TrainState, prepare, shown
from sidestep.environment.types import RewardWeights
from sidestep.errors import SidestepError
from sidestep.files import reason, whole_file
from sidestep.scenarios import Scenario, draw_map

FORMAT = 1
FILE = "checkpoint.eqx"


class CheckpointError(SidestepError):
    """A model folder that cannot be used: says why."""


@dataclass(frozen=True)
class TrainingRun:
    """A training run so far: on which map of which scenario, how, and where it stands."""

    scenario: Scenario
    seed: int
    index: int  # of the map
    config: TrainConfig
    curve: tuple[tuple[float, ...], ...]  # minutes of the greedy test walks, round by round
    state: TrainState

    @property
    def network(self) -> DuelingQNetwork:
        """The network that this run has to show."""
        return shown(self.config, self.state)


def save(run: TrainingRun, folder: Path) -> None:
    """Write a run into a folder: one line of JSON that describes it, then the numbers."""
    header = {
        "format": FORMAT,
        "scenario": dataclasses.asdict(run.scenario),
        "seed": run.seed,
        "index": run.index,
        "config": dataclasses.asdict(run.config),
        "curve": run.curve,
    }
    with whole_file(folder / FILE) as temporary, temporary.open("wb") as file:
        file.write(json.dumps(header).encode() + b"\n")
        eqx.tree_serialise_leaves(file, _plain(run.state))


def load(folder: Path) -> TrainingRun:
    """Read a run back.

    Raises
    ------
    CheckpointError
        The folder holds no model, one of another format, or a damaged one.
    """
    path = folder / FILE
    try:
        file = path.open("rb")
    except OSError as error:
        raise CheckpointError(f"no model in {folder}: cannot read {FILE} ({reason(error)})") from error
    with file:
        try:
            header = json.loads(file.readline())
            version = header["format"]
        except (ValueError, KeyError, TypeError) as error:
            raise CheckpointError(f"{path} is not a Sidestep model, or its beginning is damaged") from error
        if version != FORMAT:
            raise CheckpointError(f"{path} has model format {version}; this version reads format {FORMAT}")
        try:
            scenario, config = _scenario(header["scenario"]), _config(header["config"])
            seed, index = int(header["seed"]), int(header["index"])
            place = draw_map(scenario, seed, index)
            template = jax.eval_shape(lambda place: _plain(prepare(config, scenario, place)[1]), place)
            state = eqx.tree_deserialise_leaves(file, template)
            curve = tuple(tuple(map(float, walks)) for walks in header["curve"])
        except SidestepError:
            raise
        except Exception as error:  # whatever a damaged file makes the reader say
            raise CheckpointError(f"{path} is damaged or cut short: {error or type(error).__name__}") from error
    return TrainingRun(scenario, seed, index, config, curve, _keyed(state))


def _plain(state: TrainState) -> TrainState:
    """The state with its random key as plain numbers, which is all that files can hold."""
    return eqx.tree_at(lambda s: s.key, state, jax.random.key_data(state.key))


def _keyed(state: TrainState) -> TrainState:
    return eqx.tree_at(lambda s: s.key, state, jax.random.wrap_key_data(state.key))


def _scenario(fields: dict[str, object]) -> Scenario:
    reward = RewardWeights(**fields.pop("reward"))  # type: ignore[arg-type]
    return Scenario(**{name: _tuples(value) for name, value in fields.items()}, reward=reward)  # type: ignore[arg-type]


def _config(fields: dict[str, object]) -> TrainConfig:
    return TrainConfig(**{name: _tuples(value) for name, value in fields.items()})  # type: ignore[arg-type]


def _tuples(value: object) -> object:
    """JSON's lists as the tuples that they were."""
    return tuple(value) if isinstance(value, list) else value
