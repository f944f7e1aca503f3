"""Routers made from others for another walker or objective answer as if they were made alone."""

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from sidestep.crowds.live import LiveCount, LiveCounts
from sidestep.errors import SidestepError
from sidestep.routing.live import begin
from sidestep.routing.request import RouteRequest
from sidestep.routing.router import Router
from sidestep.scenarios.model import ObjectiveSpec
from sidestep.scenarios.walkers import ADULT, Walker, read_walkers

NOON = datetime.fromisoformat("2025-05-24T12:30")  # a Saturday
PLACES = [(50, 4), (300, -50), (0, 50), (150, 0), (100, -50)]
(OLDER,), (SLOW,) = (read_walkers(text) for text in ("older", "older,free_speed=0.9"))
objectives = st.builds(
    ObjectiveSpec,
    time=st.floats(0.01, 2),
    distance=st.floats(0, 2),
    exposure=st.floats(0, 20),
    max_density=st.sampled_from([None, 0.4]),
)


@pytest.fixture(scope="module")
def base(tiny) -> Router:
    router = Router(tiny)
    assert router.quick
    return router


def counts(quay: float) -> LiveCounts:
    return LiveCounts((LiveCount("the quay", NOON.astimezone() - timedelta(hours=1), 3600.0, quay),), None)


@pytest.fixture(scope="module")
def answers(place) -> Callable[..., list[Any]]:
    """What a router says of a walk: planned, under way, along the times of tables, and of crowds."""

    def ask(router: Router, origin: int, destination: int, planner: str) -> list[Any]:
        ends = place(*PLACES[origin]), place(*PLACES[destination])
        request = RouteRequest(*ends, NOON, planner, futures=3)
        walk, decision = begin(router, request)
        departs = router.clock(NOON)
        points = [router.quick.snapper.nearest(*end) for end in ends]
        quick = router.quick.route(*points, departs)
        said = [router.answer(request).to_json(), walk.to_json(), decision.to_json(), quick.legs, quick.seconds]
        return [*said, router.quick.crowds(departs).tolist(), router.crowds(NOON).to_json()]

    return ask


@settings(
    max_examples=4, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate]
)  # shrinking would take long
@given(
    walker=st.sampled_from([ADULT, OLDER, SLOW]),
    objective=objectives,
    quay=st.none() | st.floats(0, 40_000),
    ends=st.permutations(range(len(PLACES))).map(lambda order: order[:2]),
    planner=st.sampled_from(["expected", "shortest-path", "snapshot"]),
)
def test_changed_routers_answer_as_those_made_alone(
    base, answers, walker: Walker, objective: ObjectiveSpec, quay: float | None, ends: list[int], planner: str
) -> None:
    alone = Router(base.scenario.changed(walker=walker, objective=objective))
    walking = base.changed(walker=walker)
    for each in (alone, walking):
        each.go_on_from(counts(quay) if quay is not None else LiveCounts((), None), NOON)
    assert answers(walking.changed(objective=objective), *ends, planner) == answers(alone, *ends, planner)


def test_another_objective_goes_on_from_the_same_counts(base, answers) -> None:
    """And from others once there are others, without any work of its own."""
    one = ObjectiveSpec(exposure=1.0)
    said = []
    for quay in (0.0, 40_000.0):
        base.go_on_from(counts(quay), NOON)
        other = base.changed(objective=one)
        assert (other.quick, other.live) == (base.quick, base.live)
        said.append(answers(other, 0, 1, "expected"))
    assert said[0][0]["exposure"] < said[1][0]["exposure"]
    assert base.scenario.objective == ObjectiveSpec()


def test_walkers_that_take_no_street(base) -> None:
    with pytest.raises(SidestepError) as caught:
        base.changed(walker=read_walkers("wheelchair,least_width=50")[0])
    assert caught.value.field == "walker"
