"""What commands print on terminals of 80, 100 and 140 columns: everything fits, and every name is whole."""

import json
import re

import pytest

from sidestep.cli import app as cli
from sidestep.cli.compare import show_results
from sidestep.evaluation.compare import Comparison, compare
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.walkers import WALKERS

GRID = ("paper-congested", "--side", "3", "--crowded-nodes", "1")
TINY = scenario("paper-congested", side=3, crowded_nodes=1, horizon=3600.0)
PLANNERS = ("random-walk", "random-progress", "shortest-path", "expected", "clairvoyant")
WIDTHS = (80, 100, 140)


@pytest.fixture(scope="module")
def compared() -> Comparison:
    """Walks of planners with long names, some of which walk one map only."""
    chosen = choose_planners(TINY, PLANNERS).factories
    last = chosen["random-walk"]
    chosen["darp-of-a-long-folder"] = lambda drawn, index: last(drawn, index) if index < 1 else None
    return compare(TINY, chosen, maps=[0, 1], walks=3)


def check(lines: list[str], width: int, names: list[str]) -> str:
    """Nothing is wider than the terminal, and each name is in one line; returns the text."""
    assert max(map(len, lines)) <= width
    text = "\n".join(lines)
    for name in names:
        assert re.search(rf"(^|  ){re.escape(name)}(  |$)", text, re.MULTILINE), (name, text)
    return text


@pytest.mark.parametrize("width", WIDTHS)
def test_comparisons_fit_and_name_every_planner(screen, compared, width: int) -> None:
    result = compared.to_json(60.0)
    names = [*PLANNERS, "darp-of-a-long-folder (1 map)"]
    text = check(screen(width, lambda: show_results(result)), width, [*names, "minutes", "arrive"])
    left_out = text.partition("Left out: ")[2].partition(".")[0].replace("\n", " ")
    kept = {80: "clairvoyant", 100: "saved", 140: "95 %"}[width]
    assert ({80: "saved", 100: "95 %", 140: "90 % in"}[width] in left_out, kept in left_out) == (True, False)
    assert "\u2013" in text or width == 80  # nothing is saved: the shortest path did not arrive


def test_comparisons_of_walkers_and_costs_fit(screen, compared) -> None:
    costly = json.loads(json.dumps(compared.to_json()))
    costly["objective"] = {"time": 1, "distance": 0, "exposure": 2, "max_density": 3}
    for row in costly["planners"].values():
        row |= {"mean_cost_minutes": 12345.6, "mean_exposure": 123456.0, "mean_metres": 12345.0, "mean_too_dense": 42.5}
    older = costly | {"walker": WALKERS["older"]().model_dump()}
    for width in WIDTHS:
        text = check(screen(width, lambda: show_results(costly, older)), width, ["adult", "older", *PLANNERS, "cost"])
        assert text.count("  shortest-path ") == 2


def test_in_pipes_nothing_is_left_out(compared, capsys, monkeypatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    show_results(compared.to_json(60.0))
    out = capsys.readouterr().out
    assert "Left out" not in out
    assert all(re.search(rf"\b{word}", out) for word in ("knows", "median", "saved", "95 %", "clairvoyant", "60 min"))


@pytest.mark.parametrize(
    ("command", "names", "widths"),
    [
        (("planners",), [*PLANNERS, "greedy-local", "lrta-star", "darp", "tabular-q"], WIDTHS),
        (("scenarios",), list(BUILT_IN), WIDTHS),
        (("walkers",), list(WALKERS), WIDTHS),
        (("counts", "c.csv", "--out", "clean.csv"), ["dead sensor", "a-sensor-with-a-long-name"], WIDTHS),
        (("trade-off", *GRID, "--weights", "0,5", "--walks", "3", "--out", "t.png"), ["shortest-path"], (80,)),
        (("matrix", *GRID, *(f"--from={node}" for node in range(9))), ["9  node 8"], (80,)),
        (("when", *GRID, "--until", "10", "--futures", "3"), ["departure"], (80,)),
        (("crowds", *GRID), ["free", "jammed"], (80,)),
        (("isochrone", *GRID), ["5 min"], (80,)),
    ],
    ids=lambda value: value[0] if isinstance(value[0], str) else "",
)
def test_tables_of_commands_fit(screen, monkeypatch, tmp_path, command, names, widths) -> None:
    monkeypatch.chdir(tmp_path)
    hours = [f"2024-01-{1 + hour // 24:02}T{hour % 24:02},{hour % 7},{9 * (hour < 24)}" for hour in range(600)]
    (tmp_path / "c.csv").write_text("\n".join(["time,a,a-sensor-with-a-long-name", *hours, ""]))
    for width in widths:
        check(screen(width, lambda: cli.run(command)), width, names)
