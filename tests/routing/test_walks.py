"""Walks through expected crowds and simulated futures, on grids and in a small town."""

from collections.abc import Callable
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.planners.random import RandomWalk
from sidestep.planners.reactive import Forecast
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import RouteError
from sidestep.routing.router import Router
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import ObjectiveSpec, Scenario
from sidestep.walking.speed_laws import FREE_SPEED, Weidmann

FUTURES, SLOW = 9, 2.0
SMALL = scenario("rush-16", side=3, crowded_nodes=1, horizon=2 * 3600.0)


@pytest.fixture(scope="module")
def plans() -> Callable[..., RoutePlan]:
    def make(
        planner="expected", problem: Scenario = SMALL, origin=0, destination=8, depart=15, futures=FUTURES, by=None
    ):
        return Router(problem, seed=2).plan(origin, destination, depart=depart, planner=planner, futures=futures, by=by)

    return make


@pytest.fixture(scope="module", params=["expected", "greedy-map", "snapshot"])
def planned(request, plans) -> RoutePlan:
    return plans(request.param)


def test_the_route_leads_from_origin_to_destination(planned) -> None:
    network = draw_map(SMALL, 2).network
    distance = np.asarray(network.distance_matrix())
    steps = list(pairwise(planned.nodes))
    assert (planned.nodes[0], planned.nodes[-1], planned.arrives) == (0, 8, True)
    assert all(distance[step] > 0 for step in steps)
    assert planned.metres == pytest.approx(sum(distance[step] for step in steps))
    for leg, (tail, head) in zip(planned.legs, steps, strict=True):
        assert (network.tail[leg.segment], network.head[leg.segment]) == (tail, head)
    assert planned.level == {"snapshot": "live"}.get(planned.planner, "map")


def test_minutes_count_from_the_departure(planned) -> None:
    assert len(planned.minutes) == len(planned.nodes) == len(planned.legs) + 1
    assert planned.minutes[0] == 0
    assert np.diff(planned.minutes) == pytest.approx([leg.minutes for leg in planned.legs])
    assert planned.minutes[-1] == pytest.approx(planned.expected_minutes, rel=1e-4)


def test_legs_are_the_same_however_many_are_looked_at_at_once(planned, plans, monkeypatch) -> None:
    monkeypatch.setattr("sidestep.routing.walks._LEGS_AT_ONCE", 3)
    again = plans(planned.planner)
    assert len(again.legs) == len(planned.legs) > 3
    assert [leg.exposure for leg in again.legs] == pytest.approx([leg.exposure for leg in planned.legs])
    assert [leg.too_dense for leg in again.legs] == [leg.too_dense for leg in planned.legs]


def test_the_later_the_surer(plans) -> None:
    whole = plans()
    assert (whole.futures, whole.by_minutes, whole.arrive_by) == (FUTURES, None, None)
    assert 0 < whole.median_minutes < whole.p90_minutes <= 120
    limits = [1e-3, whole.median_minutes, whole.p90_minutes, 1e4]
    shares = [plans(by=by).arrive_by for by in limits]
    # nobody at once, five of nine by the median, all that arrive in the end
    assert shares == [0, pytest.approx(5 / 9), pytest.approx(8 / 9), whole.arrival_rate]


def test_where_the_forecast_comes_true_there_is_one_future(plans) -> None:
    found, drawn = plans(problem=SMALL.changed(flows="forecast")), plans()
    assert found.futures == 1
    assert found.median_minutes == pytest.approx(found.expected_minutes, rel=1e-5)
    # and it is the route that is planned where crowds are drawn
    assert found.nodes == drawn.nodes


def test_hindsight_knows_no_better_than_what_is_expected(plans) -> None:
    # If crowds are as expected; in single futures it does.
    planned, hindsight = plans(), plans("clairvoyant")
    assert planned.nodes == hindsight.nodes
    assert hindsight.median_minutes <= planned.median_minutes * (1 + 1e-5)
    assert hindsight.p90_minutes <= planned.p90_minutes * (1 + 1e-5)


def test_any_walk_will_do(plans) -> None:
    back = plans(origin=7, destination=1, depart=0)
    assert (back.nodes[0], back.nodes[-1]) == (7, 1)
    # from a node to itself no step is taken
    stay = plans(origin=4, destination=4, by=0.01)
    assert (stay.nodes, stay.minutes, stay.metres, stay.expected_minutes, stay.legs) == ([4], [0], 0, 0, [])
    assert (stay.arrival_rate, stay.arrive_by, stay.mean_density) == (1, 1, 0)


