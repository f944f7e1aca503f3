"""Measure how time and memory grow with the town: import, loading, one route, costs to go, training.

    python benchmarks/scale.py                                   10³, 10⁴ and 10⁵ crossings
    python benchmarks/scale.py --side 316 --part training --rounds 8
    python benchmarks/scale.py --side 316 --part plans --planner forecast
    python benchmarks/scale.py --side 316 --part plans --waits gates
    python benchmarks/scale.py --side 500 --part serving         what a server does, in seconds of a core

Towns are invented (`streets.py`). Their scenario is the one that `sidestep new` writes, with their streets and longer
horizons: 160 paired sensors crowd a smaller part of larger towns. Every part runs in a process of its own, so that its
peak of memory is its own.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from time import perf_counter, process_time, thread_time

import jax
import jax.numpy as jnp
import numpy as np
from streets import write

from sidestep.agent.presets import preset_for
from sidestep.agent.runs import train
from sidestep.crowds.live import LiveCount, LiveCounts
from sidestep.environment.cost_to_go import expected_cost_to_go
from sidestep.evaluation.compare import compare
from sidestep.network.formats import load_town, save_town
from sidestep.network.osm import import_osm
from sidestep.planners.base import walk_plan
from sidestep.planners.learned import trained_darp
from sidestep.planners.registry import choose_planners, find_planner
from sidestep.routing.request import RouteError
from sidestep.routing.router import Router
from sidestep.scenarios.episodes import instances, random_destinations
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.template import template

TOWNS = {32: (180, 5), 100: (360, 5), 316: (720, 15)}  # side: minutes of the horizon and of a slot
PAIRS, TURNS = 20, 4
EVENT_DAY = (  # as in helsinki
    ("crowding = 1", "crowding = 120"),
    ("uneven = 0.0", "uneven = 0.5"),
    ("reach = 150", "reach = 40"),
    ("streets_per_sensor = 1", "streets_per_sensor = 10"),
)


def invent(folder, side):
    write(folder / "town.osm.pbf", side)
    horizon, slot = TOWNS.get(side, (720, 15))
    text = template("town")
    for default, ours in (
        ('streets = "helsinki"', 'streets = "town.npz"'),
        ("horizon_minutes = 180", f"horizon_minutes = {horizon}"),
        ("slot_minutes = 5", f"slot_minutes = {slot}"),
        *((f"\n{line}", f"\n{event}") for line, event in EVENT_DAY),
    ):
        text = text.replace(default, ours)
    (folder / "scenario.toml").write_text(text, "utf-8")
    return {}


def importing(folder):
    began = perf_counter()
    town, _ = import_osm(folder / "town.osm.pbf")
    took = perf_counter() - began
    save_town(town, folder / "town.npz")
    return {"crossings": town.nodes, "streets": town.streets, "seconds": took}


def loading(folder):
    began = perf_counter()
    network = load_town(folder / "town.npz").network()
    network.length.block_until_ready()
    return {"segments": network.segments, "seconds": perf_counter() - began}


def environment(folder, destinations, level):
    """The scenario, its environment with recorded futures, and a walk to each of several destinations."""
    problem = find_scenario(folder / "scenario.toml")
    scenario_map = draw_map(problem, 0)
    nodes = random_destinations(scenario_map, destinations, 0)
    params = make_environment(problem, scenario_map, "test", destinations, level=level, destinations=nodes)
    return problem, params, instances(problem, scenario_map, params, destinations, destinations=nodes)


def milliseconds(run, turns=TURNS):
    """The best of several turns, which neighbours disturb least, after one that compiles."""
    jax.block_until_ready(run())
    times = []
    for _ in range(turns):
        began = perf_counter()
        jax.block_until_ready(run())
        times.append(1e3 * (perf_counter() - began))
    return min(times)


def routes(folder):
    """One route at a time: planning it, after everything is loaded and compiled."""
    began = perf_counter()
    _, params, todo = environment(folder, PAIRS, "position")
    jax.block_until_ready(params)
    found = {"prepared_seconds": perf_counter() - began}
    alone = [jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], todo) for k in range(PAIRS)]
    for planner in map(find_planner, ("shortest-path", "expected", "clairvoyant")):
        each = [
            milliseconds(partial(lambda p, one: np.asarray(p.plan(params, one).own), planner, one)) for one in alone
        ]
        found[planner.name] = {"median_ms": float(np.median(each)), "worst_ms": max(each)}
    return found


def costs_to_go(folder):
    """Costs to go to one destination, from everywhere at every hour, and a walk by them."""
    problem, params, todo = environment(folder, 1, "map")
    at_destination = (jnp.arange(params.network.nodes) == todo.destination[0])[None]
    tables = jax.jit(expected_cost_to_go)
    # In crowds that are denser times are others, but as long to work out.
    took = milliseconds(lambda: tables(params, at_destination, params.futures.hour[:1], params.expected), 2)
    planner = find_planner("greedy-map")
    plan = planner.plan(params, todo)
    walk = milliseconds(lambda: walk_plan(planner, params, plan, todo, jax.random.key(0), 1_000))
    return {"slots": problem.slots, "both_tables_ms": took, "walk_ms": walk}


def training(folder, rounds, walks, destinations):
    """Training by the preset, or to fewer destinations, and the agent's walks through held-out futures."""
    problem = find_scenario(folder / "scenario.toml")
    config = preset_for(problem, "default", "map")
    config = config.changed(rounds=min(rounds or config.rounds, config.rounds))
    if destinations:  # and two futures for each, as in the preset
        config = config.changed(destinations=destinations, futures=2 * destinations, fresh_futures=destinations)
    began, ended = perf_counter(), []
    run = train(problem, config, on_round=lambda _: ended.append(perf_counter() - began))
    peak = peak_gib()
    darp = trained_darp(run.model)
    planners = choose_planners(problem, []).factories | {"darp": lambda *_: darp}
    rows = compare(problem, planners, maps=[0], walks=walks).to_json()["planners"]
    later = float(np.median(np.diff(ended))) if len(ended) > 1 else ended[0]
    return {
        "destinations": config.destinations,
        "rounds": config.rounds,
        "first_round_ended": ended[0],
        "seconds": ended[-1],
        "seconds_a_round": later,
        "transitions_per_second": config.round_steps / later,
        "peak_gib": peak,
        "walks": walks,
        "minutes": {name: row["mean_minutes"] for name, row in rows.items()},
        "arrive": rows["darp"]["arrival_rate"],
        "darp_over_expected": [rows["darp"]["difference_minutes"], rows["darp"]["difference_ci95"]],
    }


