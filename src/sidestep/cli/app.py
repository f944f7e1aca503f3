"""The command line: registers the commands, and turns errors into one sentence and an exit status."""

import os
import sys
from typing import NoReturn

from cyclopts import App, CycloptsError

from sidestep import __version__
from sidestep.cli import data, experiments
from sidestep.cli.compare import compare
from sidestep.cli.route import route
from sidestep.cli.train import train
from sidestep.errors import SidestepError

INTERRUPTED, BAD_INPUT = 130, 2


app = App(
    name="sidestep",
    help="Walks that take the least time through crowds that keep changing, learned by walking.",
    version=__version__,
    suppress_keyboard_interrupt=False,
)


for command in (experiments.demo, experiments.reproduce, train, compare, route, data.import_osm, data.new):
    app.command(command)
app.command(experiments.trade_off, name="trade-off")
app.command(data.counts_app)


def main() -> None:
    """Run the command line: 2 on bad input, 130 on Ctrl-C, one sentence for each."""
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
        _leave(INTERRUPTED, "stopped; what had been saved is kept")


def _leave(status: int, sentence: str) -> NoReturn:
    print(f"sidestep: {sentence}", file=sys.stderr, flush=True)
    sys.stdout.flush()
    # Threads may be in the middle of a map: they must not be waited for. Files are whole or not there.
    os._exit(status)
