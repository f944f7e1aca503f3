"""A tiny comparison, whole: its JSON, and everything that its numbers must not depend on."""

import json

import jax
import numpy as np
import pytest

from sidestep.environment.types import EnvParams, Instance
from sidestep.evaluation import compare as comparing
from sidestep.evaluation.compare import Comparison, compare
from sidestep.planners.base import Plan, Planned, routes, walk_plan
from sidestep.planners.random import RandomWalk
from sidestep.planners.registry import PlannerError, PlannerFactory, choose_planners, find_planner
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Expected
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map, purpose_key
from sidestep.scenarios.model import ObjectiveSpec, Scenario

# Twelve slots; a random walk often needs more than the hour.
TINY = scenario("paper-congested", side=3, crowded_nodes=1, horizon=3600.0)
ALL = ["random-walk", "random-progress", "shortest-path", "expected", "clairvoyant"]


REACTIVE = ["greedy-local", "lrta-star", "greedy-map", "snapshot", "forecast"]


def chosen(*names: str) -> dict[str, PlannerFactory]:
    return choose_planners(TINY, names).factories


def run(names: list[str] = ALL, maps: tuple[int, ...] = (0, 1), **more) -> Comparison:
    return compare(TINY, chosen(*names), maps=maps, walks=3, **more)


@pytest.fixture(scope="module")
def found() -> Comparison:
    return run()


def test_shape_of_the_json(found, agreed_row) -> None:
    result = found.to_json()
    asked = {"scenario", "maps", "walks", "seed", "planners"}
    assert result.keys() == asked | {"summary", "synthetic", "flows", "by_minutes", "objective", "baseline", "walker"}
    assert (result["scenario"], result["maps"], result["walks"], result["seed"]) == ("paper-congested", 2, 3, 0)
    assert (result["flows"], result["by_minutes"], result["baseline"]) == ("arima", None, "expected")
    assert result["summary"] == "the paper's 5 x 5 blocks, all segments at four nodes crowded by 5,000 people"
    assert list(result["planners"]) == ALL
    for row in result["planners"].values():
        assert row.keys() == agreed_row | {
            "maps", "best_saving", "regret_minutes", "median_minutes", "p90_minutes", "arrive_by",
            "difference_minutes", "difference_ci95",
        }  # fmt: skip
        for name, value in row.items():
            kind = list if "ci95" in name else {"level": str, "maps": int}.get(name, float)
            if "saving" in name or name == "arrive_by":  # the shortest path does not arrive on map 1; nobody asked
                kind = type(None)
            assert isinstance(value, kind), name
        assert len(row["ci95"]) == len(row["gap_ci95"]) == len(row["difference_ci95"]) == 2
        assert row["median_minutes"] <= row["p90_minutes"]
        assert row["ci95"][0] <= row["mean_minutes"] <= row["ci95"][1]
        assert 0 <= row["arrival_rate"] <= 1
    assert json.loads(json.dumps(result, allow_nan=False)) == result


def test_the_json_says_how_many_arrive_within_the_minutes_asked_about(found) -> None:
    record = found.records["random-walk"]
    horizon = TINY.horizon / 60
    by = float(np.median(record.minutes[record.minutes < horizon]))
    result = found.to_json(by)
    assert result["by_minutes"] == by
    share = (record.arrived & (record.minutes <= by)).mean()
    assert result["planners"]["random-walk"]["arrive_by"] == pytest.approx(share)
    assert 0 < share < 1
    in_time = (record.arrived & (record.minutes < horizon)).mean()  # not those who are given up
    assert found.to_json(horizon)["planners"]["random-walk"]["arrive_by"] == pytest.approx(in_time)


def test_rows_make_sense(found) -> None:
    rows = found.to_json()["planners"]
    assert rows["clairvoyant"]["gap"] == 0
    assert rows["expected"]["difference_minutes"] == 0
    assert rows["clairvoyant"]["difference_minutes"] <= 0 < rows["random-walk"]["difference_minutes"]
    # or against another
    other = found.to_json(baseline="shortest-path")
    assert other["baseline"] == "shortest-path"
    means = [rows[name]["mean_minutes"] for name in ("random-walk", "shortest-path")]
    assert other["planners"]["random-walk"]["difference_minutes"] == pytest.approx(means[0] - means[1])
    assert run(["expected"], maps=(0,)).to_json()["planners"]["shortest-path"]["saving_vs_shortest_path"] == 0
    for name, row in rows.items():
        assert row["gap"] >= -1e-6, name
        record = found.records[name]
        assert record.minutes.shape == record.arrived.shape == (2, 3)
        assert record.minutes.dtype == np.float64
        assert row["mean_minutes"] == pytest.approx(record.minutes.mean())
        # the clairvoyant is the bound of every single walk
        assert (record.minutes >= found.records["clairvoyant"].minutes * (1 - 1e-4)).all()


