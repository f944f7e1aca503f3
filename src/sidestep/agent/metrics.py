"""How a training goes, round by round: a file of JSON lines, whose lock keeps other trainings out of its folder."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from sidestep.agent.checkpoint import CheckpointError
from sidestep.files import append, locked, only_one

METRICS = "metrics.jsonl"


class RoundMetrics(BaseModel):
    """One line of ``metrics.jsonl``: how a training stands after a round. What is not finite is null."""

    model_config = ConfigDict(frozen=True)

    round: int
    """Number of the round, from 1."""
    steps: int
    """Environment steps so far."""
    seconds: float
    """Time spent on these rounds, s, also by processes before this one; not on rounds that were lost."""
    loss: float | None
    """Mean over the round's gradient steps, reward²."""
    td_error: float | None
    """Mean size of temporal-difference errors over the round's batches, in units of reward."""
    q: float | None
    """Mean value of the exits taken in the round's batches, in units of reward."""
    epsilon: float
    """Share of random steps as the round ended."""
    minutes: float
    """Mean of the greedy test walks, min; of cost where the objective is not time alone."""
    gap: float | None
    """Mean of the test walks over that of the clairvoyant's, less 1; null where that is not known."""
    arrival_rate: float
    """Share of the test walks that arrived."""
    steps_per_second: float
    """Environment steps a second since the training was started or resumed, without the first round, which waits for
    the compiler."""
    updates_per_second: float
    """Gradient steps a second."""


class MetricsFile:
    """The open ``metrics.jsonl`` of a training under way."""

    def __init__(self, path: Path, file: FileIO) -> None:
        self._path, self._file = path, file

    def cut(self, means: Sequence[float]) -> list[RoundMetrics]:
        """Take away all lines from the first one on that is torn or not of the training that goes on.

        Parameters
        ----------
        means
            Minutes of the test walks after each round that is done.

        Returns
        -------
        list of RoundMetrics
            The lines that stay.
        """
        kept, end = [], 0
        for line in self._path.read_bytes().splitlines(keepends=True):
            found = _parsed(line)
            if found is None or found.round > len(means) or found.minutes != means[found.round - 1]:
                break
            kept.append(found)
            end += len(line)
        self._file.truncate(end)
        return kept

    def append(self, line: RoundMetrics) -> None:
        """Add a line; an :class:`OutputError` where the disk is full."""
        append(self._file, line.model_dump_json().encode() + b"\n")


@contextmanager
def open_metrics(folder: Path) -> Iterator[MetricsFile]:
    """Open the file of a folder's training, and keep others out for as long as it is open.

    Parameters
    ----------
    folder
        Of the model; it must be there.

    Yields
    ------
    MetricsFile
        With the lines of before, if there are any.

    Raises
    ------
    CheckpointError
        Another training writes to the folder (field ``out``).
    OutputError
        The file cannot be opened.
    """
    path = folder / METRICS
    said = f"another training writes to {folder}: wait for its end, or choose another folder with --out"
    with only_one(path, CheckpointError(said, field="out")) as file:
        yield MetricsFile(path, file)


def is_running(folder: Path) -> bool:
    """Say whether a training writes to a folder now."""
    try:
        with (folder / METRICS).open("rb", buffering=0) as file:
            return not locked(file, alone=False)
    except FileNotFoundError:
        return False


def read_metrics(folder: Path) -> list[RoundMetrics]:
    """Read how a training went, running or not; a torn line is left out.

    Parameters
    ----------
    folder
        Of the model.

    Returns
    -------
    list of RoundMetrics
        Empty where there is no file.
    """
    try:
        lines = (folder / METRICS).read_bytes().splitlines(keepends=True)
    except FileNotFoundError:
        return []
    return [found for line in lines if (found := _parsed(line))]


def _parsed(line: bytes) -> RoundMetrics | None:
    try:
        return RoundMetrics.model_validate_json(line) if line.endswith(b"\n") else None
    except ValidationError:
        return None
