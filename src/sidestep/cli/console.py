"""What people see on a terminal: tables and progress bars. The only module that imports rich."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

    from sidestep.crowds.summary import CountSummary
    from sidestep.evaluation.compare import Results
    from sidestep.experiments.trade_off import TradeOffJson
    from sidestep.network.osm import ImportReport
    from sidestep.routing.grid_plan import PlannedWalk
    from sidestep.routing.serialise import JourneyJson
    from sidestep.scenarios.tables import TableReport

WIDTH = 180  # where the output is no terminal


def show_results(results: "Results") -> None:
    """Print a comparison as a table."""
    from sidestep.evaluation.metrics import cells

    only = " (forecasts only)" if results["flows"] == "forecast" else ""
    title = (
        f"{results['scenario']}{only}: {results['maps']} map{'s' * (results['maps'] > 1)}, "
        f"{results['walks']} walks each, seed {results['seed']}"
    )
    if results["summary"]:
        title += f"\n{results['summary']}"
    by, objective = results["by_minutes"], results["objective"]
    if objective is not None:
        title += f"\ncost in minutes: {objective_in_words(objective)}; savings, differences and regrets are of cost"
    headings = {
        "planner": "planner",
        "knows": "knows",
        "cost": ">cost" if objective else "",
        "minutes": ">minutes",
        "exposure": ">exposure" if objective else "",
        "metres": ">metres" if objective else "",
        "too dense": ">too dense" if objective and objective["max_density"] else "",
        "median": "" if objective else ">median",
        "90 %": "" if objective else ">90 % in",
        "in time": f">within {by:g}" if by else "",
        "saved": ">saved",
        "difference": f">over {results['baseline']}",
        "difference 95 %": ">95 %",
        "regret": ">regret",
        "arrive": ">arrive",
        "µs a decision": ">µs/decision",
    }
    shown = {column: heading for column, heading in headings.items() if heading}
    table = _table(*shown.values(), title=title)
    for name, row in results["planners"].items():
        table.add_row(*cells(name, row, results["maps"], shown).values())
    _print(table)


def objective_in_words(objective: "dict[str, float | None]") -> str:
    """Weights of what walkers keep low."""
    units = {"time": "s", "distance": "m", "exposure": "person·s/m² met"}
    terms = [f"{weight:g} x {units[name]}" for name, weight in objective.items() if name in units and weight]
    most = objective["max_density"]
    return " + ".join(terms) + ("" if most is None else f", avoiding streets above {most:g} persons/m²")


def show_walk(walk: "PlannedWalk") -> None:
    """Print a planned walk."""
    nodes = walk["nodes"]
    print(f"{walk['planner']} ({walk['level']}), if crowds are as expected:")
    table = _table(">node", ">minutes", title="")
    for node, minutes in zip(nodes, walk["minutes"], strict=True):
        table.add_row(str(node), f"{minutes:.1f}")
    _print(table)
    end = "" if walk["arrives"] else " without arriving"
    print(f"{len(nodes) - 1} streets, {walk['metres']:,.0f} m, {walk['expected_minutes']:.1f} min{end}")
    print(
        f"In {walk['futures']} simulated futures: median {walk['median_minutes']:.1f} min, 90 % within "
        f"{walk['p90_minutes']:.1f} min, {100 * walk['arrival_rate']:.1f} % arrive"
    )
    if walk["arrive_by"] is not None:
        print(f"Arrives within {walk['by_minutes']:g} min with probability {walk['arrive_by']:.2f}")


def show_trade_off(found: "TradeOffJson") -> None:
    """Print a trade-off between time and exposure as a table."""
    title = f"{found['scenario']}, map 0: {found['walks']} walks for each weight of exposure, seed {found['seed']}"
    columns = ("planner", ">weight", ">minutes", ">person·s/m² met", ">metres", ">arrive")
    table = _table(*columns, title=f"{title}\n{found['summary']}" if found["summary"] else title)
    rows = [(name, point) for name, points in found["curves"].items() for point in points]
    for name, point in (("shortest-path", found["shortest_path"]), *rows):
        table.add_row(
            name,
            "" if point["weight"] is None else f"{point['weight']:g}",
            f"{point['minutes']:.2f}",
            f"{point['exposure']:,.0f}",
            f"{point['metres']:,.0f}",
            f"{point['arrival_rate']:.1%}",
        )
    _print(table)


def show_journey(walk: "JourneyJson") -> None:
    """Print the way through a real place, turn by turn, and how long it may take."""
    low = "" if walk["objective"] is None else f", keeping low {objective_in_words(walk['objective'])}"
    print(f"{walk['planner']} ({walk['level']}), departing {walk['departs']}{low}, if crowds are as expected:")
    for end in (walk["origin"], walk["destination"]):
        if end["metres_away"] >= 1:
            print(f"{end['asked']} is {end['metres_away']:,.0f} m from the street")
    table = _table("", "street", ">metres", ">minutes", "crowds", ">persons/m²", title="")
    for step in walk["steps"]:
        table.add_row(
            step["turn"],
            step["street"],
            f"{step['metres']:,.0f}",
            f"{step['minutes']:.1f}",
            step["crowding"],
            f"{step['density']:.2f}",
        )
    if walk["arrives"]:
        table.add_row("arrive", "", "", "", "", "")
    _print(table)
    end_of = "" if walk["arrives"] else " without arriving"
    print(
        f"{walk['metres']:,.0f} m, {walk['expected_minutes']:.1f} min{end_of}; crowds on the way: {walk['crowding']}, "
        f"{walk['mean_density']:.2f} persons/m², {walk['exposure']:,.0f} person·s/m² met"
    )
    if walk["too_dense"]:
        print(f"{walk['too_dense']} of its streets are entered above the density that nobody should enter.")
    print(
        f"In {walk['futures']} simulated future{'s' * (walk['futures'] > 1)}: median {walk['median_minutes']:.1f} min, "
        f"90 % within {walk['p90_minutes']:.1f} min, {100 * walk['arrival_rate']:.1f} % arrive"
    )
    if walk["arrive_by"] is not None:
        print(f"Arrives within {walk['by_minutes']:g} min with probability {walk['arrive_by']:.2f}")
    for name, other in walk["others"].items():
        which = "the same futures" if other["futures"] == walk["futures"] else f"the first {other['futures']} of them"
        more = other["mean_difference_minutes"]
        print(
            f"{name} in {which}: median {other['median_minutes']:.1f} min, 90 % within {other['p90_minutes']:.1f} min, "
            f"{100 * other['arrival_rate']:.1f} % arrive; on average {abs(more):.1f} min "
            f"{'longer' if more >= 0 else 'shorter'}{_crowd_met(other['mean_difference_exposure'])}"
        )
    print(f"\nCrowds are {_which_crowds(walk)}.")
    print(f"Streets: {walk['attribution']}. Crowds: {walk['crowds']}.")


def _which_crowds(walk: "JourneyJson") -> str:
    if walk["hour_of_week"] is None:
        return "those of the table from its first slot on"
    if walk["sensors"] is None:
        return "those of the table at this hour of the week, whatever the date"
    counted, usual = walk["counted_sensors"], "those that are usual at this hour of the week, whatever the date"
    known = f", and go on from current counts of {counted} of {walk['sensors']} sensors"
    return usual if counted is None else usual + known


def _crowd_met(more: float | None) -> str:
    return "" if more is None else f", {abs(more):,.0f} person·s/m² {'more' if more >= 0 else 'less'} met"


def show_counts(summary: "CountSummary", seed: int) -> None:
    """Print what a table of counts holds, what was repaired, and how the fitted models do."""
    title = (
        f"{summary.source}: {summary.hours:,} hours, {summary.first} to {summary.last}, {len(summary.sensors)} sensors"
    )
    if summary.repairs:
        table = _table("repair", "sensor", ">hours", "detail", title=title)
        for repair in summary.repairs:
            table.add_row(repair.kind, repair.sensor or "all", f"{repair.hours:,}", repair.detail)
        _print(table)
    else:
        print(f"{title}; nothing had to be repaired")
    p, d, q = summary.order
    print(f"{summary.sensor}, {summary.train[0]} to {summary.train[1]}: ARIMA({p}, {d}, {q})")
    print(f"  ar {_listed(summary.ar)}, ma {_listed(summary.ma)} (the paper's signs), ", end="")
    print(f"mean {summary.mean:.1f}, sigma {summary.sigma:.1f} persons/h")
    print(
        f"  one simulated week (seed {seed}): mean {summary.simulated_mean:.0f}, sd {summary.simulated_sd:.0f}; ",
        end="",
    )
    print(f"counted: mean {summary.counted_mean:.0f}, sd {summary.counted_sd:.0f}\n")
    title = f"{summary.tested_hours:,} hours, {summary.test[0]} to {summary.test[1]}"
    table = _table("prediction of the next hour", ">RMSE, persons/h", title=title)
    for name, error in summary.rmse.items():
        table.add_row(name, f"{error:.1f}")
    _print(table)


def show_import(report: "ImportReport") -> None:
    """Print what an import of streets kept, what it dropped, and why."""
    print(f"{report.source}: {report.walkable:,} of {report.ways:,} highways are walked")
    table = _table("", ">crossings", ">streets", ">km", title="")
    for what, nodes, streets, kilometres in (
        ("before merging", report.nodes_before, report.streets_before, report.kilometres_before),
        ("kept", report.nodes, report.streets, report.kilometres),
    ):
        table.add_row(what, f"{nodes:,}", f"{streets:,}", f"{kilometres:,.1f}")
    _print(table)
    table = _table("dropped or repaired", ">number", title="")
    for what, number in (*report.dropped.items(), *report.repaired.items()):
        table.add_row(what, f"{number:,}")
    if table.row_count:
        _print(table)
    print(f"At most {report.most_exits} streets leave one crossing.")


def show_table(report: "TableReport") -> None:
    """Print what a table of crowds holds, and what was filled in."""
    span = "" if report.begins is None else f", {report.begins} to {report.ends}"
    print(
        f"{report.source}: {report.rows:,} rows, {report.quantity} on {report.mentioned:,} of {report.segments:,} "
        f"segments in {report.slots:,} slots of {report.slot_seconds / 60:g} min{span}"
    )
    if report.unused_columns:
        print(f"Columns that mean nothing here: {', '.join(report.unused_columns)}")
    table = _table("filled", ">number", "detail", title="")
    for kind, number in report.filled.items():
        table.add_row(kind, f"{number:,}", report.details[kind])
    if table.row_count:
        _print(table)
    by = "" if report.law is None else f" (speeds by the law {report.law}, {report.slower_than_law:,} below its lowest)"
    print(f"Densest: {report.largest_density:.2f} persons/m²{by}")
    print(f"More than 1 person/m²: {report.share_above_1:.1%} of all segments' slots, 4: {report.share_above_4:.1%}")


class Advance:
    """One step further on a bar, with a note."""

    def __init__(self, bar: "Progress", what: str, total: int, each: int, unit: str) -> None:
        self._bar, self._each, self._unit, self._done, self._began = bar, each, unit, 0, perf_counter()
        self._task = bar.add_task(what, total=total * each, rate="", note="")

    def __call__(self, note: str) -> None:
        self._done += self._each
        rate = f"{self._done / (perf_counter() - self._began):,.3g} {self._unit}/s"
        self._bar.update(self._task, advance=self._each, rate=rate, note=note)


@contextmanager
def progress(what: str, total: int, each: int, unit: str) -> Iterator[Advance]:
    """Show a bar with rate and time left on standard error, or nothing where that is no terminal.

    ``total`` calls of what is yielded fill the bar; each stands for ``each`` of ``unit``.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.completed:,.0f}/{task.total:,.0f} " + unit),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[note]}"),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
        transient=True,
    )
    with bar:
        yield Advance(bar, what, total, each, unit)


def _table(*columns: str, title: str) -> "Table":
    """A table; columns whose name begins with > hold numbers."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", title_style="")
    for column in columns:
        number = column.startswith(">")
        table.add_column(column.removeprefix(">"), justify="right" if number else "left", no_wrap=number)
    return table


def _print(table: "Table") -> None:
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(table)


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:.3f}" for value in values) or "none"