def test_walks_that_do_not_arrive_count_as_the_horizon(found) -> None:
    record = found.records["random-walk"]
    assert 0 < record.arrived.sum() < 6
    assert record.minutes[~record.arrived] == pytest.approx(60)
    assert found.to_json()["planners"]["random-walk"]["arrival_rate"] == record.arrived.mean()
    assert found.records["clairvoyant"].arrived.all()


def test_results_do_not_depend_on_the_number_of_workers(found) -> None:
    for workers in (2, 3):
        again = run(workers=workers)
        for name, record in found.records.items():
            assert again.records[name].minutes.tolist() == record.minutes.tolist()
            assert again.records[name].arrived.tolist() == record.arrived.tolist()


def test_results_do_not_depend_on_who_else_walks_or_on_which_maps_else(found) -> None:
    alone = run(["random-walk"], maps=(1,))
    assert list(alone.records) == ["random-walk", "shortest-path", "expected", "clairvoyant"]
    for name, record in alone.records.items():
        assert record.minutes.tolist() == found.records[name].minutes[1:].tolist()


def test_another_seed_gives_other_maps(found) -> None:
    assert (run(["expected"], seed=1).records["expected"].minutes != found.records["expected"].minutes).all()


def test_walks_meet_the_futures_for_testing(found) -> None:
    params = make_environment(TINY, draw_map(TINY, 0, 1), "test", 3)
    planner = find_planner("expected")
    todo = instances(TINY, draw_map(TINY, 0, 1), params, 3)
    walked = routes(planner, params, todo, jax.random.key(0), 9)
    assert [route.seconds / 60 for route in walked] == pytest.approx(found.records["expected"].minutes[1].tolist())


def test_many_walks_are_done_in_parts(monkeypatch) -> None:
    # Seven walks, no more than three at a time: three parts of three, of which the last two walks do not count.
    monkeypatch.setattr(comparing, "CHUNK", 3)
    planners = chosen("random-walk")
    result = compare(TINY, planners, maps=(1,), walks=7)
    assert result.to_json()["walks"] == 7
    scenario_map = draw_map(TINY, 0, 1)
    for name, factory in planners.items():
        planner, minutes, arrived = factory(scenario_map, 1), [], []
        for part in range(3):
            params = make_environment(TINY, scenario_map, "test", 3, part=part)
            todo = instances(TINY, scenario_map, params, 3, first=3 * part)
            assert todo.future.tolist() == [0, 1, 2]  # every walk has a future of its own
            key = purpose_key(scenario_map, "test")
            key = jax.random.fold_in(key, part) if part else key
            walked = walk_plan(planner, params, planner.plan(params, todo), todo, key)
            minutes += (np.asarray(walked.seconds, np.float64) / 60).tolist()
            arrived += walked.arrived.tolist()
        record = result.records[name]
        assert record.minutes.shape == record.arrived.shape == (1, 7)
        assert record.minutes[0] == pytest.approx(minutes[:7], rel=1e-5)
        assert record.arrived[0].tolist() == arrived[:7]
    # no future is met twice
    assert len(set(result.records["clairvoyant"].minutes[0].tolist())) == 7


def test_parts_that_fit_exactly(monkeypatch) -> None:
    sizes = []

    def counted(*args, **kwargs):
        sizes.append((args[3], kwargs["part"]))
        return make_environment(*args, **kwargs)

    monkeypatch.setattr(comparing, "CHUNK", 3)
    monkeypatch.setattr(comparing, "make_environment", counted)
    assert compare(TINY, chosen(), maps=(0,), walks=6).records["expected"].minutes.shape == (1, 6)
    assert sizes == [(3, 0), (3, 1)]
    sizes.clear()
    compare(TINY, chosen(), maps=(0,), walks=3)
    assert sizes == [(3, 0)]


