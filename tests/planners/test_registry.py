"""Planners by name: those of Sidestep, of other packages, and of the user."""

import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import get_args

import pytest

from sidestep.environment.types import LEVELS, Level
from sidestep.errors import SidestepError
from sidestep.evaluation.compare import compare
from sidestep.planners.base import Planner
from sidestep.planners.registry import (
    BASELINE,
    BOUND,
    REFERENCE,
    PlannerError,
    choose_planners,
    find_planner,
    planner_infos,
    register_planner,
)
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Expected
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_map

TINY = scenario("paper-congested", side=3, crowded_nodes=1, horizon=3600.0)
SEARCH = {
    "random-walk": "position",
    "random-progress": "position",
    "shortest-path": "map",
    "expected": "map",
    "clairvoyant": "hindsight",
    "greedy-local": "local",
    "lrta-star": "local",
    "greedy-map": "map",
    "snapshot": "live",
    "forecast": "live",
}
LEARNING = {"darp": "any", "dqn": "any", "tabular-q": "position"}

# A planner as somebody else writes it, knowing nothing but the protocol.
MODULE = '''
import jax.numpy as jnp

from sidestep.planners.base import Plan


class NearestFirst:
    """Take the exit that ends nearest to the destination.

    More is said here.
    """

    name = "{name}"
    level = "map"
    observes = "position"

    @staticmethod
    def decide(shared, own, observation, key):
        return jnp.argmin(jnp.where(observation.valid, own[observation.node], jnp.inf))

    def plan(self, params, instances):
        position, exit_node = params.network.position, params.network.exit_node
        away = position[exit_node] - position[instances.destination][:, None, None]
        return Plan(None, jnp.linalg.norm(away, axis=-1))


def without_attributes():
    return object()


def demanding(seed):
    return NearestFirst()


ready = NearestFirst()
'''


@pytest.fixture
def third_party(tmp_path: Path, monkeypatch):
    """A package of somebody else on the path: a module, and an entry point for its planner."""

    def install(module: str, name: str, *, entry_point: str = "", target: str = "NearestFirst") -> None:
        (tmp_path / f"{module}.py").write_text(MODULE.format(name=name))
        info = tmp_path / f"{module}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        if entry_point:
            (info / "entry_points.txt").write_text(f"[sidestep.planners]\n{entry_point} = {module}:{target}\n")
        monkeypatch.syspath_prepend(str(tmp_path))

    yield install
    for module in [name for name in sys.modules if name.startswith("third_party_")]:
        del sys.modules[module]


# --- Sidestep's own -------------------------------------------------------------------------------------------------


def test_all_planners_are_listed_with_their_level_and_a_line_each() -> None:
    infos = planner_infos()
    assert {name: infos[name].level for name in SEARCH | LEARNING} == SEARCH | LEARNING
    assert list(infos)[: len(SEARCH | LEARNING)] == [*SEARCH, *LEARNING]
    for name in SEARCH | LEARNING:
        info = infos[name]
        assert info.name == name
        assert (info.planner is None) == (name in LEARNING)
        for line in (info.summary, info.use):
            assert line.endswith(".")
            assert "\n" not in line


@pytest.mark.parametrize("name", SEARCH)
def test_search_planners_are_found_by_name(name: str) -> None:
    planner = find_planner(name)
    assert isinstance(planner, Planner)
    assert (planner.name, planner.level) == (name, SEARCH[name])
    assert planner.level in get_args(Level)
    assert planner.observes in LEVELS


@pytest.mark.parametrize(
    "name", [*LEARNING, "astar", "no_such_module:Planner", "sidestep.planners.random:Nobody", ":", ".:x"]
)
def test_what_cannot_be_found_is_an_error_of_the_planner(name: str) -> None:
    with pytest.raises(PlannerError) as caught:
        find_planner(name)
    assert caught.value.field == "planner"
    assert name in str(caught.value)


def test_a_near_miss_is_corrected_and_a_wide_one_told_what_there_is() -> None:
    with pytest.raises(PlannerError, match="greedy-map"):
        find_planner("greedymap")
    with pytest.raises(PlannerError) as caught:
        find_planner("dijkstra")
    assert all(name in str(caught.value) for name in SEARCH | LEARNING)


# --- Choosing -------------------------------------------------------------------------------------------------------


def test_the_three_references_are_always_chosen() -> None:
    assert (REFERENCE, BASELINE, BOUND) == ("shortest-path", "expected", "clairvoyant")
    assert list(choose_planners(TINY, []).factories) == ["shortest-path", "expected", "clairvoyant"]
    some = choose_planners(TINY, ["random-walk", "clairvoyant", "clairvoyant"])
    assert list(some.factories) == ["random-walk", "shortest-path", "expected", "clairvoyant"]
    assert some.baseline == "expected"
    against = choose_planners(TINY, [], against="random-walk")
    assert list(against.factories) == list(some.factories)
    assert against.baseline == "random-walk"


def test_by_default_all_but_the_baselines_that_learn_are_chosen() -> None:
    assert list(choose_planners(TINY).factories) == [*SEARCH, "darp"]


def test_factories_make_the_planners() -> None:
    scenario_map = draw_map(TINY, 0)
    for name, factory in choose_planners(TINY, SEARCH).factories.items():
        planner = factory(scenario_map, 0)
        assert planner is not None
        assert planner.name == name


