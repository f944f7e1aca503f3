"""The report's verdicts and its page, from made-up results."""

import re

import pytest

from sidestep.experiments.report import JUDGED_FROM, claims, html


def row(
    minutes: float, *, saving: float | None = 0.0, best: float | None = 0.0, arrival: float = 1.0, gap: float = 0.0
) -> dict:
    return {
        "level": "position", "maps": JUDGED_FROM, "mean_minutes": minutes, "ci95": [minutes - 1, minutes + 1],
        "saving_vs_shortest_path": saving, "best_saving": best, "gap": gap, "gap_ci95": [gap, gap],
        "regret_minutes": 0.0, "arrival_rate": arrival, "median_minutes": minutes, "p90_minutes": minutes,
        "arrive_by": None, "difference_minutes": 0.0, "difference_ci95": [0.0, 0.0],
    }  # fmt: skip


def results(**changes: dict) -> dict:
    """Numbers like those of the paper, where every claim holds."""
    planners = {
        "random-walk": row(216.0, arrival=0.7),
        "random-progress": row(216.0),
        "shortest-path": row(150.0),
        "expected": row(75.0, gap=0.1),
        "clairvoyant": row(70.0, saving=0.5),
        "darp": row(75.0, saving=0.52, best=0.37),
        "darp-paper": row(76.0, gap=0.05),
    } | changes
    conditions = {"unblocked": "arima", "congested": "arima", "unblocked_forecast": "forecast"}
    return {
        key: {"scenario": key, "flows": flows, "maps": JUDGED_FROM, "walks": 5, "seed": 0, "planners": planners}
        for key, flows in (conditions | {"congested_forecast": "forecast"}).items()
    }


def verdicts(**changes: dict) -> list[str]:
    return [claim.verdict for claim in claims(results(**changes), 50_000)]


def test_the_papers_own_numbers_hold() -> None:
    assert verdicts() == ["holds"] * 7


@pytest.mark.parametrize(
    ("changes", "number", "verdict"),
    [
        ({"darp": row(75.0, saving=0.52, best=0.2)}, 0, "partly"),
        ({"darp": row(75.0, saving=0.4, best=0.37)}, 1, "partly"),
        ({"random-progress": row(100.0), "random-walk": row(900.0)}, 2, "fails"),
        ({"darp": row(100.0, saving=0.52, best=0.37)}, 3, "partly"),
        ({"darp": row(100.0, saving=0.52, best=0.37)}, 4, "partly"),
        ({"darp-paper": row(76.0, gap=0.2)}, 5, "fails"),
        ({"darp-paper": row(76.0, gap=0.05, arrival=0.9)}, 5, "fails"),
        ({"expected": row(75.0)}, 6, "fails"),
    ],
)
def test_other_numbers_do_not(changes: dict, number: int, verdict: str) -> None:
    assert verdicts(**changes)[number] == verdict


def test_too_few_maps_are_not_judged() -> None:
    few = {"darp-paper": row(76.0, gap=0.05) | {"maps": JUDGED_FROM - 1}}
    compared = results(**few)
    judged = claims(compared, 50_000)
    assert {claim.verdict for claim in judged} == {"not judged"}
    assert judged[0].ours == claims(results(), 50_000)[0].ours  # the numbers are there
    for claim in judged:
        assert f"judged from {JUDGED_FROM}" in claim.why


def test_savings_against_a_shortest_path_that_did_not_arrive_are_not_judged() -> None:
    lost = row(75.0, saving=None, best=None)
    found = claims(results(darp=lost, clairvoyant=lost), 50_000)
    assert [claim.verdict for claim in found] == ["not judged"] * 2 + ["holds"] * 4 + ["holds"]
    assert "saves –" in found[0].ours


def test_claims_give_the_numbers() -> None:
    found = claims(results(), 50_000)
    assert "37.3 %" in found[0].paper
    assert "37.0 %" in found[0].ours
    assert "216 minutes" in found[2].ours
    assert "30.0 % had not arrived" in found[2].ours
    assert found[3].ours == "-75 minutes (bound -70, shortest path -150)."
    assert "50,000 steps" in found[5].ours
    assert "0.0 % longer than the clairvoyant" in found[6].ours


def test_the_page_needs_no_other_file(tmp_path) -> None:
    compared = results()
    pictures = {key: tmp_path / f"{key}.png" for key in compared}
    for picture in pictures.values():
        picture.write_bytes(b"\x89PNG")
    page = html(compared, claims(compared, 50_000), pictures)
    assert page.count("<img") == len(compared)
    assert not re.search(r'(src|href)="(?!data:)', page)
    for claim in claims(compared, 50_000):
        assert claim.paper.replace("'", "&#x27;") in page
    assert page.count('<tr class="darp">') == len(compared)
    assert "<th>over the clairvoyant</th>" in page
    assert '<td class="text">random-walk</td>' in page