@pytest.mark.parametrize(("names", "level"), [(REACTIVE, "live"), (["greedy-local"], "local"), ([], "position")])
def test_the_environment_sees_as_much_as_the_planner_that_sees_most(monkeypatch, names: list[str], level: str) -> None:
    class EnoughError(Exception):
        pass

    def noted(*_args, **kwargs):
        assert kwargs["level"] == level
        raise EnoughError

    monkeypatch.setattr(comparing, "make_environment", noted)
    with pytest.raises(EnoughError):
        compare(TINY, chosen(*names), maps=(0,), walks=3)


def test_who_sees_less_walks_the_same_beside_those_who_see_more(found) -> None:
    many = compare(TINY, chosen("greedy-map"), maps=(0,), walks=3)
    for name in ("shortest-path", "expected", "clairvoyant"):
        assert many.records[name].minutes[0] == pytest.approx(found.records[name].minutes[0], rel=1e-5)
    assert (many.records["greedy-map"].minutes >= many.records["clairvoyant"].minutes * (1 - 1e-4)).all()


def test_maps_are_reported_in_order() -> None:
    seen = []
    run(["expected"], maps=(4, 2, 3), workers=2, on_map=lambda index, walked: seen.append((index, sorted(walked))))
    assert seen == [(index, ["clairvoyant", "expected", "shortest-path"]) for index in (4, 2, 3)]


def test_walks_are_reported_as_they_are_done(monkeypatch) -> None:
    monkeypatch.setattr(comparing, "CHUNK", 3)
    seen = []
    compare(TINY, chosen(), maps=(1,), walks=7, on_walks=lambda *done: seen.append(done))
    names = ["shortest-path", "expected", "clairvoyant"]
    made = [(1, name, 0) for name in names]
    assert seen == made + [(1, name, walks) for walks in (3, 3, 1) for name in names]


def test_a_planner_may_skip_maps() -> None:
    planners = chosen("expected") | {"late": lambda _place, index: RandomWalk() if index < 1 else None}
    result = compare(TINY, planners, maps=(0, 1), walks=3)
    assert result.records["late"].minutes.shape == (1, 3)
    row = result.to_json()["planners"]["late"]
    assert row["maps"] == 1
    first = {name: result.records[name].minutes[0].mean() for name in ("late", "clairvoyant", "shortest-path")}
    assert row["gap"] == pytest.approx(first["late"] / first["clairvoyant"] - 1)
    assert row["saving_vs_shortest_path"] == pytest.approx(1 - first["late"] / first["shortest-path"])
    nobody = compare(TINY, planners | {"never": lambda *_: None}, maps=(0,), walks=3)
    assert "never" not in nobody.to_json()["planners"]


def test_an_error_on_one_map_ends_the_comparison() -> None:
    def broken(_place, index: int) -> RandomWalk:
        if index == 1:
            raise RuntimeError("no such luck")
        return RandomWalk()

    for workers in (1, 2):
        with pytest.raises(RuntimeError, match="no such luck"):
            compare(TINY, chosen() | {"broken": broken}, maps=(0, 1, 2), walks=3, workers=workers)


def test_a_planner_that_skips_a_map_skips_all_later_ones() -> None:
    def every_other(_place, index: int) -> RandomWalk | None:
        return None if index == 1 else RandomWalk()

    with pytest.raises(PlannerError, match="skipped a map before map 2"):
        compare(TINY, chosen() | {"sometimes": every_other}, maps=(0, 1, 2), walks=3)


@pytest.mark.parametrize("nothing", [{"maps": ()}, {"walks": 0}, {"workers": 0}])
def test_nothing_to_compare(nothing: dict) -> None:
    with pytest.raises(PlannerError) as caught:
        compare(TINY, chosen(), **{"maps": (0,), "walks": 1, "workers": 1} | nothing)
    assert caught.value.field in nothing


def test_factories_make_planners() -> None:
    for factory, field in ((lambda *_: None, "maps"), (lambda *_: "expected", "planners")):
        with pytest.raises(PlannerError) as caught:
            compare(TINY, {"mine": factory}, maps=(0,), walks=1)
        assert caught.value.field == field


def test_nothing_is_set_against_planners_that_did_not_walk(found) -> None:
    with pytest.raises(PlannerError) as caught:
        found.to_json(baseline="darp")
    assert caught.value.field == "baseline"
    alone = compare(TINY, {"alone": lambda *_: RandomWalk()}, maps=(0,), walks=3)
    with pytest.raises(PlannerError):
        alone.to_json(baseline="alone")


