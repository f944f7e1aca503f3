"""The command `sweep`."""

import json
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sidestep.cli import options
from sidestep.cli.console import print_table, print_text, progress

if TYPE_CHECKING:
    from sidestep.experiments.pool import Ended

LEAST_FIRST = ("knows", "95 % of walks", "95 %", "difference, 95 % of walks", "arrive", "gap 95 %")
"""Columns that narrow terminals leave out, the least important first."""
FAILED = 1
"""Exit status where jobs failed."""


def sweep(
    study: Annotated[Path, Parameter(help="File of the study: docs/sweeps.md.")],
    /,
    *,
    workers: options.Processes = None,
    scheduler: options.Scheduler = None,
    out: Path | None = None,
    against: str = "expected",
    walks_out: Path | None = None,
    as_json: options.Json = False,
) -> int:
    """Train the agents of a study, compare them, and sum up over trainings; once stopped, the same command goes on.

    Parameters
    ----------
    out
        Folder for models and results; by default one with the study's name.
    against
        Planner or agent that the others' minutes are set against.
    walks_out
        File for the single walks, .csv or .parquet: a row for each walk and planner or agent.

    Returns
    -------
    int
        The exit status.
    """
    options.check_least(workers=workers)
    from sidestep.experiments.study import read_study
    from sidestep.experiments.sweep import check_baseline
    from sidestep.experiments.sweep import sweep as run
    from sidestep.files import write_text

    asked = read_study(study)
    check_baseline(asked, against)
    folder = out or Path(asked.name)
    if walks_out is not None:
        from sidestep.evaluation.tables import check_table_file, save_tables
        from sidestep.files import check_apart

        files = {file for job in asked.jobs for file in job.scenario.place.files}
        check_apart(walks_out, [study, *sorted(files)], "walks_out")
        check_table_file(walks_out, "walks_out")
    with sweeping(workers, scheduler) as (processes, on_jobs):
        found = run(asked, folder, workers=processes, scheduler=scheduler, on_jobs=on_jobs)
    results = found.to_json(against)
    text = json.dumps(results, indent=2, ensure_ascii=False)
    write_text(folder / "results.json", f"{text}\n")
    if walks_out is not None:
        save_tables(list(found.to_frames()), walks_out, "walks_out")
    if as_json:
        print(text)
    else:
        show_sweep(results)
        print(f"Results: {folder / 'results.json'}")
        if walks_out is not None:
            print(f"Walks: {walks_out}")
    return FAILED if found.failed else 0


@contextmanager
def sweeping(
    workers: int | None, scheduler: str | None
) -> "Iterator[tuple[int, Callable[[int], Callable[[Ended], None]]]]":
    """Show how jobs go, until the last one or a signal.

    Yields
    ------
    int, Callable
        How many processes to start, and what a sweep calls with the number of its jobs.
    """
    processes = workers or options.processors()
    ended: list[Ended] = []
    with (
        stoppable(lambda: f"stopped after {len(ended)} more jobs; the same command goes on from here"),
        ExitStack() as bar,
    ):

        def on_jobs(todo: int) -> "Callable[[Ended], None]":
            advance = bar.enter_context(progress("sweeping", todo, "jobs"))

            def on_end(*ending: "Ended") -> None:
                ended.extend(ending)
                running = "" if scheduler else f"{min(processes, todo - len(ended))} running, "
                advance(f"{running}{sum(each.result is None for each in ended)} failed", len(ending))

            on_end()
            return on_end

        yield processes, on_jobs


@contextmanager
def stoppable(said: Callable[[], str]) -> Iterator[None]:
    """End on SIGTERM as on Ctrl-C, with a sentence."""

    def stop(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(said()) from None
    finally:
        signal.signal(signal.SIGTERM, before)


def show_sweep(results: dict[str, Any]) -> None:
    """Print what a study found, a table for each problem, and which jobs failed."""
    from sidestep.evaluation.metrics import percent

    def interval(found: Sequence[float] | None, form: str = ".1f", unit: float = 1.0) -> str:
        return "–" if found is None else " to ".join(f"{unit * bound:{form}}" for bound in found)

    for each in results["problems"]:
        maps = f" on {each['maps']} maps" if each["maps"] > 1 else ""
        head = f"{each['problem']}: {each['trainings']} trainings of each agent, {each['walks']} walks of each{maps}"
        print_table(
            (head, each["summary"], each["synthetic"]),
            (
                "planner", "knows", ">trainings", ">minutes", ">95 %", ">95 % of walks", f">over {each['baseline']}",
                ">difference, 95 %", ">difference, 95 % of walks", ">over the clairvoyant", ">gap 95 %", ">arrive",
            ),
            [
                (
                    name, row["level"], str(row["trainings"]), f"{row['mean_minutes']:.1f}", interval(row["ci95"]),
                    interval(row["ci95_walks"]), f"{row['difference_minutes']:+.2f}",
                    interval(row["difference_ci95"], "+.2f"), interval(row["difference_ci95_walks"], "+.2f"),
                    percent(row["gap"], 2), interval(row["gap_ci95"], ".2f", 100), percent(row["arrival_rate"]),
                )
                for name, row in each["planners"].items()
            ],
            LEAST_FIRST,
        )  # fmt: skip
    for name, error in results["failed"].items():
        print_text(f"FAILED: {name}: {error}")
