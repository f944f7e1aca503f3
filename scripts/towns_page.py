"""Train agents in towns, compare them with the planners, and renew the tables of docs/towns.md and docs/traffic.md.

Usage: python scripts/towns_page.py FOLDER [--elsewhere SCENARIO] [--walks N]

Models that are in FOLDER already are not trained again, and comparisons that are there are not walked again.
``--elsewhere`` also lets the agents of level `map` walk another town, given as a scenario file.
"""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from trainings import DOCS, SEEDS, Case, agents_table, costs, kept, planners_table

from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import Row
from sidestep.evaluation.trainings import mean_rows
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.reader import find_scenario

PLANNERS = ("shortest-path", "expected", "greedy-map", "snapshot", "forecast", "clairvoyant")
WALKS = 500
PAGES = {
    "towns.md": Case("helsinki", ("map", "live"), WALKS, PLANNERS),
    "traffic.md": Case("helsinki-signals", ("map",), WALKS, PLANNERS),
}
CROWDINGS = (30, 60, 120)
ELSEWHERE = ("expected", "greedy-map", "darp", "clairvoyant")
BEGIN, END = "<!-- scripts/towns_page.py writes the results of {} from here -->\n", "<!-- to here -->\n"


def main() -> None:
    """Train, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--elsewhere", metavar="SCENARIO", help="scenario file of another town")
    parser.add_argument("--walks", type=int, help="instead of 500")
    options = parser.parse_args()
    folder: Path = options.folder
    for page, case in PAGES.items():
        found = kept(folder / f"{case.scenario}.json", partial(run, case, folder / case.scenario, options.walks))
        text = costs(case.scenario, found["trained"]) + planners_table(found["compared"])
        renew(DOCS / page, case.scenario, f"{text}\n{agents_table(found['compared'])}")
    if options.elsewhere:
        models = [PAGES["towns.md"].models(folder / "helsinki", seed)[0] for seed in SEEDS]
        found = kept(folder / "elsewhere.json", partial(elsewhere, options.elsewhere, models, options.walks or WALKS))
        renew(DOCS / "towns.md", "another town", elsewhere_table(found))


def run(case: Case, folder: Path, walks: int | None) -> dict[str, Any]:
    """One scenario: its models, then one comparison of all for each seed."""
    took = case.trained(folder)
    return {"trained": took, "compared": [each.to_json() for each in case.compared(folder, walks)]}


def elsewhere(place: str, models: list[Path], walks: int) -> dict[str, Any]:
    """Another town at some crowdings: comparisons, one for each seed."""
    found: dict[str, Any] = {}
    for crowding in CROWDINGS:
        problem = find_scenario(place, crowding=float(crowding))
        found[str(crowding)] = []
        for seed, model in zip(SEEDS, models, strict=True):
            chosen = choose_planners(problem, ELSEWHERE[1:2], models=[model], seed=seed)
            compared = compare(problem, chosen.factories, maps=[0], walks=walks, seed=seed)
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
