"""The command `route`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from sidestep.cli.console import new_table, objective_in_words, print_table
from sidestep.cli.options import (
    UNCHANGED,
    By,
    Changes,
    Hyphened,
    Json,
    ScenarioOption,
    Seed,
    Whole,
    at_least,
    check_minutes,
    hand_over,
    read_scenario,
    start_jax,
)
from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from sidestep.planners.base import Planner
    from sidestep.routing.grid_plan import PlannedWalk
    from sidestep.routing.plan import Journey
    from sidestep.routing.serialise import JourneyJson
    from sidestep.scenarios.maps import ScenarioMap
    from sidestep.scenarios.model import Scenario


def route(
    scenario: ScenarioOption,
    /,
    *,
    origin: Annotated[
        str | None,
        Hyphened(name="--from", help="Node, or in towns LAT,LON; by default the scenario's first node."),
    ] = None,
    destination: Annotated[
        str | None, Hyphened(name="--to", help="Node, or in towns LAT,LON; by default the scenario's last node.")
    ] = None,
    depart: Annotated[
        str | None,
        Hyphened(help="Minutes after the scenario's start; in towns local time, such as 2025-05-24T12:30."),
    ] = None,
    planner: Annotated[str | None, Parameter(help="Who plans; by default expected, or darp with --model.")] = None,
    model: Annotated[Path | None, Parameter(help="Folder of a trained model, for the planner darp.")] = None,
    by: By = None,
    futures: Annotated[
        int | None,
        Whole(
            help="Simulated futures; by default 200, in towns 20 for planners that see all counts, 1 without chance."
        ),
    ] = None,
    live: Annotated[Path | None, Parameter(help="In towns: current counts, hourly, as CSV.")] = None,
    output: Annotated[
        Literal["text", "geojson", "gpx", "png"],
        Parameter(name="--format", help="What is printed, or written to --out."),
    ] = "text",
    out: Annotated[Path | None, Parameter(help="File to write to instead of printing.")] = None,
    index: Annotated[int, Whole(name="--map", help="Number of the map.")] = 0,
    changes: Changes = UNCHANGED,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Plan one walk, and say how long it may take."""
    at_least("seed", seed, 0)
    at_least("map", index, 0)
    if futures is not None:
        at_least("futures", futures, 1)
    check_minutes(by)
    if output == "png" and out is None:
        raise SidestepError("--format png needs --out, the file for the picture")
    if as_json and output != "text":
        raise SidestepError(f"--json and --format {output} cannot go together")
    start_jax()
    from sidestep.crowds.counts import read_counts
    from sidestep.files import output_folder
    from sidestep.routing.grid_plan import foresee
    from sidestep.routing.plan import travel
    from sidestep.routing.request import prepare, read_departure, read_minutes, read_node, read_place
    from sidestep.scenarios.maps import draw_map

    problem = read_scenario(scenario, changes)
    place = draw_map(problem, seed, index)
    last = str(place.network.nodes - 1)
    if not problem.place.streets:
        if output != "text" or live is not None:
            what = "--live" if live is not None else f"--format {output}"
            raise SidestepError(f"{what} needs a scenario with real streets, such as helsinki; {scenario} is a grid")
        ends = read_node("--from", origin or "0"), read_node("--to", destination or last)
        departure = 60 * read_minutes(depart or "0")
        who = _planner(planner, model, problem, place, seed, index, ends[1])
        if out is not None:
            output_folder(out.parent)
        found = foresee(
            problem, place, who, origin=ends[0], destination=ends[1], departure=departure, futures=futures or 200
        ).as_json(by)
        hand_over(out, lambda: print(json.dumps(found, indent=2)) if as_json else show_walk(found))
        return
    trip = prepare(
        problem,
        place,
        read_place("--from", origin or "0"),
        read_place("--to", destination or last),
        read_departure(depart, problem.place, timed=place.flow.timed),
        None if live is None else read_counts(live),
    )
    who = _planner(planner, model, problem, place, seed, index, trip.destination.node, splits=trip.splits)
    if out is not None:
        output_folder(out.parent)
    _hand_over_journey(travel(trip, who, futures), "json" if as_json else output, out, by)


def _planner(
    name: str | None,
    model: Path | None,
    problem: "Scenario",
    place: "ScenarioMap",
    seed: int,
    index: int,
    end: int,
    *,
    splits: bool = False,
) -> "Planner":
    """Who plans a walk to the node ``end``; ``splits`` says that it begins or ends where no node was before."""
    from sidestep.planners.learned import load_planners
    from sidestep.planners.registry import find_planner

    if model is not None:
        learned = load_planners([model], problem, seed)
        if learned.index not in (None, index):
            raise SidestepError(f"the model in {model} remembers map {learned.index}, not {index}")
        if learned.index is not None and splits:
            raise SidestepError(f"the model in {model} remembers crossings; give --from and --to as nodes")
        learned.check_destination(end)
        who = learned.factories[name or "darp"](place, index) if name in (None, *learned.factories) else None
        if who is not None:
            return who
    return find_planner(name or "expected")


def _hand_over_journey(journey: "Journey", output: str, out: Path | None, by: float | None) -> None:
    """Print a planned walk through a town, or write it to a file."""
    from sidestep.routing.formats import route_geojson, route_gpx
    from sidestep.routing.serialise import itinerary

    if output == "png" and out is not None:
        from sidestep.plotting import route_map, save

        save(route_map(journey), out)
        return
    shown = {
        "json": lambda: print(json.dumps(itinerary(journey, by), indent=2, ensure_ascii=False)),
        "geojson": lambda: print(route_geojson(journey, by), end=""),
        "gpx": lambda: print(route_gpx(journey, by), end=""),
        "text": lambda: show_journey(itinerary(journey, by)),
    }
    hand_over(out, shown[output])


def show_walk(walk: "PlannedWalk") -> None:
    """Print a planned walk."""
    nodes = walk["nodes"]
    print(f"{walk['planner']} ({walk['level']}), if crowds are as expected:")
    table = new_table(">node", ">minutes", title="")
    for node, minutes in zip(nodes, walk["minutes"], strict=True):
        table.add_row(str(node), f"{minutes:.1f}")
    print_table(table)
    end = "" if walk["arrives"] else " without arriving"
    print(f"{len(nodes) - 1} streets, {walk['metres']:,.0f} m, {walk['expected_minutes']:.1f} min{end}")
    print(
        f"In {walk['futures']} simulated futures: median {walk['median_minutes']:.1f} min, 90 % within "
        f"{walk['p90_minutes']:.1f} min, {100 * walk['arrival_rate']:.1f} % arrive"
    )
    if walk["arrive_by"] is not None:
        print(f"Arrives within {walk['by_minutes']:g} min with probability {walk['arrive_by']:.2f}")


def show_journey(walk: "JourneyJson") -> None:
    """Print the way through a real place, turn by turn, and how long it may take."""
    low = "" if walk["objective"] is None else f", keeping low {objective_in_words(walk['objective'])}"
    print(f"{walk['planner']} ({walk['level']}), departing {walk['departs']}{low}, if crowds are as expected:")
    for end in (walk["origin"], walk["destination"]):
        if end["metres_away"] >= 1:
            print(f"{end['asked']} is {end['metres_away']:,.0f} m from the street")
    table = new_table("", "street", ">metres", ">minutes", "crowds", ">persons/m²", title="")
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
    print_table(table)
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
