"""The command line: registers all commands, and turns errors into one sentence and an exit status."""

import os
import sys
from typing import NoReturn

from cyclopts import App, CycloptsError

from sidestep import __version__
from sidestep.cli import data, experiments, listings
from sidestep.cli.compare import compare
from sidestep.cli.route import route
from sidestep.cli.train import train
from sidestep.errors import SidestepError

INTERRUPTED, BAD_INPUT = 130, 2

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
    compare,
    route,
    data.import_osm,
    data.new,
    listings.planners,
    listings.scenarios,
):
    app.command(command)
app.command(experiments.trade_off, name="trade-off")
app.command(data.counts_app)


def main() -> None:
    """Run the command line: exit status 2 on bad input, 130 on Ctrl-C, with one sentence each."""
    sys.path.append("")  # planners in the current folder, as MODULE:NAME
    try:
        app(exit_on_error=False, print_error=False)
    except CycloptsError as error:
        _leave(BAD_INPUT, " ".join(str(error).split()))
    except SidestepError as error:
        _leave(BAD_INPUT, str(error))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except KeyboardInterrupt:
        _leave(INTERRUPTED, "stopped; everything saved so far is kept")


def _leave(status: int, sentence: str) -> NoReturn:
    print(f"sidestep: {sentence}", file=sys.stderr, flush=True)
    sys.stdout.flush()
    # Not by sys.exit, which would wait for threads in the middle of a map. Files are written whole or not at all.
    os._exit(status)
