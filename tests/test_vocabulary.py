"""One word for one thing: words that were retired do not come back (docs/architecture.md has those that stay)."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
RETIRED = {
    r"\bCrowdedMap\b": "ScenarioMap",
    r"\b(goals_of|set_out|put_crowds|new_crowds|beginning\()": "destinations_of, replace_futures, sample_futures",
    r"\b(UsualToGo|LiveToGo|usual_to_go|live_to_go)\b": "ExpectedCostToGo, LiveCostToGo",
    r"\b(surprise|heavier)\b": "log_density_ratio, cost_to_go_scaled",
    r"\brivals?\b": "baseline",
    r"\btall(y|ies)\b": "totals",
    r"\b(side_by_side|cheapest_way|unlit)\b": "disjoint_union, least_cost_path, with_mean_waits",
    r"\b(Spliced?|Snapped|splice)\b": "SplitStreets, StreetPoint, split_streets",
    r"\b(foresee|itinerary|Trip|Journey)\b": "plan_route, RouteRequest, RoutePlan",
    r"\bgoals? modulo\b|\bmodulo goals\b": "Futures.destination",
    r"\b(whoever|lest|reckon(s|ed|ing)?)\b": "plain English",
}


def pages() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "src", "docs", "README.md", "CONTRIBUTING.md", "benchmarks", "scripts", "examples"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split()  # fmt: skip
    return [ROOT / name for name in listed if name.endswith((".py", ".pyi", ".md", ".toml"))]


@pytest.mark.parametrize(("words", "instead"), RETIRED.items())
def test_retired_words_stay_away(words: str, instead: str) -> None:
    retired = re.compile(words)
    found = [
        f"{page.relative_to(ROOT)}:{number}: {line.strip()}"
        for page in pages()
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), start=1)
        if retired.search(line)
    ]
    assert not found, f"say {instead}: {found}"
