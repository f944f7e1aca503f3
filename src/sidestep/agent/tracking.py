"""TensorBoard's event file of a training. The only module that imports tensorboardX.

It says what ``metrics.jsonl`` says, so it is written anew from there where a training goes on.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from time import time

from sidestep.agent.config import TrainConfigError
from sidestep.agent.metrics import RoundMetrics
from sidestep.files import OutputError, reason

EVENTS = "events.out.tfevents.*"
SCALARS = ("loss", "td_error", "q", "epsilon", "minutes", "gap", "arrival_rate")
"""The metrics that are drawn."""


def check_tracking() -> None:
    """Refuse to write event files, before long work begins, where tensorboardX is not installed."""
    if find_spec("tensorboardX") is None:
        raise TrainConfigError("event files take tensorboardX: pip install 'sidestep[track]'", field="track")


def remove_events(folder: Path) -> None:
    """Remove event files of a training that is replaced or goes on; an :class:`OutputError` where that is refused."""
    with _refused(folder):
        for old in folder.glob(EVENTS):
            old.unlink()


@contextmanager
def _refused(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write event files to {folder}: {reason(error)}", field="out") from error


class EventFile:
    """An event file under way, with a point for every round."""

    def __init__(self, folder: Path, lines: Sequence[RoundMetrics]) -> None:
        from tensorboardX.event_file_writer import EventsWriter  # it writes at once, without a thread

        self._folder, self._began = folder, time() - (lines[-1].seconds if lines else 0.0)
        with _refused(self._folder):
            self._writer = EventsWriter(str(folder / "events"))
        for line in lines:
            self.add(line)

    def add(self, line: RoundMetrics) -> None:
        """Write a round; an :class:`OutputError` where the disk is full."""
        from tensorboardX.proto.event_pb2 import Event
        from tensorboardX.proto.summary_pb2 import Summary

        values = [(name, getattr(line, name)) for name in SCALARS]
        points = [Summary.Value(tag=name, simple_value=value) for name, value in values if value is not None]
        event = Event(step=line.round, wall_time=self._began + line.seconds, summary=Summary(value=points))
        with _refused(self._folder):
            self._writer.write_event(event)
            self._writer.flush()

    def close(self) -> None:
        """Close the file; every round was written at once."""
        with suppress(OSError):
            self._writer.close()
