"""The command line: registers all commands, and turns errors into one sentence and an exit status."""

import logging
import os
import re
import sys
import warnings
from collections.abc import Sequence

from cyclopts import App, CycloptsError

from sidestep import __version__
from sidestep.cli import data, experiments, listings, queries
from sidestep.cli.compare import compare
from sidestep.cli.route import route
from sidestep.cli.runs import runs_app
from sidestep.cli.serve import replay, serve
from sidestep.cli.sweep import sweep
from sidestep.cli.train import train
from sidestep.errors import SidestepError, SidestepWarning

INTERRUPTED, BAD_INPUT = 130, 2
_as_python_does = warnings.formatwarning
_NUMBER, _OPTION = re.compile(r"[-+]?\d+(\.\d*)?,?"), re.compile(r"^(--[\w-]+)=")
_DAY, _CLOCK = re.compile(r"[\w./-]+"), re.compile(r"\d{1,2}(:\d{2}){1,2}\S*")

app = App(
    name="sidestep",
    help="Plan walks that take the least time, or meet the fewest people, through crowds that keep changing.",
    version=__version__,
    suppress_keyboard_interrupt=False,
)

for command in (
    experiments.demo,
    experiments.reproduce,
    train,
    sweep,
    compare,
    route,
    queries.when,
    queries.isochrone,
    queries.matrix,
    queries.crowds,
    serve,
    replay,
    data.import_osm,
    data.new,
    listings.planners,
    listings.scenarios,
    listings.walkers,
    experiments.trade_off,
):
    app.command(command)
app.command(data.counts_app)
app.command(runs_app)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments
        The command and its options; by default those of this process.

    Returns
    -------
    int
        The exit status: 2 on bad input, 130 on Ctrl-C, after one sentence on standard error.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if said := _empty(given) or _place_in_two(given) or _time_in_two(given):
        return _complain(BAD_INPUT, said)
    try:
        app(arguments, exit_on_error=False, print_error=False)
    except SystemExit as done:  # the library's way to end a command
        return int(done.code or 0)
    except CycloptsError as error:
        return _complain(BAD_INPUT, " ".join(str(error).split()))
    except SidestepError as error:
        return _complain(BAD_INPUT, str(error))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt as stop:
        return _complain(INTERRUPTED, str(stop) or "stopped; everything saved so far is kept")
    return 0


def _empty(arguments: Sequence[str]) -> str:
    """What to say of an empty argument, which as a folder would be the working one; "" if there is none."""
    words = _words(arguments)
    if "" not in words:
        return ""
    before = words[words.index("") - 1] if words[0] else ""
    return f"{before if before.startswith('--') else 'an argument'} is empty; give a value, or leave it out"


def _place_in_two(arguments: Sequence[str]) -> str:
    """What to say of a place with a space instead of a comma, such as ``--from 60.17 24.94``; "" if there is none."""
    words = [part for argument in arguments for part in _OPTION.sub(r"\1 ", argument, count=1).split(" ", 1)]
    for option, latitude, longitude in zip(words, words[1:], words[2:], strict=False):
        if option in ("--from", "--to") and _NUMBER.fullmatch(latitude) and _NUMBER.fullmatch(longitude):
            place = f"{latitude.rstrip(',')},{longitude}"
            return f"{option} {latitude} {longitude}: write latitude and longitude with a comma and no space, {place}"
    return ""


def _time_in_two(arguments: Sequence[str]) -> str:
    """What to say of a time without quotes, such as ``--depart 2025-05-24 17:30``; "" if there is none."""
    words = _words(arguments)
    for option, day, clock in zip(words, words[1:], words[2:], strict=False):
        if option in ("--depart", "--until", "--arrive-by", "--at") and _DAY.fullmatch(day) and _CLOCK.fullmatch(clock):
            return f'{option} {day} {clock}: write day and time in quotes, {option} "{day} {clock}"'
    return ""


def _words(arguments: Sequence[str]) -> list[str]:
    """Options and their values one by one, also of ``--option=value``."""
    return [part for argument in arguments for part in _OPTION.sub("\\1\0", argument, count=1).split("\0", 1)]


def _complain(status: int, sentence: str) -> int:
    print(f"sidestep: {sentence}", file=sys.stderr, flush=True)
    return status


def _as_sentence(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Write warnings that are meant for people as one sentence, and others as Python does."""
    if isinstance(message, SidestepWarning):
        return f"sidestep: {message}\n"
    return _as_python_does(message, category, filename, lineno, line)


def main() -> None:
    """Run the command line and leave the process."""
    warnings.formatwarning = _as_sentence
    sys.path.append("")  # planners in the current folder, as MODULE:NAME
    status = run()
    sys.stdout.flush()
    sys.stderr.flush()
    logging.shutdown()
    # Not by sys.exit, which would wait for threads in the middle of a map, and takes a third of a second to give back
    # what JAX holds. Files are written whole or not at all.
    os._exit(status)
