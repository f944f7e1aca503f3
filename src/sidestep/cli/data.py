"""The commands that read, import and begin data: `counts`, `import-osm`, `new`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from sidestep.cli.console import new_table, print_table
from sidestep.cli.options import Json, Whole, at_least, check_minutes, start_jax
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sidestep.crowds.summary import CountSummary
    from sidestep.network.osm import ImportReport
    from sidestep.scenarios.tables import TableReport


counts_app = App(name="counts", help="Report on counts of pedestrians, or import tables of crowds.")


@counts_app.default
def counts(
    file: Annotated[
        Path | None, Parameter(help="Hourly counts as CSV: time, then a column for each sensor; by default Auckland's.")
    ] = None,
    /,
    *,
    sensor: Annotated[
        str | None, Parameter(help="Sensor to model; by default the scenarios' own, or the first of the file.")
    ] = None,
    p: Annotated[int, Whole(help="Autoregressive order.")] = 1,
    d: Annotated[int | None, Whole(help="Order of differencing; by default the data choose it.")] = None,
    q: Annotated[int, Whole(help="Moving-average order.")] = 0,
    seed: Annotated[int, Whole(help="Seed of the simulated week shown beside the counts.")] = 0,
    as_json: Json = False,
) -> None:
    """Report on hourly counts: what was repaired, a fitted model, and how well it predicts the next hour."""
    at_least("seed", seed, 0)
    start_jax()
    from sidestep.crowds.summary import summarise_counts

    summary = summarise_counts(file, sensor, (p, d, q), seed)
    if as_json:
        print(json.dumps(asdict(summary), indent=2))
        return
    show_counts(summary, seed)


@counts_app.command(name="import")
def import_counts(
    table: Annotated[
        Path, Parameter(help="Table of crowds by segment and slot: .csv or .parquet, see docs/counts.md.")
    ],
    /,
    *,
    network: Annotated[str, Parameter(help="Streets of the table: a file, or helsinki.")],
    out: Annotated[Path, Parameter(help="File for the crowds, .npz; scenario files may name it.")],
    slot: Annotated[
        float | None, Parameter(help="Minutes of a slot, for tables with slot numbers; by default 5.")
    ] = None,
    law: Annotated[
        Literal["power", "power-capped", "weidmann"], Parameter(help="Speed law for the densities in this report.")
    ] = "weidmann",
    as_json: Json = False,
) -> None:
    """Import a table of crowds on the segments of a town, and report what was filled in."""
    check_minutes(slot, "slot")
    start_jax()
    from sidestep.crowds.crowd_table import check_suffix, save_crowd_table
    from sidestep.files import output_folder
    from sidestep.scenarios.build import town_of
    from sidestep.scenarios.tables import import_table

    check_suffix(out)
    seconds = None if slot is None else 60 * slot
    crowds, report = import_table(table, town_of(network), slot_seconds=seconds, law=law)
    output_folder(out.parent)
    save_crowd_table(crowds, out)
    report_import(report, show_table, f"Crowds: {out}", out, as_json=as_json)


def import_osm(
    file: Annotated[Path, Parameter(help="OpenStreetMap extract: .osm, .osm.gz, .osm.bz2 or .osm.pbf.")],
    /,
    *,
    out: Annotated[
        Path, Parameter(help="File for the streets; its ending gives the format: .npz, .graphml or .geojson.")
    ],
    merge: Annotated[float, Parameter(help="Metres: crossings joined by a shorter street become one.")] = 8.0,
    width: Annotated[
        list[str] | None,
        Parameter(negative=(), help="KIND=METRES available to walkers where no tag gives a width; repeatable."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Turn an OpenStreetMap extract into streets for walkers, and report what was kept, dropped and repaired."""
    from sidestep.files import output_folder
    from sidestep.network.formats import check_suffix, save_town
    from sidestep.network.osm import import_osm as read

    check_suffix(out)
    widths = dict(_width(option) for option in width or [])
    output_folder(out.parent)
    town, report = read(file, merge=merge, widths=widths)
    save_town(town, out)
    report_import(report, show_import, f"Streets: {out} ({town.attribution})", out, as_json=as_json)


def report_import(
    report: "ImportReport | TableReport", show: "Callable[..., None]", made: str, out: Path, *, as_json: bool
) -> None:
    """Say what an import found, and which file it ``made``."""
    if as_json:
        print(json.dumps({**asdict(report), "out": str(out)}, indent=2, ensure_ascii=False))
        return
    show(report)
    print(made)


