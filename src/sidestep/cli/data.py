"""The commands that read, import and begin data: `counts`, `import-osm`, `new`."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from sidestep.cli import options
from sidestep.cli.console import print_table, print_text
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.crowds.layouts import Layout
    from sidestep.crowds.summary import CountReport, CountSummary
    from sidestep.network.osm import ImportReport
    from sidestep.scenarios.table_crowds import TableReport


counts_app = App(name="counts", help="Report on counts of pedestrians, or import tables of crowds.")


@counts_app.default
def counts(
    file: Path | None = None,
    /,
    *,
    sensor: str | None = None,
    reading: options.Reading = options.AS_FOUND,
    out: Path | None = None,
    p: options.Whole = 1,
    d: options.Whole | None = None,
    q: options.Whole = 0,
    seed: options.Whole = 0,
    as_json: options.Json = False,
) -> None:
    """Report on counts: how they were read, what was repaired, a fitted model, and how well it predicts the next hour.

    Parameters
    ----------
    file
        Counts in a layout of docs/counts.md; by default Auckland's.
    sensor
        Sensor to model; by default the scenarios' own, or the first of the file.
    out
        File for the hours as they were understood and repaired, .csv; no model is fitted then.
    p
        Autoregressive order.
    d
        Order of differencing; by default the data choose it.
    q
        Moving-average order.
    seed
        Seed of the simulated week shown beside the counts.
    """
    options.check_least(seed=seed)
    layout = reading.layout()
    if file is None:
        layout.check_needed(timezone=True)
    if out is not None:
        clean_counts(file, layout, out, as_json=as_json)
        return
    options.start_jax()
    from sidestep.crowds.summary import summarise_counts

    summary = summarise_counts(file, sensor, (p, d, q), seed, layout)
    if as_json:
        print(json.dumps(asdict(summary), indent=2))
    else:
        show_understood(summary)
        show_model(summary, seed)


def clean_counts(file: Path | None, layout: "Layout", out: Path, *, as_json: bool) -> None:
    """Write counts as they were understood and repaired, and say how."""
    from sidestep.crowds.count_files import check_out, positions_path, save_counts
    from sidestep.crowds.counts import load_auckland, read_counts
    from sidestep.crowds.summary import report_counts
    from sidestep.files import check_above, output_folder

    check_out(out, file)
    check_above(out.parent)
    table = load_auckland() if file is None else read_counts(file, layout)
    output_folder(out.parent)
    save_counts(table, out)
    if as_json:
        print_json(report_counts(table), out)
        return
    show_understood(report_counts(table))
    print(f"Counts: {out}")
    if table.positions is not None:
        print(f"Positions: {positions_path(out)}")


@counts_app.command(name="import")
def import_counts(
    table: Path,
    /,
    *,
    network: str,
    out: Path,
    slot: float | None = None,
    law: options.Law = "weidmann",
    as_json: options.Json = False,
) -> None:
    """Import a table of crowds on the segments of a town, and report what was filled in.

    Parameters
    ----------
    table
        Table of crowds by segment and slot: .csv or .parquet, see docs/counts.md.
    network
        Streets of the table: a file, or helsinki.
    out
        File for the crowds, .npz; scenario files may name it.
    slot
        Minutes of a slot, for tables with slot numbers; by default 5.
    law
        Speed law for the densities in this report.
    """
    options.check_minutes(slot=slot)
    options.start_jax()
    from sidestep.crowds.crowd_table import check_suffix, save_crowd_table
    from sidestep.files import check_above, check_apart, output_folder
    from sidestep.scenarios.streets import town_of
    from sidestep.scenarios.table_crowds import import_table

    check_suffix(out)
    check_above(out.parent)
    check_apart(out, (table, network))
    seconds = None if slot is None else 60 * slot
    crowds, report = import_table(table, town_of(network), slot_seconds=seconds, law=law)
    output_folder(out.parent)
    save_crowd_table(crowds, out)
    if as_json:
        print_json(report, out)
        return
    show_table(report)
    print(f"Crowds: {out}")


def import_osm(
    file: Path,
    /,
    *,
    out: Path,
    merge: float = 8.0,
    width: Annotated[list[str] | None, Parameter(negative=())] = None,
    attribution: str = "© OpenStreetMap contributors, ODbL 1.0",
    as_json: options.Json = False,
) -> None:
    """Turn an OpenStreetMap extract into streets for walkers, and report what was kept, dropped and repaired.

    Parameters
    ----------
    file
        OpenStreetMap extract: .osm, .osm.gz, .osm.bz2 or .osm.pbf.
    out
        File for the streets; its ending gives the format: .npz, .graphml or .geojson.
    merge
        Metres: crossings joined by a shorter street become one.
    width
        KIND=METRES available to walkers where no tag gives a width; repeatable.
    attribution
        Whose the streets are, and under which licence; whatever is made of them says so.
    """
    from sidestep.files import check_above, check_apart, output_folder
    from sidestep.network.formats import check_suffix, save_town
    from sidestep.network.osm import import_osm as read

    check_suffix(out)
    check_above(out.parent)
    check_apart(out, (file,))
    widths = dict(_width(option) for option in width or [])
    output_folder(out.parent)
    town, report = read(file, merge=merge, widths=widths, attribution=attribution)
    save_town(town, out)
    if as_json:
        print_json(report, out)
        return
    show_import(report)
    print(f"Streets: {out} ({town.attribution})")


def new(
    name: str,
    /,
    *,
    streets: str = "helsinki",
    counts: str = "auckland",
    reading: options.Reading = options.AS_FOUND,
    as_json: options.Json = False,
) -> None:
    """Write a commented scenario file to start from; it runs as it is.

    Parameters
    ----------
    name
        Name of the scenario, and of the folder to make for it here.
    streets
        Streets to begin with: a file, .npz or .graphml, or helsinki.
    counts
        Counts to begin with: a file, or auckland. If they know where sensors stand, those in the town stand there.
    """
    from sidestep.scenarios.template import begin, check_name, new_scenario

    check_name(name)
    beginning = begin(streets, counts, reading.layout())
    file = new_scenario(Path(), name, beginning)
    if as_json:
        sensors = {"sensors": beginning.counted, "at_their_places": beginning.standing}
        print(json.dumps({"scenario": str(file), **sensors}, indent=2))
        return
    if beginning.located:
        where = f"{beginning.standing} of {beginning.counted} sensors stand in this town, at their true places"
        print_text(where if beginning.standing else f"{where}: a seed pairs all with streets")
    print(f"{file}: try `sidestep compare {file} --walks 50 --planners shortest-path`, then make it yours")


def _width(option: str) -> tuple[str, float]:
    kind, _, metres = option.partition("=")
    try:
        return kind.strip(), float(metres)
    except ValueError as error:
        raise SidestepError(
            f"--width must be KIND=METRES, such as footway=2.5, not {option!r}", field="width"
        ) from error


def show_understood(report: "CountReport") -> None:
    """Print what a file of counts holds, how it was read, and what was repaired."""
    hours = f"{report.hours:,} hours, {report.first} to {report.last}"
    title = f"{report.source}: {hours}, {len(report.sensors)} sensor{'s' * (len(report.sensors) != 1)}"
    repairs = [(repair.kind, repair.sensor or "all", f"{repair.hours:,}", repair.detail) for repair in report.repairs]
    if report.understood:
        print_text(f"Read as: {'; '.join(report.understood)}")
    if repairs:
        print_table([title], ("repair", "sensor", ">hours", "detail"), repairs)
    else:
        print_text(f"{title}; no repairs")


def show_model(summary: "CountSummary", seed: int) -> None:
    """Print the fitted model and its errors."""
    ar, ma = (", ".join(f"{value:.3f}" for value in values) or "none" for values in (summary.ar, summary.ma))
    print_text(
        f"{summary.sensor}, {summary.train[0]} to {summary.train[1]}: ARIMA{summary.order}\n"
        f"  ar {ar}, ma {ma} (the paper's signs), mean {summary.mean:.1f}, sigma {summary.sigma:.1f} persons/h\n"
        f"  one simulated week (seed {seed}): mean {summary.simulated_mean:.0f}, sd {summary.simulated_sd:.0f}; "
        f"counted: mean {summary.counted_mean:.0f}, sd {summary.counted_sd:.0f}\n"
    )
    title = f"{summary.tested_hours:,} hours, {summary.test[0]} to {summary.test[1]}"
    errors = [(name, f"{error:.1f}") for name, error in summary.rmse.items()]
    print_table([title], ("prediction of the next hour", ">RMSE, persons/h"), errors)


def print_json(report: "ImportReport | TableReport | CountReport", out: Path) -> None:
    """Print what an import found as JSON."""
    print(json.dumps({**asdict(report), "out": str(out)}, indent=2, ensure_ascii=False))


def show_import(report: "ImportReport") -> None:
    """Print what an import of streets kept, dropped and repaired."""
    walked = f"{report.walkable:,} of {report.ways:,} highways, platforms, piers and ferries are walked"
    print_text(f"{report.source}: {walked}, {report.areas:,} areas across")
    sizes = [
        ("before merging", report.nodes_before, report.streets_before, report.kilometres_before),
        ("kept", report.nodes, report.streets, report.kilometres),
    ]
    rows = [(what, f"{nodes:,}", f"{streets:,}", f"{kilometres:,.1f}") for what, nodes, streets, kilometres in sizes]
    print_table((), ("", ">crossings", ">streets", ">km"), rows)
    for title, numbers in (("dropped", report.dropped), ("limited", report.limited), ("repaired", report.repaired)):
        if numbers:
            print_table((), (title, ">number"), [(what, f"{number:,}") for what, number in numbers.items()])
    if report.parts_left_out:
        print_text(f"Connected parts left out: {report.parts_left_out:,}")
    print_text(f"Streets at the busiest crossing: {report.most_exits}")


def show_table(report: "TableReport") -> None:
    """Print the contents of a table of crowds, and what was filled in."""
    span = "" if report.begins is None else f", {report.begins} to {report.ends}"
    print_text(
        f"{report.source}: {report.rows:,} rows, {report.quantity} on {report.mentioned:,} of {report.segments:,} "
        f"segments in {report.slots:,} slots of {report.slot_seconds / 60:g} min{span}"
    )
    if report.unused_columns:
        print_text(f"Columns without a meaning here: {', '.join(report.unused_columns)}")
    if report.filled:
        rows = [(kind, f"{number:,}", report.details[kind]) for kind, number in report.filled.items()]
        print_table((), ("filled in", ">number", "detail"), rows)
    law = f" (from speeds by the law {report.law}, {report.slower_than_law:,} below its lowest)" if report.law else ""
    print_text(f"Largest density: {report.largest_density:.2f} persons/m²{law}")
    print_text(f"Slots of segments above 1 person/m²: {report.share_above_1:.1%}, above 4: {report.share_above_4:.1%}")