# --- Work that is done once -----------------------------------------------------------------------------------------


class Counted(ShortestPath):
    """Count the plans."""

    name = "counted"

    def __init__(self) -> None:
        self.plans = 0

    def plan(self, *args):
        self.plans += 1
        return super().plan(*args)


def test_planners_plan_once() -> None:
    once = Counted()
    result = compare(TINY, chosen() | {"counted": lambda *_: once}, maps=(0, 1), walks=3)
    assert once.plans == 2  # one on each map
    assert result.records["counted"].minutes.tolist() == result.records["shortest-path"].minutes.tolist()


LONG = TINY.changed(horizon=6 * 3600.0)


def test_of_long_days_what_plans_do_not_get_to_is_not_worked_out(monkeypatch) -> None:
    planners, made, minutes = choose_planners(LONG, ["random-walk"]).factories, [], []

    def noted(*args, **kwargs):
        params = make_environment(*args, **kwargs)
        made.append(params.expected.known_until)
        return params

    monkeypatch.setattr(comparing, "make_environment", noted)
    for first in (3 * 3600.0, 1200.0, 4 * 3600.0):
        monkeypatch.setattr(comparing, "FIRST_SECONDS", first)
        records = compare(LONG, planners, maps=(1,), walks=3).records
        minutes.append({name: record.minutes.tolist() for name, record in records.items()})
    assert minutes[0] == minutes[1] == minutes[2]
    enough, too_few, for_these, whole = made
    assert 3600.0 < enough < 3 * 3600.0
    assert too_few < 1200.0
    assert for_these == whole == np.inf


def test_a_planner_that_plans_otherwise_than_its_base_class_walks_its_own_plans() -> None:
    class AnyWay(Expected):
        name = "any-way"

        def plan(self, params: EnvParams, instances: Instance) -> Plan:
            exits = np.zeros((len(instances.origin), params.network.nodes, 4), bool)
            return Plan(None, exits)  # any exit, at random

    planners = choose_planners(LONG, []).factories | {AnyWay.name: lambda *_: AnyWay()}
    records = compare(LONG, planners, maps=(1,), walks=3).records
    assert records[AnyWay.name].minutes.mean() > records["expected"].minutes.mean()


@pytest.mark.parametrize(
    ("scenario", "names", "first"),
    [
        (LONG, [], 36),
        (LONG, ["greedy-map"], None),  # it looks at costs to go
        (LONG, ["straight-on"], None),  # it may look at anything
        (LONG.changed(objective=ObjectiveSpec(exposure=1.0)), [], None),  # plans begin with the last slot
        (TINY, [], None),
    ],
)
def test_what_is_expected_first(monkeypatch, scenario: Scenario, names: list[str], first: int | None) -> None:
    class EnoughError(Exception):
        pass

    class StraightOn(Planned):
        name, level = "straight-on", "map"

        def plan(self, *_args):
            raise AssertionError

    def noted(*_args, **_kwargs):
        raise EnoughError

    slots = []
    monkeypatch.setattr(comparing, "expected_pace", lambda *args: slots.append(args[-1]))
    monkeypatch.setattr(comparing, "make_environment", noted)
    known = choose_planners(scenario, [name for name in names if name != StraightOn.name]).factories
    planners = known | ({StraightOn.name: lambda *_: StraightOn()} if StraightOn.name in names else {})
    with pytest.raises(EnoughError):
        compare(scenario, planners, maps=(0,), walks=3)
    assert slots == ([] if first is None else [first])


@pytest.mark.usefixtures("found")
def test_a_second_comparison_compiles_nothing(caplog) -> None:
    def compiled() -> list[str]:
        return [record.message for record in caplog.records if record.message.startswith("Compiling")]

    with jax.log_compiles():
        run(maps=(2, 3), seed=1)
        assert compiled() == []
        jax.jit(lambda x: x + 1)(np.zeros(17))
        assert compiled()  # so that is how it would have been noticed


# --- Synthetic crowds are said to be so -----------------------------------------------------------------------------


def test_results_say_that_crowds_are_invented() -> None:
    assert "demand 120 × the counts (an invented event day)" in scenario("helsinki").place.synthetic
    assert "drawn from a seed" in TINY.place.synthetic
