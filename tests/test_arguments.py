"""What people pass to public functions: wrong arguments are refused by name, and near ones are taken."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import sidestep
from sidestep import plotting
from sidestep.arguments import COUNT, FLAG, MINUTES, PATH, SEED, Rule, checked, each, one_of, whole
from sidestep.errors import SidestepError, hint
from sidestep.network.formats import save_town

TINY = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
HERE = sidestep.draw_map(TINY, 0)
PARAMS = sidestep.make_environment(TINY, HERE, "test", 2)
WALKS = sidestep.instances(TINY, HERE, PARAMS, 2)
CHOSEN = sidestep.choose_planners(TINY, ["random-progress"])
SETTINGS = sidestep.preset("default").changed(rounds=1, round_steps=64, walkers=8, batch=16, capacity=64)

NO_NUMBERS: tuple[Any, ...] = ("1", None, [1], 1.5, math.nan, True, b"1", np.float64(2))
NO_COUNTS = (*NO_NUMBERS, -1, 0, 2**70)
NO_SEEDS = (*NO_NUMBERS, -1, 2**70)
NO_PATHS = (3, None, b"x", [], {}, "", "a\0b")
NO_NAMES = (3, None, b"x", [], Path("x"))
NO_OBJECTS = ("rush-16", None, 3, [], {})
NO_LISTS = (1, "0", None, [], [1.5], ["0"], [None], [-1], math.nan)
NO_NODES = ("8", 8, [], [8], [[1.5]], [[99]], [[-1]], [[1, 2]], [["8"]])
NO_SEGMENTS = ("x", 3, None, ["a"], [[0]], [0.5], [2**40], [math.nan])
NO_MINUTES = ("x", -1, 0, math.nan, math.inf, [1], True)


def compare(**given: Any) -> Any:
    usual: dict[str, Any] = {"scenario": TINY, "planners": CHOSEN.factories, "maps": [0], "walks": 2}
    return sidestep.compare(**usual | given)


def network(**given: Any) -> Any:
    usual: dict[str, Any] = {"position": [[0, 0], [9, 0]], "tail": [0], "head": [1], "length": [9.0]}
    return sidestep.road_network(**usual | given)


def routes(**given: Any) -> Any:
    planner = sidestep.find_planner("expected")
    usual: dict[str, Any] = {"params": PARAMS, "instances": WALKS, "key": jax.random.key(0), "trace": 9}
    return sidestep.routes(**{"planner": planner} | usual | given)


def environment(**given: Any) -> Any:
    return sidestep.make_environment(
        **{"scenario": TINY, "scenario_map": HERE, "purpose": "test", "futures": 2} | given
    )


def instances(**given: Any) -> Any:
    return sidestep.instances(**{"scenario": TINY, "scenario_map": HERE, "params": PARAMS, "walks": 2} | given)


def choose(**given: Any) -> Any:
    return sidestep.choose_planners(**{"scenario": TINY, "names": ["expected"]} | given)


def train(**given: Any) -> Any:
    return sidestep.train(**{"scenario": TINY, "config": SETTINGS} | given)


def of_file(**given: Any) -> Any:
    return sidestep.import_osm(**{"path": "none.osm"} | given)


def router(**given: Any) -> Any:
    return sidestep.Router(**{"scenario": TINY} | given)


def drawn(**given: Any) -> Any:
    return sidestep.draw_map(**{"scenario": TINY, "seed": 0} | given)


def drawn_to_learn(**given: Any) -> Any:
    return sidestep.draw_training_map(**{"scenario": TINY, "seed": 0} | given)


def saved(**given: Any) -> Any:
    return plotting.save(**{"figure": Figure(), "path": "picture.png"} | given)


def matrix(**given: Any) -> Any:
    return HERE.network.matrix(**given)


WRONG: dict[Callable[..., Any], dict[str, tuple[Any, ...]]] = {
    compare: {
        "scenario": NO_OBJECTS,
        "planners": (["expected"], "expected", None, {}, {"a": 3}),
        "maps": (*NO_LISTS, [0, 0]),
        "walks": NO_COUNTS,
        "seed": NO_SEEDS,
        "workers": NO_COUNTS,
        "destinations": [each for each in NO_COUNTS if each is not None] + [100],
        "on_map": (3, None),
    },
    choose: {
        "scenario": NO_OBJECTS,
        "names": ("expected", 3, [3], [None], [[]]),
        "models": ("local", 3, [3], [""]),
        "against": NO_NAMES,
        "seed": NO_SEEDS,
        "level": ("top", 3, [], "hindsight"),
        "destinations": NO_COUNTS,
    },
    CHOSEN.map_numbers: {"maps": [each for each in NO_COUNTS if each is not None]},
    drawn: {"scenario": NO_OBJECTS, "seed": NO_SEEDS, "index": NO_SEEDS},
    drawn_to_learn: {"scenario": NO_OBJECTS, "seed": NO_SEEDS, "index": NO_SEEDS},
    environment: {
        "scenario": NO_OBJECTS,
        "scenario_map": NO_OBJECTS,
        "purpose": ("train", None, 3, []),
        "futures": NO_COUNTS,
        "level": ("top", 3, None, []),
        "destinations": NO_NODES,
        "hours": ("0", 3, [], [math.nan], [1, 2], ["x"]),
        "part": NO_SEEDS,
        "densities": ("x", None, 1),
        "samples": [each for each in NO_SEEDS if each is not None],
    },
    instances: {
        "scenario": NO_OBJECTS,
        "scenario_map": NO_OBJECTS,
        "params": NO_OBJECTS,
        "walks": NO_COUNTS,
        "first": NO_SEEDS,
        "destinations": (*NO_NODES, [[3], [4], [5]]),
    },
    routes: {
        "planner": NO_OBJECTS,
        "params": NO_OBJECTS,
        "instances": NO_OBJECTS,
        "key": ("x", None, 0),
        "trace": NO_COUNTS,
    },
    train: {
        "scenario": NO_OBJECTS,
        "config": NO_OBJECTS,
        "seed": NO_SEEDS,
        "index": NO_SEEDS,
        "out": [each for each in NO_PATHS if each is not None],
        "resume": ("x", None, 1),
        "keep_checkpoints": (0, 1.5, "x", None),
        "track": ("x", None, 1),
        "least_minutes": (3, "x"),
        "on_round": (3, None),
    },
    network: {
        "position": ("x", 3, None, [], [[0, 0], [1]], [[0], [1]], [[0, 0, 0], [1, 1, 1]], [[0, math.nan], [1, 1]]),
        "tail": NO_SEGMENTS,
        "head": NO_SEGMENTS,
        "length": ("x", 3, None, [[1.0]], ["x"], [math.nan], [-1.0]),
        "width": ("x", None, [], [1, 2], -1, math.nan),
        "exit_of": ("x", 3, [], [5.5], [0, 1]),
        "exits": [each for each in NO_COUNTS if each is not None],
    },
    of_file: {
        "path": NO_PATHS,
        "merge": ("1", None, -1, math.nan, math.inf, [1], True),
        "widths": (1, "footway", [1]),
        "attribution": (None, 1, "", "a\nb"),
    },
    router: {"scenario": (3, None, [], b"x"), "model": (3, [], ""), "seed": NO_SEEDS, "index": NO_SEEDS},
    sidestep.load_model: {"folder": NO_PATHS},
    sidestep.load_town: {"path": NO_PATHS},
    sidestep.load_scenario: {"path": NO_PATHS},
    sidestep.scenario: {"name": NO_NAMES},
    sidestep.find_planner: {"name": NO_NAMES},
    sidestep.trained_darp: {"model": NO_OBJECTS},
    lambda **given: sidestep.preset("default", "live", **given): {"nodes": NO_SEEDS, "several_maps": ("x", None, 1)},
    saved: {"figure": NO_OBJECTS, "path": NO_PATHS},
    matrix: {"value": (jax.numpy.zeros(2),)},
}


def wrong() -> Iterator[tuple[Callable[..., Any], str, Any]]:
    for function, parameters in WRONG.items():
        for field, values in parameters.items():
            yield from ((function, field, value) for value in values)


def test_wrong_arguments_are_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for function, field, value in wrong():
        with pytest.raises(SidestepError) as caught:
            function(**{field: value})
        assert caught.value.field is not None, (function, field, value)
        # Nodes that do not exist are those of an exit or a segment; positions say how many there are.
        related = {"position": {"tail", "head", "position"}, "exit_of": {"exit_of"}, "exits": {"exit_of", "exits"}}
        assert caught.value.field in related.get(field, {field}), (function, field, value, caught.value)
        assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_near_arguments_are_taken(tmp_path: Path) -> None:
    one = np.int64(1)
    found = compare(maps=(number for number in [np.int32(0)]), walks=one, seed=one, workers=one)
    assert (found.maps, found.walks, type(found.seed)) == (1, 1, int)
    assert drawn(seed=one, index=one).fingerprint == drawn(seed=1, index=1).fingerprint
    assert environment(futures=one, part=one, destinations=[[8]], hours=np.zeros(1)).futures.count == 1
    assert routes(trace=one)[0].nodes[0] == 0
    assert TINY.changed(side=np.int64(4), departures=(np.float32(0), np.float64(5))).place.side == 4
    run = train(seed=one, index=one, out=str(tmp_path / "model"), resume=np.bool_(False))
    assert sidestep.load_model(str(tmp_path / "model")).metadata.seed == run.metadata.seed == 1
    assert list(choose(models=[str(tmp_path / "model")], seed=1).factories)[-1] == "darp"
    plotting.save(Figure(), str(tmp_path / "picture.png"))
    assert (tmp_path / "picture.png").is_file()
    save_town(sidestep.load_helsinki(), str(tmp_path / "town.npz"))
    assert sidestep.load_town(str(tmp_path / "town.npz")).streets == sidestep.load_helsinki().streets


def test_results_say_what_they_lack() -> None:
    found = sidestep.compare(TINY, {"random-progress": CHOSEN.factories["random-progress"]}, maps=[0], walks=2)
    for baseline in ("expected", "none", None, ["expected"]):
        with pytest.raises(SidestepError) as caught:
            found.to_json(baseline=baseline)  # type: ignore[arg-type]
        assert caught.value.field == "baseline"
    for by in NO_MINUTES:
        with pytest.raises(SidestepError) as caught:
            found.to_json(by=by)
        assert caught.value.field == "by"


def test_walks_that_need_to_know_more() -> None:
    with pytest.raises(SidestepError) as caught:
        routes(planner=sidestep.find_planner("forecast"))
    assert caught.value.field == "level"


@pytest.mark.parametrize("name", [3, None, [], "", " "])
def test_planners_have_a_name(name: Any) -> None:
    planner = type("Mine", (type(sidestep.find_planner("expected")),), {"name": name})
    with pytest.raises(SidestepError) as caught:
        sidestep.register_planner(planner)
    assert caught.value.field == "planner"


def test_models_in_no_folder(tmp_path: Path) -> None:
    for folder in (tmp_path / "none", tmp_path, str(tmp_path / "none" / "none")):
        with pytest.raises(sidestep.SidestepError) as caught:
            sidestep.load_model(folder)
        assert type(caught.value).__name__ == "CheckpointError"


def test_specs_take_their_fields_by_name() -> None:
    for spec in (sidestep.Scenario, sidestep.TrainConfig):
        with pytest.raises(SidestepError):
            spec("rush-16")


def test_rules() -> None:
    assert (whole().read(np.uint8(7)), SEED.read(0), COUNT.read(1_000_000)) == (7, 0, 1_000_000)
    assert PATH.read(Path("a") / "b") == PATH.read("a/b") == Path("a/b")
    assert each(one_of(("a", "b")), "letters").read({"a": 1}) == ("a",)
    assert MINUTES.read(np.float32(2)) == 2.0
    assert FLAG.read(np.bool_(True)) is True


def test_defaults_are_not_checked_and_names_stay() -> None:
    @checked(SidestepError, number=Rule("must be none", lambda value: 1 / value), other=COUNT)
    def function(number: int = 0, other: int | None = None) -> tuple[int, int | None]:
        """As it stands there."""
        return number, other

    assert (function(), function(0.5, None), function.__doc__) == ((0, None), (2.0, None), "As it stands there.")
    with pytest.raises(ZeroDivisionError):  # a fault of ours stays one
        function(0)


def test_hints_end_a_sentence() -> None:
    names = ["rush-16", "rush-32", "helsinki"]
    assert hint("rush16", names) == "; did you mean rush-16?"
    assert hint("Rush-16", names, "a file") == "; did you mean rush-16, or a file?"
    assert hint("zoo", names) == "; choose from rush-16, rush-32 or helsinki"
    assert hint("zoo", names, "a file") == "; choose from rush-16, rush-32, helsinki or a file"
    assert hint("zoo", ["helsinki"]) == "; it must be helsinki"
    many = [f"{number}" for number in range(100)]
    assert (hint("zoo", many), hint("zoo", many, "a file"), hint("zoo", [])) == ("", "; it must be a file", "")