def waiting(folder, waits):
    """The scenario where every tenth street is shut at night, or has a light; as it is where ``waits`` is None."""
    if waits is None:
        return folder / "scenario.toml"
    town = load_town(folder / "town.npz")
    tenth = np.arange(town.streets) % 10 == 0
    opening = tuple(np.where(tenth, "Mo-Su 06:00-22:00", "").tolist())
    column = {"opening": opening} if waits == "gates" else {"signals": tenth.astype(np.int16)}
    save_town(replace(town, **column), folder / f"{waits}.npz")
    text = (folder / "scenario.toml").read_text("utf-8").replace('"town.npz"', f'"{waits}.npz"')
    (folder / f"{waits}.toml").write_text(text + "\n[place.traffic]\n" * (waits == "signals"), "utf-8")
    return folder / f"{waits}.toml"


def plans(folder, planner, waits, futures, kilometres=2.0):
    """Whole plans by one planner, as `route` and the server make them: twice the same, and one from elsewhere."""
    scenario = waiting(folder, waits)
    began = perf_counter()
    router = Router(scenario)
    found = {"planner": planner, "waits": waits, "loaded_seconds": perf_counter() - began}
    scenario_map = draw_map(router.scenario, 0)
    crossings = random_destinations(scenario_map, 500, 0)[:, 0]
    position = np.asarray(scenario_map.network.position)[crossings]
    away = np.linalg.norm(position - position[0], axis=1)
    first, other = crossings[np.argsort(np.abs(away - 1_000 * kilometres))[:2]].tolist()
    for name, origin in (("first", first), ("again", first), ("elsewhere", other)):
        began = perf_counter()
        plan = router.plan(origin, int(crossings[0]), planner=planner, futures=futures)
        minutes = plan.expected_minutes
        found[name] = {"seconds": perf_counter() - began, "minutes": minutes, "peak_gib": peak_gib()}
    return found


