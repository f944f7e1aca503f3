"""One planned walk: its route, its metres, and how long it may take; and what cannot be planned."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from sidestep.routing.grid_plan import Foresight, RouteError, foresee

from sidestep.planners.random import RandomWalk
from sidestep.planners.reactive import GreedyMap
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import Scenario

FUTURES = 9


@pytest.fixture(scope="module")
def small() -> tuple[Scenario, ScenarioMap]:
    problem = scenario("rush-16", side=3, crowded_nodes=1, horizon=2 * 3600.0)
    return problem, draw_map(problem, 2)


def ahead(small, planner, origin: int = 0, destination: int = 8, departure: float = 900.0, futures: int = FUTURES):
    return foresee(*small, planner, origin=origin, destination=destination, departure=departure, futures=futures)


@pytest.fixture(scope="module", params=[Expected(), GreedyMap()], ids=lambda each: each.name)
def planned(request, small) -> Foresight:
    return ahead(small, request.param)


def test_the_route_leads_from_origin_to_destination(small, planned) -> None:
    distance = np.asarray(small[1].network.distance_matrix())
    found = planned.as_json()
    steps = list(pairwise(found["nodes"]))
    assert (found["nodes"][0], found["nodes"][-1], found["arrives"]) == (0, 8, True)
    assert all(distance[step] > 0 for step in steps)
    assert found["metres"] == pytest.approx(sum(distance[step] for step in steps))
    assert (found["planner"], found["level"]) == (planned.planner.name, planned.planner.level)


def test_minutes_count_from_the_departure(planned) -> None:
    found = planned.as_json()
    assert len(found["minutes"]) == len(found["nodes"])
    assert found["minutes"][0] == 0
    assert (np.diff(found["minutes"]) > 0).all()
    assert found["minutes"][-1] == pytest.approx(found["expected_minutes"], rel=1e-4)


def test_quantiles_are_those_of_the_futures(planned) -> None:
    found = planned.as_json()
    assert found["futures"] == FUTURES == len(planned.minutes) == len(planned.arrived)
    assert 0 < planned.minutes.min() <= found["median_minutes"] <= found["p90_minutes"] <= planned.minutes.max() <= 120
    # of nine, the fifth
    assert found["median_minutes"] == sorted(planned.minutes)[4]
    assert len(set(planned.minutes.tolist())) > 1
    assert found["arrival_rate"] == planned.arrived.mean()


def test_the_later_the_surer(planned) -> None:
    limits = [0.0, *sorted(planned.minutes.tolist()), 1e4]
    shares = [planned.as_json(by)["arrive_by"] for by in limits]
    assert shares == sorted(shares)
    # nobody at once, one more by the time of each, and all that arrive in the end
    assert shares[0] == 0
    assert shares[5] == pytest.approx(5 / 9)
    assert shares[-1] == planned.arrived.mean() == 1
    assert planned.as_json(7.5)["by_minutes"] == 7.5
    found = planned.as_json()
    assert (found["by_minutes"], found["arrive_by"]) == (None, None)


def test_where_the_forecast_comes_true_there_is_one_future(small) -> None:
    problem, place = small
    found = ahead((replace(problem, flows="forecast"), place), Expected())
    assert len(found.minutes) == 1
    assert found.minutes[0] == pytest.approx(found.route.seconds / 60, rel=1e-5)
    # and it is the route that is planned where crowds are drawn
    assert found.route == ahead(small, Expected()).route


def test_expected_takes_the_time_that_it_expects(small) -> None:
    # If crowds are as expected, hindsight knows no better; in single futures it does.
    planned, hindsight = ahead(small, Expected()), ahead(small, Clairvoyant())
    assert planned.route == hindsight.route
    assert (hindsight.minutes <= planned.minutes * (1 + 1e-5)).all()


def test_any_walk_will_do(small) -> None:
    back = ahead(small, Expected(), origin=7, destination=1, departure=0.0)
    assert (back.route.nodes[0], back.route.nodes[-1]) == (7, 1)
    assert back.route.clocks[0] == 0
    # from a node to itself no step is taken
    stay = ahead(small, Expected(), origin=4, destination=4).as_json(0.0)
    assert (stay["nodes"], stay["minutes"], stay["metres"], stay["expected_minutes"]) == ([4], [0], 0, 0)
    assert (stay["arrival_rate"], stay["arrive_by"]) == (1, 1)


def test_the_same_walk_is_foreseen_again(small) -> None:
    first, again = (ahead(small, Expected()) for _ in range(2))
    assert first.as_json(20.0) == again.as_json(20.0)


def test_who_wanders_may_not_arrive(small) -> None:
    problem, place = small
    # a minute is too short for anyone
    found = ahead((replace(problem, horizon=60.0), place), RandomWalk(), departure=0.0).as_json(0.5)
    assert (found["arrives"], found["arrival_rate"], found["arrive_by"]) == (False, 0, 0)
    assert found["expected_minutes"] == found["median_minutes"] == found["p90_minutes"] == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(origin=-1), "there is no node -1 to be the origin; nodes are numbered 0 to 8"),
        (dict(origin=9), "there is no node 9 to be the origin; nodes are numbered 0 to 8"),
        (dict(destination=9), "there is no node 9 to be the destination; nodes are numbered 0 to 8"),
        (dict(departure=-60.0), "the departure must lie between 0 and 120 minutes, not -1"),
        (dict(departure=7200.0), "the departure must lie between 0 and 120 minutes, not 120"),
        (dict(departure=float("nan")), "the departure must lie between 0 and 120 minutes, not nan"),
        (dict(futures=0), "there must be at least one future, not 0"),
        (dict(futures=-3), "there must be at least one future, not -3"),
    ],
)
def test_walks_that_cannot_be(small, changes: dict, message: str) -> None:
    with pytest.raises(RouteError) as error:
        ahead(small, Expected(), **changes)
    assert str(error.value) == message
