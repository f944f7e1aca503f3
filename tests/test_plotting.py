"""Pictures are drawn of whatever planners there are."""

import numpy as np
import pytest

from sidestep import plotting
from sidestep.agent.checkpoint import Metadata
from sidestep.agent.presets import preset
from sidestep.planners.base import Route
from sidestep.scenarios.builtin import scenario


def texts(figure) -> str:
    return " ".join(item.get_text() for item in figure.findobj(match=lambda artist: hasattr(artist, "get_text")))


def test_learning_curves_take_planners_without_a_colour_of_their_own() -> None:
    curves = {name: plotting.Curve(np.full((2, 3), 70.0), 1_000) for name in ("darp", "mine")}
    figure = plotting.learning_curves("some streets", curves, {"expected": 60.0, "another": 80.0})
    said = texts(figure)
    for text in ("some streets", "expected (-60)", "another (-80)", "mine (-70 after 3 rounds of 1,000 steps)"):
        assert text in said


@pytest.mark.parametrize(
    ("keep", "curve", "scale", "kept"),
    [
        ("last", ((60.0, 100.0), (50.0, 70.0), (62.0, 60.0)), "linear", (3, 61)),
        ("best", ((60.0, 100.0), (50.0, 70.0), (62.0, 60.0)), "linear", (2, 60)),
        ("best", ((60.0, 60.0), (1440.0, 1440.0), (60.0, 60.0)), "log", (3, 60)),  # the later of equals
    ],
)
def test_the_learning_curve_of_a_training(keep: str, curve, scale: str, kept: tuple[int, float]) -> None:
    config = preset("default").changed(keep=keep, test_walks=2, rounds=9)
    problem = scenario("paper-congested")
    trained = Metadata(scenario=problem, seed=4, map=2, config=config, curve=curve, fingerprint="")
    figure = plotting.draw_training(trained)
    (axes,) = figure.axes
    line, dot = axes.lines
    assert line.get_xydata().tolist() == [[number, sum(walks) / 2] for number, walks in enumerate(curve, 1)]
    assert dot.get_xydata().tolist() == [list(kept)]
    assert axes.get_yscale() == scale
    said = texts(figure)
    for text in (
        "paper-congested, map 2, seed 4, level position: 3 of 9 rounds",
        "rounds of 2,560 transitions",
        "minutes",
        "mean of 2 greedy test walks",
        problem.summary,
        problem.place.synthetic,
        "1,440 minutes",
    ):
        assert text in said  # fmt: skip


def test_the_learning_curve_of_costs_says_so() -> None:
    problem = scenario("paper-congested").changed(objective={"exposure": 1.0})
    trained = Metadata(scenario=problem, seed=0, map=0, config=preset("default"), curve=((50.0, 60.0),), fingerprint="")
    assert plotting.draw_training(trained).axes[0].get_ylabel().startswith("minutes of cost")


def test_a_map_shows_routes_side_by_side(diamond, constant_field, make_params, tmp_path) -> None:
    params = make_params(diamond, constant_field(diamond))
    routes = {
        "darp": Route((0, 1), (0, 1, 3), (0.0, 100.0, 300.0), 300.0, arrived=True),
        "mine": Route((2,), (0, 2), (0.0, 150.0), 1000.0, arrived=False),
    }
    figure = plotting.crowded_map("a map", params, np.linspace(100, 5000, 8), routes)
    said = texts(figure)
    for text in ("a map", "darp: 5 min", "mine: 17 min (did not arrive)", "origin", "destination", "250 m"):
        assert text in said
    plotting.save(figure, tmp_path / "map.png")
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert [file.name for file in tmp_path.iterdir()] == ["map.png"]


@pytest.mark.parametrize("name", ["expected", "mine"])
def test_a_trade_off_has_a_point_for_each_weight(name: str) -> None:
    points = [
        {"weight": weight, "minutes": 20.0 + weight, "exposure": 100.0 - weight, "metres": 900.0, "arrival_rate": 1.0}
        for weight in (0.0, 0.5)
    ]
    figure = plotting.trade_off_curve("time against crowds", "invented", {name: points})
    (axes,) = figure.axes
    (line,) = axes.lines
    assert line.get_xydata().tolist() == [[20, 100], [20.5, 99.5]]
    said = texts(figure)
    for text in ("time against crowds", "invented", name, "0.5"):
        assert text in said
