"""The report of the reproduction: the paper's claims beside what we measured, as one HTML file that needs no other."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Literal

from sidestep.evaluation.compare import Results
from sidestep.evaluation.metrics import HEADINGS, PAPER_COLUMNS, TEXT_COLUMNS, Row, cells, percent

STYLE = """
body { font: 16px/1.55 system-ui, sans-serif; color: #1f2933; max-width: 70rem; margin: 2rem auto; padding: 0 1rem }
h1, h2 { line-height: 1.2 } h2 { margin-top: 2.5rem }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 0.92rem }
th, td { text-align: right; padding: 0.35rem 0.6rem; border-bottom: 1px solid #d9e2ec; vertical-align: top }
td:not(.text) { white-space: nowrap }
th:first-child, td:first-child, td.text, th.text { text-align: left }
tr.darp { font-weight: 600 }
.holds { color: #2d6a4f } .fails { color: #b02a37 } .partly { color: #a15c00 } .not.judged { color: #52606d }
img { max-width: 100%; margin: 1rem 0 } .note { color: #52606d; font-size: 0.92rem }
"""


Verdict = Literal["holds", "partly", "fails", "not judged"]
JUDGED_FROM = 20
"""Least number of maps whose means a claim is judged by. By as many, the saving under congestion is known to 4 points
(standard error), of the 5 that it may differ by; two maps say nothing."""


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, and what we found."""

    paper: str
    """What the paper says."""

    ours: str
    """What we measured."""

    verdict: Verdict
    """``not judged`` where the maps are too few, or nothing can be said to be saved."""

    why: str


def claims(results: Mapping[str, Results], literal_steps: int) -> list[Claim]:
    """Set what we measured beside the paper's claims, and judge these where there are maps enough.

    Parameters
    ----------
    results
        Comparisons by condition. The paper's flows are forecasts, so its numbers are judged by these conditions.
    literal_steps
        Number of steps that the ``paper`` preset learned on each map.

    Returns
    -------
    list of Claim
        In the order of the paper; the maps are too few to judge if any planner walked fewer than ``JUDGED_FROM``.
    """
    found = _found(results, literal_steps)
    fewest = min(row["maps"] for compared in results.values() for row in compared["planners"].values())
    if fewest >= JUDGED_FROM:
        return found
    few = f"Too few maps (as few as {fewest}): claims are about means over maps, judged from {JUDGED_FROM} on."
    return [replace(claim, verdict="not judged", why=few) for claim in found]


def _found(results: Mapping[str, Results], literal_steps: int) -> list[Claim]:
    """The claims with what was found, however few the maps."""
    free, jam, noisy = (results[key]["planners"] for key in ("unblocked_forecast", "congested_forecast", "congested"))
    darp_free, darp_jam, literal_free, literal_jam = free["darp"], jam["darp"], free["darp-paper"], jam["darp-paper"]
    progress, walk = jam["random-progress"], jam["random-walk"]
    of_progress, of_walk = (1 - darp_jam["mean_minutes"] / row["mean_minutes"] for row in (progress, walk))

    def saving(row: Row) -> str:
        return percent(row["saving_vs_shortest_path"])

    def minutes(rows: Mapping[str, Row]) -> str:
        darp, bound, shortest = (rows[name]["mean_minutes"] for name in ("darp", "clairvoyant", "shortest-path"))
        return f"-{darp:.0f} minutes (bound -{bound:.0f}, shortest path -{shortest:.0f})."

    return [
        Claim(
            "Unblocked: saves up to 37.3 % of the shortest path's time in the best cases.",
            f"Best map {percent(darp_free['best_saving'])}, mean {saving(darp_free)}; "
            f"the best possible walk saves {saving(free['clairvoyant'])} in the mean.",
            _verdict(darp_free["best_saving"], 0.373, 0.06),
            "Any optimal planner saves as much: it is a property of the maps. The distance to the bound counts.",
        ),
        Claim(
            "Congested: saves 52.1 % of the shortest path's time.",
            f"{saving(darp_jam)} in the mean; the best possible walk saves {saving(jam['clairvoyant'])}.",
            _verdict(darp_jam["saving_vs_shortest_path"], 0.521, 0.05),
            "With four crowded nodes, which the paper does not say; with others it is another number.",
        ),
        Claim(
            "Congested: saves 65.3 % of random selection's time (216 minutes, if DARP takes 75).",
            f"{percent(of_progress)} of a random path of fewest segments ({progress['mean_minutes']:.0f} minutes), "
            f"{percent(of_walk)} of a random walk ({walk['mean_minutes']:.0f} minutes or more: "
            f"{percent(1 - walk['arrival_rate'])} had not arrived when the horizon was over).",
            "holds" if min(abs(of_progress - 0.653), abs(of_walk - 0.653)) < 0.03 else "fails",
            "Neither reading of random selection takes about 216 minutes.",
        ),
        Claim(
            "Unblocked: converges at about -67 after about 10 rounds.",
            minutes(free),
            _verdict(darp_free["mean_minutes"], 67, 15),
            "One map more or less makes 15 minutes; the paper shows one. Read as minutes, the size agrees.",
        ),
        Claim(
            "Congested: about -75, hardly more than unblocked, after about 15 rounds.",
            minutes(jam),
            _verdict(darp_jam["mean_minutes"], 75, 18),
            "A detour around four nodes costs a few minutes, so the walker hardly notices.",
        ),
        Claim(
            "The settings as printed (γ = 0.95, RMSProp 1e-4, position as x and y) learn this.",
            f"Congested, after {literal_steps:,} steps: {percent(literal_jam['arrival_rate'])} of the walks arrive, "
            f"mean {literal_jam['mean_minutes']:.0f} minutes; unblocked {percent(literal_free['arrival_rate'])} "
            f"arrive, mean {literal_free['mean_minutes']:.0f} ({literal_jam['maps']} maps).",
            "holds" if literal_jam["arrival_rate"] > 0.99 and literal_jam["gap"] < 0.1 else "fails",
            "γ = 0.95 makes walking to and fro on a cheap street worth more than a long way to the destination.",
        ),
        Claim(
            "The agent can dynamically adjust its strategy to changing flows.",
            f"With noise in the flows the position-level agent takes {percent(noisy['darp']['gap'])} longer than the "
            f"clairvoyant; the best fixed plan (expected) takes {percent(noisy['expected']['gap'])} longer.",
            "holds" if noisy["darp"]["gap"] < noisy["expected"]["gap"] - 0.003 else "fails",
            "Its state is the position alone: it sees neither clock nor crowd, and repeats one route. At best it is as "
            "good as the best fixed plan.",
        ),
    ]


def _verdict(ours: float | None, paper: float, tolerance: float) -> Verdict:
    if ours is None:  # the shortest path did not always arrive
        return "not judged"
    return "holds" if abs(ours - paper) <= tolerance else "partly"


def html(results: Mapping[str, Results], claims: Sequence[Claim], pictures: Mapping[str, Path]) -> str:
    """Write the whole report as the text of one HTML file.

    Parameters
    ----------
    results
        Comparisons by condition.
    claims
        The paper's claims, judged.
    pictures
        Files of the learning curves by condition.

    Returns
    -------
    str
        The file's text; pictures are part of it.
    """
    first = next(iter(results.values()))
    sections = "".join(_section(key, compared, pictures[key]) for key, compared in results.items())
    judged = "".join(
        f'<tr><td class="text">{escape(claim.paper)}</td><td class="text">{escape(claim.ours)}</td>'
        f'<td class="text {claim.verdict}">{claim.verdict}</td><td class="text">{escape(claim.why)}</td></tr>'
        for claim in claims
    )
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Sidestep: the paper's system, reproduced</title><style>{STYLE}</style>
<h1>The paper's system, reproduced</h1>
<p>Geng, Liu, Wang, Liu: <em>Deep Reinforcement Learning Based Dynamic Route Planning for Minimizing Travel Time</em>,
2020. {first["maps"]} maps a condition, {first["walks"]} walks a map, seed {first["seed"]}. All planners walk the same
maps through the same crowds. The docstring of <code>sidestep.experiments.paper</code> lists what we had to decide or
correct. <em>Saved</em> is against <code>shortest-path</code>; the clairvoyant knows the future and bounds all
others.</p>
<h2>What holds</h2>
<table><tr><th class="text">The paper</th><th class="text">Here</th><th class="text">Verdict</th>
<th class="text">Why</th></tr>{judged}</table>
{sections}
<p class="note">Flows: ARIMA(1, 0, 0) fitted to 45 Queen Street, Auckland, 2024. Counts: Heart of the City Auckland,
CC BY 4.0.</p></html>
"""


def _section(key: str, compared: Results, picture: Path) -> str:
    flows = "with the ARIMA model's noise" if compared["flows"] == "arima" else "forecasts only"
    rows = "".join(_table_row(name, row, compared["maps"]) for name, row in compared["planners"].items())
    image = base64.b64encode(picture.read_bytes()).decode()
    name = escape(key.partition("_")[0].capitalize())
    return f"""<h2>{name} streets, {flows}</h2>
<table><tr>{"".join(f"<th{_text(column)}>{HEADINGS[column]}</th>" for column in PAPER_COLUMNS)}</tr>{rows}</table>
<img alt="Learning curves: {name}, {flows}" src="data:image/png;base64,{image}">
"""


def _table_row(name: str, row: Row, maps: int) -> str:
    marked = ' class="darp"' if name == "darp" else ""
    texts = (f"<td{_text(column)}>{escape(text)}</td>" for column, text in cells(name, row, maps).items())
    return f"<tr{marked}>{''.join(texts)}</tr>"


def _text(column: str) -> str:
    return ' class="text"' if column in TEXT_COLUMNS else ""