def serving(folder):
    """Quick routes, each to another destination, and going on from counts, as on a server: ms and s of a core."""
    begun = process_time()
    router = Router(folder / "scenario.toml")
    network, found = draw_map(router.scenario, 0).network, {"loaded_seconds": process_time() - begun}
    now = datetime.now(UTC).replace(minute=30, second=0, microsecond=0)
    clock, quick = router.clock(now.replace(tzinfo=None)), router.quick
    quick.route(0, 1, clock)
    found |= {"segments": network.segments, "first_route_seconds": process_time() - begun}
    position, rng = np.asarray(network.position), np.random.default_rng(1)
    for kilometres in ((1, 2), (2.5, 5), (0, np.inf)):
        times = []
        while len(times) < PAIRS:
            one, other = rng.integers(0, network.nodes, 2).tolist()
            if np.isfinite(kilometres[1]):  # few places are near each other by chance
                away = np.linalg.norm(position - position[one], axis=1) / 1_000
                other = int(rng.choice(np.flatnonzero((away >= kilometres[0]) & (away < kilometres[1]))))
            at = thread_time()
            with suppress(RouteError):  # farther than the horizon
                quick.route(one, other, clock)
                times.append(1e3 * (thread_time() - at))
        found["{}-{} km".format(*kilometres)] = {"median_ms": float(np.median(times)), "worst_ms": max(times)}
    for name in ("first", "later"):
        begins, at = now - timedelta(hours=1), process_time()
        counts = tuple(LiveCount(sensor, begins, 3600.0, 700.0) for sensor in router.sensors)
        router.go_on_from(LiveCounts(counts, "UTC"), now.replace(tzinfo=None))
        found[f"{name}_going_on_seconds"] = process_time() - at
    at = thread_time()
    quick.route(0, 1, clock)
    found["route_after_counts_ms"] = 1e3 * (thread_time() - at)
    return found


PARTS = {"invent": invent, "import": importing, "load": loading, "routes": routes, "costs-to-go": costs_to_go}


def peak_gib():
    """Peak of this process; on Linux, what ``resource`` says begins with that of the one that started it."""
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 2**20


def part_of(options):
    """One part, in this process."""
    folder = Path(options.folder)
    if options.part == "training":
        return training(folder, options.rounds, options.walks, options.destinations)
    if options.part == "serving":
        return serving(folder) | {"peak_gib": peak_gib()}
    if options.part == "plans":
        return plans(folder, options.planner, options.waits, options.futures)
    if options.part == "invent":
        return invent(folder, options.side)
    return {"peak_gib": None} | PARTS[options.part](folder) | {"peak_gib": peak_gib()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--side", type=int, help="crossings along a side; by default 32, 100 and 316 in turn")
    parser.add_argument(
        "--part", choices=[*PARTS, "training", "plans", "serving"], help="by default all but the last two"
    )
    parser.add_argument("--planner", default="forecast", help="of plans")
    parser.add_argument("--waits", choices=["gates", "signals"], help="of plans: what every tenth street has")
    parser.add_argument("--futures", type=int, help="of plans; by default as many as the planner takes")
    parser.add_argument("--rounds", type=int, help="of training; by default the preset's")
    parser.add_argument("--walks", type=int, default=200, help="of the comparison after training")
    parser.add_argument("--destinations", type=int, help="that training learns; by default the preset's")
    parser.add_argument("--folder", help="where a town is kept between parts")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)  # in this process
    options = parser.parse_args()
    if options.here:
        print(json.dumps(part_of(options)))
        return
    for side in [options.side] if options.side else TOWNS:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(options.folder or temporary)
            folder.mkdir(exist_ok=True)
            known = ("invent", "import") if not (folder / "town.npz").exists() else ()
            parts = [*known, options.part] if options.part else [*PARTS, "training"]
            for part in dict.fromkeys(parts):
                again = ["--here", "--part", part, "--side", str(side), "--folder", str(folder)]
                for name in ("walks", "rounds", "destinations", "planner", "waits", "futures"):
                    again += [f"--{name}", str(getattr(options, name))] if getattr(options, name) else []
                done = subprocess.run([sys.executable, __file__, *again], check=True, stdout=subprocess.PIPE, text=True)
                if part != "invent":
                    print(f"{side}² {part}: {done.stdout.strip()}", flush=True)


if __name__ == "__main__":
    main()