def test_the_same_request_has_the_same_plan(plans) -> None:
    assert plans(by=20.0) == plans(by=20.0)


def test_who_wanders_may_not_arrive(plans) -> None:
    # a minute is too short for anyone, though as many slots are known as otherwise; a planner may be an object, too
    short = SMALL.changed(horizon=60.0, departures=(0.0, SMALL.departures[1] + SMALL.horizon - 60.0))
    assert short.slots == SMALL.slots
    found = plans(RandomWalk(), short, depart=0, by=0.5)
    assert (found.arrives, found.arrival_rate, found.arrive_by) == (False, 0, 0)
    assert found.expected_minutes == found.median_minutes == found.p90_minutes == 1


def test_long_walks_are_kept_whole(plans) -> None:
    found = plans("random-walk", destination=5)
    assert found.nodes[-1] == 5
    assert len(found.legs) > 9  # more than the grid has nodes


def test_exposure_is_met_on_grids_as_well(plans) -> None:
    found = plans()
    assert found.exposure > 0
    assert found.mean_density > 0
    assert found.exposure == pytest.approx(sum(leg.density * leg.minutes * 60 for leg in found.legs), rel=0.3)


def test_crowds_must_be_known_until_the_walk_ends(plans) -> None:
    with pytest.raises(RouteError) as caught:
        plans(depart=170)  # three hours are known
    assert caught.value.field == "depart"


def test_baselines_walk_the_same_futures(plan) -> None:
    assert list(plan.baselines) == ["shortest-path", "snapshot"]
    for baseline in plan.baselines.values():
        assert (baseline.futures, baseline.arrival_rate) == (7, 1)
        assert baseline.mean_difference_minutes == pytest.approx(0, abs=1e-3)
        assert baseline.mean_difference_exposure is None
    assert {name: baseline.level for name, baseline in plan.baselines.items()} == {
        "shortest-path": "map",
        "snapshot": "live",
    }


def test_the_planner_is_no_baseline(router, place) -> None:
    found = router.plan(place(50, 4), place(300, -50), planner="shortest-path", futures=30)
    assert {name: baseline.futures for name, baseline in found.baselines.items()} == {"snapshot": 20}


def test_an_objective_is_told_and_met(tiny, place) -> None:
    calm = Router(tiny.changed(objective=ObjectiveSpec(time=0.01, exposure=1.0)))
    found = calm.plan(place(50, 4), place(300, -50), futures=7)
    assert found.objective["exposure"] == 1
    assert found.baselines["shortest-path"].mean_difference_exposure == pytest.approx(0, abs=1)


def test_crowds_of_a_table(hours, place) -> None:
    """While Long Street is slow, by forecasts from counts that surprise nobody."""
    found = Router(hours()).plan(place(50, 4), place(300, -50), depart="2025-05-24T12:30", planner=Forecast(), by=10.0)
    on = {density: float(Weidmann().speed(jnp.float32(density))) * 60 for density in (SLOW, 0.5)}
    assert [leg.density for leg in found.legs] == pytest.approx([SLOW, 0, 0.5], rel=1e-5)
    minutes = [150 / on[SLOW], 100 / FREE_SPEED / 60, 50 / on[0.5]]
    assert [leg.minutes for leg in found.legs] == pytest.approx(minutes, rel=2e-3)
    assert (found.sensors, found.counted_sensors, found.crowds) == (None, None, "table crowds.npz")
    assert (found.departs, found.hour_of_week) == ("Saturday 2025-05-24 12:30", 132.5)
    # crowds come exactly as in the table: one future, and nothing to gain from counts
    assert (found.futures, found.arrive_by) == (1, 1)
    assert found.median_minutes == pytest.approx(found.expected_minutes)
    assert found.baselines["snapshot"].mean_difference_minutes == pytest.approx(0, abs=1e-4)
    # in the picture Long Street is as crowded as in its worse direction
    assert found.streets.density.tolist() == pytest.approx([2 * SLOW, 0, 0, 0, 0, 0.5, 0, 0], rel=1e-5)
