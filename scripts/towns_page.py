"""Train agents in towns, compare them with the planners, and renew the tables of docs/towns.md and docs/traffic.md.

Usage: python scripts/towns_page.py FOLDER [--elsewhere SCENARIO]

What is in FOLDER already is neither trained nor walked again.
``--elsewhere`` also lets the agents of level `map` walk another town, given as a scenario file.
"""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from trainings import DOCS, SEEDS, agents_table, costs, kept, models, planners_table, swept

from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Row
from sidestep.evaluation.trainings import mean_rows
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.reader import find_scenario

WALKS = 500
PAGES = {"towns.md": "helsinki", "traffic.md": "helsinki-signals"}
CROWDINGS = (30, 60, 120)
ELSEWHERE = ("expected", "greedy-map", "darp", "clairvoyant")
BEGIN, END = "<!-- scripts/towns_page.py writes the results of {} from here -->\n", "<!-- to here -->\n"


def main() -> None:
    """Train, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--elsewhere", metavar="SCENARIO", help="scenario file of another town")
    options = parser.parse_args()
    folder: Path = options.folder
    found = swept("towns", folder)
    for page, scenario in PAGES.items():
        compared = [each.to_json() for each in found.comparisons[scenario]]
        text = costs(found, scenario) + planners_table(compared)
        renew(DOCS / page, scenario, f"{text}\n{agents_table(compared)}")
    if options.elsewhere:
        agents = models(found, folder, "helsinki", "map")
        rows = kept(folder / "elsewhere.json", partial(elsewhere, options.elsewhere, agents))
        renew(DOCS / "towns.md", "another town", elsewhere_table(rows))


def elsewhere(place: str, agents: list[Path]) -> dict[str, Any]:
    """Another town at some crowdings: comparisons, one for each seed."""
    found: dict[str, Any] = {}
    for crowding in CROWDINGS:
        problem = find_scenario(place, crowding=float(crowding))
        found[str(crowding)] = []
        for seed, model in zip(SEEDS, agents, strict=True):
            chosen = choose_planners(problem, ELSEWHERE[1:2], models=[model], seed=seed)
            compared = compare(problem, chosen.factories, maps=[0], walks=WALKS, seed=seed)
            found[str(crowding)].append(compared.to_json())
    return found


def elsewhere_table(found: dict[str, Any]) -> str:
    """Means over the seeds, and what the agents differ by from the plan made beforehand."""
    text = f"| `--crowding` | {' | '.join(ELSEWHERE)} | darp over expected (95 %) | each seed (95 % over its walks) |\n"
    text += f"|--:|{'--:|' * len(ELSEWHERE)}--:|---|\n"
    for crowding, results in found.items():
        rows = mean_rows(results)
        differences = [difference(row) for row in (rows["darp"], *(each["planners"]["darp"] for each in results))]
        minutes = [f"{rows[name]['mean_minutes']:.2f}" for name in ELSEWHERE]
        text += f"| {crowding} | {' | '.join(minutes)} | {differences[0]} | {', '.join(differences[1:])} |\n"
    return text


def difference(row: Row) -> str:
    """A row's difference from the baseline, with its interval."""
    return "{:+.2f} ({:+.2f} to {:+.2f})".format(row["difference_minutes"], *row["difference_ci95"])


def renew(page: Path, what: str, text: str) -> None:
    """Put a text between a page's two marks."""
    begin = BEGIN.format(what)
    before, after = page.read_text(encoding="utf-8").split(begin)  # fails where the page lacks the mark
    write_text(page, f"{before}{begin}\n{text}\n{END}{after.split(END, 1)[1]}")


if __name__ == "__main__":
    main()
