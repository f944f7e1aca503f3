"""Many routes through one place: nothing is compiled or loaded again, and threads may share a router."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from sidestep.errors import SidestepError
from sidestep.planners.learned import Learned
from sidestep.planners.random import RandomWalk
from sidestep.routing.request import RouteRequest
from sidestep.routing.router import Router, plan_route
from sidestep.scenarios.builtin import scenario

NOON = "2025-05-24T12:30"
ENDS = [((50, 4), (300, -50)), ((300, -50), (50, 4)), (3, 2), ((200, 50), (150, 0)), (0, (100, 100))]


@pytest.fixture
def ends(place) -> list:
    return [tuple(end if isinstance(end, int) else place(*end) for end in pair) for pair in ENDS]


@pytest.mark.parametrize("planner", ["expected", "snapshot"])
def test_the_second_route_compiles_nothing(tiny, ends, compiled, planner: str) -> None:
    router = Router(tiny)
    router.plan(*ends[0], depart=NOON, futures=7, planner=planner)
    compiled.clear()
    for pair in ends[1:]:
        router.plan(*pair, depart="2025-05-26T18:00", futures=7, planner=planner)
    assert compiled == []


def test_the_first_route_compiles_few_programs(tiny, ends, compiled) -> None:
    router = Router(tiny)
    compiled.clear()
    router.plan(*ends[0], depart=NOON, futures=30)
    # One for each thing that is worked out, and none for single steps of it: those of streets, expected times, futures,
    # the plan, four walks by three planners, counts, and legs.
    assert 0 < len(compiled) <= 20


def test_numbers_of_futures_share_what_walks(tiny, ends, compiled) -> None:
    router = Router(tiny)
    few = router.plan(*ends[0], depart=NOON, futures=7)
    compiled.clear()
    more = router.plan(*ends[1], depart=NOON, futures=9)
    assert len(compiled) <= 4  # futures are drawn and taken anew
    assert [plan.futures for plan in (few, more)] == [7, 9]
    assert {round(7 * few.arrival_rate, 6), round(9 * more.arrival_rate, 6)} == {7, 9}


@pytest.mark.parametrize("planner", ["snapshot", "forecast"])
def test_long_walks_compile_nothing_after_short_ones(compiled, planner: str) -> None:
    router = Router(scenario("rush-16", side=4, crowded_nodes=1))
    router.plan(0, 1, depart=0, futures=3, planner=planner)
    compiled.clear()
    far = router.plan(0, 15, depart=45, futures=3, planner=planner)
    assert far.expected_minutes > 20  # four slots
    assert compiled == []


def test_the_second_question_compiles_nothing(tiny, place, compiled) -> None:
    router = Router(tiny)

    def ask(depart: str, *asked: object) -> None:
        router.isochrone(asked[0], minutes=[2, 4], depart=depart, futures=3)
        router.matrix(asked, depart=depart)
        router.crowds(at=depart)
        router.plan(0, 4, depart=depart, futures=3, alternatives=2)
        router.plan(0, 4, arrive_by=depart, futures=3)
        router.when(0, 4, depart=depart, step=60, futures=3)

    ask("Sat 12:30", place(50, 4), 2, 3)
    compiled.clear()
    ask("Mon 18:00", 5, place(150, 0), place(0, 50), 1)
    assert compiled == []


def test_threads_share_a_router(router, ends) -> None:
    def plan(pair: tuple) -> dict:
        return router.plan(*pair, depart=NOON, futures=7).to_json()

    alone = [plan(pair) for pair in ends]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(plan, ends * 3)) == alone * 3


def test_one_route_without_a_router(router, tiny, ends) -> None:
    origin, destination = ends[0]
    request = RouteRequest(origin, destination, planner="shortest-path", futures=7)
    assert plan_route(tiny, request) == router.answer(request)
    text = ["{:.9f},{:.9f}".format(*end) for end in ends[0]]
    assert router.plan(*text, planner="shortest-path", futures=7).nodes == router.answer(request).nodes


def test_scenarios_come_by_name_too() -> None:
    router = Router("paper-congested", seed=1, index=2)
    assert router.scenario.name == "paper-congested"
    with pytest.raises(SidestepError):
        Router("paper-congestd")


def test_planners_come_by_name_or_as_objects(router, ends) -> None:
    wanders = RandomWalk()
    assert router.plan(*ends[0], planner=wanders, futures=7).planner == "random-walk"
    for name in ("astar", "darp"):
        with pytest.raises(SidestepError) as caught:
            router.plan(*ends[0], planner=name)
        assert caught.value.field == "planner"


class Somebody(RandomWalk):
    """Learned to walk somewhere."""


def learned(monkeypatch, **known: object) -> None:
    def load(_folders, scenario, _seed) -> Learned:
        return Learned(
            **{"planners": {"darp": Somebody()}, "index": None, "destinations": None} | known, scenario=scenario
        )

    monkeypatch.setattr("sidestep.planners.learned.load_planners", load)


def test_a_model_plans_by_default(monkeypatch, tiny, ends) -> None:
    learned(monkeypatch)
    router = Router(tiny, model="m")
    assert router.plan(*ends[0], futures=7).planner == Somebody.name
    assert router.plan(*ends[0], futures=7, planner="expected").planner == "expected"


@pytest.mark.parametrize(
    ("known", "pair", "field"),
    [
        ({"index": 0}, 0, "origin"),  # remembers nodes, but the route begins in the middle of a street
        ({"index": 0}, 4, "destination"),
        ({"index": 0, "destinations": frozenset([7])}, 2, "destination"),  # learned to walk elsewhere
    ],
)
def test_models_of_nodes_walk_between_them(monkeypatch, tiny, ends, known: dict, pair: int, field: str) -> None:
    learned(monkeypatch, **known)
    router = Router(tiny, model="m")
    with pytest.raises(SidestepError) as caught:
        router.plan(*ends[pair], futures=7)
    assert caught.value.field == field


def test_models_that_do_not_fit(monkeypatch, tmp_path) -> None:
    with pytest.raises(SidestepError) as caught:
        Router("paper-congested", model=tmp_path)
    assert caught.value.field == "model"
    learned(monkeypatch, index=0)
    with pytest.raises(SidestepError) as caught:
        Router(scenario("paper-congested"), model="m", index=1)
    assert caught.value.field == "model"


def test_a_deadline_without_a_day_is_the_next_after_the_departure(router) -> None:
    plan = router.plan(0, 2, depart="2025-05-24T23:50", arrive_by="0:30", futures=3)
    assert plan.departure.startswith("2025-05-25T00:2")
