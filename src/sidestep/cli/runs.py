"""The commands `runs`, `runs show` and `runs compare`: trainings on disk."""

import json
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from sidestep.cli import options
from sidestep.cli.console import print_table, print_text
from sidestep.cli.curves import plot
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.agent.run_folders import RunFolder

runs_app = App(name="runs", help="List trainings, show how one goes, or compare two.")
SHOWN = 10
"""Rounds in the table of two learning curves."""
RunOption = Annotated[Path, Parameter(help="Folder of a training.")]


@runs_app.default
def runs(folder: Path = Path(), /, *, as_json: options.Json = False) -> None:
    """List the trainings in a folder and below it: how far they are, and the best result of each.

    Parameters
    ----------
    folder
        Where to look; by default here.
    """
    from sidestep.agent.run_folders import find_runs

    found = [run.to_json() for run in find_runs(folder)]
    if as_json:
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    if not found:
        print_text(f"No trainings in {folder}; sidestep train --out FOLDER starts one.")
        return
    rows = [
        (
            str(Path(row["folder"]).relative_to(folder)),
            row["state"],
            f"{row['rounds']:,}" + ("" if row["rounds_total"] is None else f"/{row['rounds_total']:,}"),
            _number(row["best_minutes"], ".1f"),
            _number(row["best_gap"], ".2%"),
            "" if row["scenario"] is None else f"{row['scenario']}, map {row['map']}, seed {row['seed']}",
            row["level"] or "",
            _time(row["seconds"]),
        )
        for row in found
    ]
    columns = ("run", "state", ">rounds", ">best minutes", ">its gap", "trained on", "level", ">time")
    print_table((), columns, rows, ("level", "time", "its gap", "trained on"))
    for row in found:
        if row["error"]:
            print_text(row["error"])


@runs_app.command
def show(folder: RunOption, /, *, out: Path | None = None, as_json: options.Json = False) -> None:
    """Draw the learning curve of a training, running or not, here and as a picture.

    Parameters
    ----------
    out
        File for the picture (.png); by default learning-curve.png in the folder.

    Raises
    ------
    SidestepError
        A file that is no picture's (field ``out``), and all that :func:`read_run` refuses.
    OutputError
        The file of ``out`` cannot be written.
    """
    if out is not None and (out.suffix.lower() != ".png" or out.is_dir()):
        raise SidestepError(f"--out must be a picture's file, such as curve.png, not {out}", field="out")
    from sidestep.agent.run_folders import read_run
    from sidestep.files import OutputError

    run, unwritable = read_run(folder), None
    try:
        picture = _draw(run, out or folder / "learning-curve.png")
    except OutputError as error:
        if out is not None:
            raise
        picture, unwritable = None, error  # somebody else's, perhaps
    if as_json:
        lines = [line.model_dump(mode="json") for line in run.metrics]
        shown = {**run.to_json(), "minutes": run.minutes, "metrics": lines, "picture": picture and str(picture)}
        print(json.dumps(shown, indent=2, ensure_ascii=False))
        return
    print_text(_in_words(run))
    if run.error:
        print_text(run.error)
    if run.minutes:
        print(f"\nMinutes of the greedy test walks\n{plot({'': run.minutes})}\n")
    if unwritable is not None:
        print_text(f"No picture: {unwritable}; name a file for it with --out.")
    if picture is not None:
        print(f"Learning curve: {picture}")


@runs_app.command
def compare(one: RunOption, other: RunOption, /, *, as_json: options.Json = False) -> None:
    """Set two trainings side by side: the settings that differ, what came of them, and their learning curves."""
    from sidestep.agent.checkpoint import CheckpointError
    from sidestep.agent.config import differences
    from sidestep.agent.run_folders import read_run

    both = [read_run(each) for each in (one, other)]
    told = []
    for run in both:
        if run.metadata is None:
            why = run.error or f"the training in {run.path} has not saved a round yet"
            raise CheckpointError(why, field="folder")
        told.append(run.metadata)
    differ = differences(*(metadata.settings for metadata in told))
    if as_json:
        settings = {name: list(values) for name, values in differ.items()}
        found = {"settings": settings, "runs": [{**run.to_json(), "minutes": run.minutes} for run in both]}
        print(json.dumps(found, indent=2, ensure_ascii=False))
        return
    names = [str(one), str(other)]
    for number, run in enumerate(both):
        print_text(f"{'AB'[number]}: {_in_words(run)}")
    if differ:
        print_table((), ("setting", "A", "B"), [(name, *map(_value, values)) for name, values in differ.items()])
    else:
        print_text("\nAll settings are the same.")
    print(f"Minutes of the greedy test walks\n{plot(dict(zip(names, (run.minutes for run in both), strict=True)))}")
    rounds = _rounds(max(len(run.minutes) for run in both))
    rows = [(f"{number:,}", *_results(both[0], number), *_results(both[1], number)) for number in rounds]
    print_table((), (">round", ">A", ">its gap", ">B", ">gap of B"), rows)


def _in_words(run: "RunFolder") -> str:
    """What a training is, how far it is, and its best result."""
    row = run.to_json()
    total = "" if row["rounds_total"] is None else f" of {row['rounds_total']:,}"
    said = [f"{run.path}: {run.state}, {row['rounds']:,}{total} rounds"]
    if row["seconds"] is not None:
        said.append(f"in {_time(row['seconds'])}")
    if row["scenario"] is not None:
        said.append(f"\n{row['scenario']}, map {row['map']}, seed {row['seed']}, level {row['level']}")
    if row["best_minutes"] is not None:
        gap = "" if row["best_gap"] is None else f", {_number(row['best_gap'], '.2%')} over the clairvoyant"
        said.append(f"\nbest {row['best_minutes']:.1f} min after round {row['best_round']:,}{gap}")
    return " ".join(said).replace(" \n", "\n")


def _draw(run: "RunFolder", picture: Path) -> Path | None:
    """Draw a training of which something was saved."""
    if run.metadata is None or not run.metadata.curve:
        return None
    from sidestep.files import output_folder
    from sidestep.plotting import draw_training, save

    output_folder(picture.parent)
    save(draw_training(run.metadata), picture)
    return picture


def _rounds(total: int) -> list[int]:
    """Rounds from the first to the last, about evenly apart."""
    return sorted({1 + round(step * (total - 1) / (SHOWN - 1)) for step in range(SHOWN)})


def _results(run: "RunFolder", number: int) -> tuple[str, str]:
    """Minutes and gap after a round."""
    line, minutes = run.after(number), run.minutes
    gap = None if line is None else line.gap
    return _number(minutes[number - 1] if number <= len(minutes) else None, ".1f"), _number(gap, ".2%")


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form).replace("%", " %")


def _time(seconds: float | None) -> str:
    return "" if seconds is None else str(timedelta(seconds=round(seconds)))


def _value(value: Any) -> str:
    return "" if value is None else f"{value!s:.60}"
