"""The trade-off between time and crowds on a small grid."""

import pytest

from sidestep.errors import SidestepError
from sidestep.evaluation.compare import compare
from sidestep.experiments.trade_off import TradeOff, trade_off
from sidestep.planners.registry import PlannerError, choose_planners
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.reader import find_scenario

TINY = scenario("paper-congested", side=3, crowded_nodes=1)


@pytest.fixture(scope="module")
def found() -> TradeOff:
    return trade_off(TINY, planners=["clairvoyant", "clairvoyant"], weights=[5.0, 0.0], walks=3, seed=2)


def test_curves_are_in_the_order_of_the_weights(found) -> None:
    ((name, points),) = found.curves.items()
    assert name == "clairvoyant"
    assert [point["weight"] for point in points] == [0, 5]
    fast, empty = points
    assert fast["minutes"] <= empty["minutes"]
    assert fast["exposure"] >= empty["exposure"]
    assert found.shortest_path["weight"] is None
    assert found.shortest_path["exposure"] >= empty["exposure"]
    assert [point["arrival_rate"] for point in points] == [1, 1]


def test_the_same_walks_with_the_same_weight_cost_the_same(found) -> None:
    problem = find_scenario("paper-congested", side=3, crowded_nodes=1, objective="exposure=5")
    compared = compare(problem, choose_planners(problem, []).factories, maps=[0], walks=3, seed=2).to_json()
    assert compared["objective"] == {"time": 1, "distance": 0, "exposure": 5, "max_density": None}
    row, point = compared["planners"]["clairvoyant"], found.curves["clairvoyant"][1]
    assert (row["mean_minutes"], row["mean_exposure"]) == (point["minutes"], point["exposure"])
    assert row["mean_cost_minutes"] == pytest.approx(row["mean_minutes"] + 5 * row["mean_exposure"] / 60, rel=1e-4)


def test_the_json_and_the_texts_of_the_picture(found) -> None:
    said = found.to_json()
    assert (said["scenario"], said["walks"], said["seed"]) == ("paper-congested", 3, 2)
    assert (said["summary"], said["attribution"]) == (TINY.summary, "")
    assert said["curves"] == found.curves
    assert found.title.startswith("paper-congested, map 0, seed 2")
    assert TINY.summary in found.caption


def test_each_weight_is_reported() -> None:
    done = []
    trade_off(TINY, planners=["clairvoyant"], weights=[5.0, 0.0], walks=3, seed=2, on_weight=done.append)
    assert done == [0, 5]


@pytest.mark.parametrize("planner", ["darp", "astar"])
def test_planners_that_learn_or_are_unknown_are_refused(planner: str) -> None:
    with pytest.raises(PlannerError) as caught:
        trade_off(TINY, planners=[planner])
    assert caught.value.field == "planner"
    assert "--model" not in str(caught.value)  # a trade-off takes no model


@pytest.mark.parametrize("weights", [[1.0, 1.0], [-1.0], [1e9]])
def test_weights_that_cannot_be_are_refused(weights: list[float]) -> None:
    with pytest.raises(SidestepError):
        trade_off(TINY, planners=["clairvoyant"], weights=weights)


def test_pictures_of_towns_say_whose_streets_and_which_demand() -> None:
    point = {"weight": None, "minutes": 1.0, "exposure": 2.0, "metres": 3.0, "arrival_rate": 1.0}
    found = TradeOff(scenario("helsinki"), 5, 0, {}, point)
    assert "OpenStreetMap" in found.caption
    assert "demand 120 × the counts" in found.caption
    assert "demand 120 × the counts" in found.to_json()["synthetic"]