def new(
    name: Annotated[str, Parameter(help="Name of the scenario, and of the folder to make for it here.")],
    /,
    *,
    as_json: Json = False,
) -> None:
    """Write a commented scenario file to start from; it runs as it is."""
    from sidestep.scenarios.template import new_scenario

    file = new_scenario(Path(), name)
    if as_json:
        print(json.dumps({"scenario": str(file)}, indent=2))
        return
    print(f"{file}: try `sidestep compare {file} --walks 50 --planners shortest-path`, then make it yours")


def _width(option: str) -> tuple[str, float]:
    kind, _, metres = option.partition("=")
    try:
        return kind.strip(), float(metres)
    except ValueError as error:
        raise SidestepError(
            f"--width must be KIND=METRES, such as footway=2.5, not {option!r}", field="width"
        ) from error


def show_counts(summary: "CountSummary", seed: int) -> None:
    """Print counts, their repairs, the fitted model and its errors."""
    title = (
        f"{summary.source}: {summary.hours:,} hours, {summary.first} to {summary.last}, {len(summary.sensors)} sensors"
    )
    if summary.repairs:
        table = new_table("repair", "sensor", ">hours", "detail", title=title)
        for repair in summary.repairs:
            table.add_row(repair.kind, repair.sensor or "all", f"{repair.hours:,}", repair.detail)
        print_table(table)
    else:
        print(f"{title}; no repairs")
    print(f"{summary.sensor}, {summary.train[0]} to {summary.train[1]}: ARIMA{summary.order}")
    print(f"  ar {_listed(summary.ar)}, ma {_listed(summary.ma)} (the paper's signs), ", end="")
    print(f"mean {summary.mean:.1f}, sigma {summary.sigma:.1f} persons/h")
    print(
        f"  one simulated week (seed {seed}): mean {summary.simulated_mean:.0f}, sd {summary.simulated_sd:.0f}; ",
        end="",
    )
    print(f"counted: mean {summary.counted_mean:.0f}, sd {summary.counted_sd:.0f}\n")
    title = f"{summary.tested_hours:,} hours, {summary.test[0]} to {summary.test[1]}"
    table = new_table("prediction of the next hour", ">RMSE, persons/h", title=title)
    for name, error in summary.rmse.items():
        table.add_row(name, f"{error:.1f}")
    print_table(table)


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.3f}" for value in values) or "none"


def show_import(report: "ImportReport") -> None:
    """Print what an import of streets kept, dropped and repaired."""
    print(f"{report.source}: {report.walkable:,} of {report.ways:,} highways are walkable")
    table = new_table("", ">crossings", ">streets", ">km", title="")
    for what, nodes, streets, kilometres in (
        ("before merging", report.nodes_before, report.streets_before, report.kilometres_before),
        ("kept", report.nodes, report.streets, report.kilometres),
    ):
        table.add_row(what, f"{nodes:,}", f"{streets:,}", f"{kilometres:,.1f}")
    print_table(table)
    for title, numbers in (("dropped", report.dropped), ("repaired", report.repaired)):
        table = new_table(title, ">number", title="")
        for what, number in numbers.items():
            table.add_row(what, f"{number:,}")
        if numbers:
            print_table(table)
    print(f"Streets at the busiest crossing: {report.most_exits}")


def show_table(report: "TableReport") -> None:
    """Print the contents of a table of crowds, and what was filled in."""
    span = "" if report.begins is None else f", {report.begins} to {report.ends}"
    print(
        f"{report.source}: {report.rows:,} rows, {report.quantity} on {report.mentioned:,} of {report.segments:,} "
        f"segments in {report.slots:,} slots of {report.slot_seconds / 60:g} min{span}"
    )
    if report.unused_columns:
        print(f"Columns without a meaning here: {', '.join(report.unused_columns)}")
    table = new_table("filled in", ">number", "detail", title="")
    for kind, number in report.filled.items():
        table.add_row(kind, f"{number:,}", report.details[kind])
    if table.row_count:
        print_table(table)
    by = (
        ""
        if report.law is None
        else f" (from speeds by the law {report.law}, {report.slower_than_law:,} below its lowest)"
    )
    print(f"Largest density: {report.largest_density:.2f} persons/m²{by}")
    print(f"Slots of segments above 1 person/m²: {report.share_above_1:.1%}, above 4: {report.share_above_4:.1%}")