def test_maps_are_the_scenarios_unless_others_are_asked_for() -> None:
    chosen = choose_planners(TINY, [])
    assert chosen.only_map is None
    assert chosen.map_numbers() == list(range(TINY.maps))
    assert chosen.map_numbers(2) == [0, 1]


@pytest.mark.parametrize("more", [{"names": ["astar"]}, {"against": "astar"}])
def test_unknown_planners_are_not_chosen(more: dict) -> None:
    with pytest.raises(PlannerError) as caught:
        choose_planners(TINY, **more)
    assert caught.value.field == "planner"


def test_a_table_learns_grids_with_one_destination_only() -> None:
    assert "tabular-q" in choose_planners(TINY, ["tabular-q"]).factories
    with pytest.raises(SidestepError) as caught:
        choose_planners(TINY, ["tabular-q"], level="local", destinations=2)
    assert caught.value.field == "destinations"
    for name in ("unseen-maps", "helsinki"):
        with pytest.raises(SidestepError) as caught:
            choose_planners(scenario(name), ["tabular-q"])
        assert caught.value.field == "level"


# --- Other people's -------------------------------------------------------------------------------------------------


def test_an_installed_package_brings_a_planner_by_its_entry_point(third_party) -> None:
    third_party("third_party_a", "nearest-a", entry_point="nearest-a")
    assert "nearest-a" in entry_points(group="sidestep.planners").names
    planner = find_planner("nearest-a")
    assert (type(planner).__name__, planner.level) == ("NearestFirst", "map")
    info = planner_infos()["nearest-a"]
    assert (info.summary, info.use) == ("Take the exit that ends nearest to the destination.", "")
    assert info.planner is planner


def test_the_listing_loads_entry_points(third_party) -> None:
    third_party("third_party_b", "nearest-b", entry_point="nearest-b")
    assert planner_infos()["nearest-b"].level == "map"


def test_a_planner_in_a_module_walks_in_a_comparison(third_party) -> None:
    third_party("third_party_c", "nearest-c")
    chosen = choose_planners(TINY, ["third_party_c:NearestFirst"], against="nearest-c")
    assert list(chosen.factories) == ["shortest-path", "expected", "clairvoyant", "nearest-c"]
    rows = compare(TINY, chosen.factories, maps=[0], walks=3).to_json(baseline=chosen.baseline)["planners"]
    assert rows["nearest-c"]["gap"] >= 0
    assert rows["nearest-c"]["difference_minutes"] == 0
    assert rows["nearest-c"]["level"] == "map"


def test_instances_and_functions_are_planners_too(third_party) -> None:
    third_party("third_party_d", "nearest-d")
    assert find_planner("third_party_d:ready").name == "nearest-d"
    assert find_planner("nearest-d").name == "nearest-d"


@pytest.mark.parametrize("target", ["without_attributes", "demanding", "jnp", "nothing"])
def test_objects_that_are_no_planners_are_refused(third_party, target: str) -> None:
    third_party("third_party_e", "nearest-e")
    with pytest.raises(PlannerError) as caught:
        find_planner(f"third_party_e:{target}")
    assert caught.value.field == "planner"


def test_an_entry_point_must_bear_its_planners_name(third_party) -> None:
    third_party("third_party_f", "nearest-f", entry_point="other-f")
    with pytest.raises(PlannerError, match="nearest-f") as caught:
        find_planner("other-f")
    assert caught.value.field == "planner"


def test_broken_entry_points_name_the_place(third_party) -> None:
    third_party("third_party_g", "nearest-g", entry_point="nearest-g", target="Gone")
    with pytest.raises(PlannerError, match="third_party_g:Gone"):
        planner_infos()


def test_a_module_that_does_not_load_is_an_error_of_the_planner(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "third_party_i.py").write_text("def half(:\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PlannerError, match="third_party_i:Planner") as caught:
        find_planner("third_party_i:Planner")
    assert caught.value.field == "planner"


# --- One's own ------------------------------------------------------------------------------------------------------


def test_a_class_registers_by_a_decorator() -> None:
    @register_planner
    class Optimist(Expected):
        """Hope that crowds come as expected."""

        name = "optimist"

    assert isinstance(find_planner("optimist"), Optimist)
    assert planner_infos()["optimist"].summary == "Hope that crowds come as expected."

    class Again(Optimist):
        """Hope again."""

    assert register_planner(Again, use="When in doubt.") is Again
    info = planner_infos()["optimist"]
    assert (info.summary, info.use) == ("Hope again.", "When in doubt.")
    assert "optimist" in choose_planners(TINY, ["optimist"]).factories
    assert "optimist" not in choose_planners(TINY).factories


def test_levels_and_names_are_checked() -> None:
    class Wrong(ShortestPath):
        name = "wrong"
        level = "omniscient"

    class Blind(ShortestPath):
        name = "blind"
        observes = "hindsight"

    for planner in (Wrong, Blind, ShortestPath):  # the last has a name that is taken
        with pytest.raises(PlannerError) as caught:
            register_planner(planner)
        assert caught.value.field == "planner"
    assert find_planner("shortest-path").level == "map"
