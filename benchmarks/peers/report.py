"""Write the tables of docs/peers.md from what campaign.py measured: ``python report.py RESULTS.json``."""

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

from registry import NEVER, RUNNING, SIDESTEP

PAGE = Path(__file__).parents[2] / "docs" / "peers.md"
BEGIN, END = "<!-- benchmarks/peers/report.py writes from here -->\n", "<!-- to here -->\n"
Runs = list[dict[str, Any]]


def tables(found: dict[str, Any]) -> str:
    """The part of the page that is written anew."""
    return "\n".join([*machine(found), *race(found), *paper_sizes(found), *absent(found), ""])


def machine(found: dict[str, Any]) -> Iterator[str]:
    """Where, when and with what it was measured."""
    here = found["machine"]
    yield f"`{found['command']}`, on {here['cores']} cores of {here['processor']}, {here['memory_gib']} GiB,"
    yield f"{here['system']}; a run ends after {found['limit_seconds']:g} s:"
    yield ""


def race(found: dict[str, Any]) -> Iterator[str]:
    """Seconds to the optimum, those who learn with masks and those who learn without apart."""
    runs = [run for run in found["runs"] if run["task"] == "congested"]
    maps = len({(run["seed"], run["map"]) for run in runs})
    yield f"### From process start to 1 % over the optimum (maps: {maps})"
    for masks, title in ((True, "Learning with masks"), (False, "Learning without")):
        peers = [peer["name"] for peer in found["peers"] if peer["masks"] == masks or peer["name"] == SIDESTEP.name]
        yield from ("", f"{title}:", "")
        yield (
            "| peer | cold, × Sidestep | warm, × | running, × | there, cold / warm / running | cold, s | warm, s | "
            "running, s | % over at the end, median (worst) | transitions/s | updates/s | peak, MiB |"
        )
        yield "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|"
        for peer in peers:
            yield row(peer, runs)


def row(peer: str, runs: Runs) -> str:
    """One peer's."""
    mine = [run for run in runs if run["peer"] == peer]
    if not mine:
        return f"| {peer} |{' – |' * 11}"
    by_state = {state: [run for run in mine if run["state"] in (state, NEVER)] for state in ("cold", "warm")}
    by_state[RUNNING] = [run for run in mine if run["state"] == RUNNING]
    alone = [run for run in mine if run["state"] != RUNNING]  # processes that learned several maps held more
    ratios = [times(ratio(each, ours(runs, state))) for state, each in by_state.items()]
    there = [reached(each) for each in by_state.values()]
    took = [shown(median(map(seconds, each))) if each else "–" for each in by_state.values()]
    over = [run["final_over_per_cent"] for run in mine]
    rates = [middle([run[name] for run in mine]) for name in ("transitions_per_second", "updates_per_second")]
    cells = [
        peer,
        *ratios,
        there[0] if len(set(there)) == 1 else " / ".join(there),
        *took,
        f"{share(median(over))} ({share(max(over))})",
        *rates,
        middle([run["peak_mib"] for run in alone]),
    ]
    return f"| {' | '.join(cells)} |"


def reached(runs: Runs) -> str:
    """How many got there."""
    return f"{sum(seconds(run) < math.inf for run in runs)} of {len(runs)}" if runs else "–"


def share(per_cent: float) -> str:
    """Per cent over the optimum; rounding of the walks may end below."""
    return f"{max(per_cent, 0.0):.2f}"


def middle(values: list[float | None]) -> str:
    """Median of those that are known."""
    known = [value for value in values if value is not None]
    return f"{median(known):,.0f}" if known else "–"


def ours(runs: Runs, state: str) -> Runs:
    """Sidestep's runs in a state."""
    return [run for run in runs if run["peer"] == SIDESTEP.name and run["state"] == state]


def seconds(run: dict[str, Any]) -> float:
    """To the optimum, from process start or, where it ran already, from taking up the map; infinite where never."""
    return run["seconds_to_enough"] or math.inf


def ratio(theirs: Runs, own: Runs) -> float:
    """Median over maps of their seconds over Sidestep's."""
    took = {(run["seed"], run["map"]): seconds(run) for run in own}
    both = [(seconds(run), took[run["seed"], run["map"]]) for run in theirs if (run["seed"], run["map"]) in took]
    each = [math.inf if math.isinf(one) else one / other for one, other in both]
    return median(each) if each else math.nan


def times(value: float) -> str:
    """A ratio as people read it."""
    return "–" if math.isnan(value) else "never" if math.isinf(value) else f"{value:.2f}"


def shown(value: float) -> str:
    """Seconds as people read them."""
    return "never" if math.isinf(value) else f"{value:.2f}"


def paper_sizes(found: dict[str, Any]) -> Iterator[str]:
    """Microseconds of a step with its gradient step."""
    runs = [run for run in found["runs"] if run["task"] == "paper"]
    step: dict[str, dict[int, float]] = {}
    for run in runs:
        if run["microseconds_a_step"]:
            step.setdefault(run["peer"], {})[run["seed"]] = run["microseconds_a_step"]
    yield from ("", "### A step at the paper's sizes, on one core", "")
    yield "| peer | × Sidestep (range over turns) | µs a step (range) | peak, MiB |"
    yield "|---|--:|--:|--:|"
    own = step.get(SIDESTEP.name, {})
    for peer, mine in sorted(step.items(), key=lambda each: median(each[1].values())):
        over = [mine[turn] / own[turn] for turn in mine if turn in own]
        memory = median(run["peak_mib"] for run in runs if run["peer"] == peer)
        yield f"| {peer} | {ranged(over, 2)} | {ranged(list(mine.values()), 1)} | {memory:,.0f} |"


def ranged(values: list[float], digits: int) -> str:
    """Median and range."""
    if not values:
        return "–"
    return f"{median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def absent(found: dict[str, Any]) -> Iterator[str]:
    """Versions, and who is not there."""
    versions: dict[str, dict[str, str]] = {}
    for run in found["runs"]:
        versions.setdefault(run["peer"], run["versions"] | {"Python": run["python"]})
    yield from ("", "### Versions", "")
    for peer, each in versions.items():
        yield f"- {peer}: {', '.join(f'{name} {version}' for name, version in each.items())}"
    yield from ("", "### Absent", "")
    for name, reason in found["absent"].items():
        yield f"- {name}: {reason}."
    for name, reason in found["skipped"].items():
        yield f"- {name} did not install here: {reason}."
    for name, task, state, seed, index, reason in found["failed"]:
        yield f"- {name} failed ({task}, {state}, seed {seed}, map {index}): {reason}"


def main() -> None:
    found = json.loads(Path(sys.argv[1]).read_text())
    before, _, rest = PAGE.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n{tables(found)}\n{END}{after}")


if __name__ == "__main__":
    main()
