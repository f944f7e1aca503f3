"""Pictures are drawn of whatever planners there are."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.path import Path

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
        ("mean", ((60.0, 100.0), (50.0, 70.0), (62.0, 60.0)), "linear", (3, 61)),
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


STEPS = np.arange(8.0)
CURVES = {
    "falling": [np.stack([20 + STEPS, 1000 / (1 + STEPS)], axis=1)],
    "two, one above the other": [np.stack([20 + STEPS, high - 9 * STEPS], axis=1) for high in (100, 103)],
    "two, crossing": [np.stack([20 + STEPS, high + slope * STEPS], axis=1) for high, slope in ((100, -9), (37, 9))],
    "the same twice": [np.stack([20 + STEPS, 100 - 9 * STEPS], axis=1)] * 2,
    "in one place": [np.full((8, 2), 30.0)],
    "nearly in one place": [30 + 1e-3 * np.stack([STEPS, -STEPS], axis=1), [[31, 30.0], [33, 31.0]]],
    "steep, then level": [[[20, 900], [20.01, 400], [20.02, 200], [20.03, 190], [25, 189], [25.1, 188], [40, 187]]],
    "back and forth": [[[20, 50], [21, 49], [20.2, 48], [20.9, 47], [20.4, 46], [20.8, 45], [20.5, 44]]],
    "one point": [[[20.0, 50.0]]],
    "nobody met": [[[20, 0], [21, 0], [22, 0]]],
    "a heap beside a far point": [[[20 + 0.02 * step, 50 - 0.4 * step] for step in range(7)] + [[90, 1]]],
    "many": [np.stack([20 + STEPS + shift, 100 - 9 * STEPS + 7 * shift], axis=1) for shift in range(4)],
}


@pytest.mark.parametrize("shape", CURVES)
def test_labels_of_a_trade_off_cover_nothing(shape: str) -> None:
    weights = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 100.0)
    curves = {
        f"planner {number}": [
            {"weight": weight, "minutes": minutes, "exposure": met, "metres": 900.0, "arrival_rate": 1.0}
            for weight, (minutes, met) in zip(weights, curve, strict=False)
        ]
        for number, curve in enumerate(CURVES[shape])
    }
    figure = plotting.trade_off_curve("a title", "a caption", curves)
    (axes,) = figure.axes
    for dpi in (figure.dpi, 150):  # as saved
        figure.dpi = dpi
        figure.draw_without_rendering()
        boxes = [text.get_window_extent() for text in axes.texts]
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
        frame = axes.get_window_extent().padded(1)
        for box in boxes:
            assert frame.contains(*box.min), box
            assert frame.contains(*box.max), box
            for line in axes.lines:
                course = axes.transData.transform(line.get_xydata())
                assert not Path(course).intersects_bbox(box, filled=False)
                assert not any(box.padded(3 * figure.dpi / 72).contains(*point) for point in course)
        (legend,) = figure.legends
        assert not legend.get_window_extent().overlaps(axes.get_window_extent())
    said = {weight for text in axes.texts for weight in text.get_text().split(" to ")}
    for points in curves.values():  # of every curve at least the ends are labelled
        assert {f"{points[end]['weight']:g}" for end in (0, -1)} <= said


def test_points_in_one_place_have_one_label() -> None:
    points = [
        {"weight": weight, "minutes": minutes, "exposure": 9.0, "metres": 900.0, "arrival_rate": 1.0}
        for weight, minutes in ((0.0, 20.0), (0.1, 20.0), (0.2, 20.0001), (0.5, 25.0), (1.0, 30.0), (2.0, 30.0))
    ]
    (axes,) = plotting.trade_off_curve("", "", {"expected": points}).axes
    assert sorted(text.get_text() for text in axes.texts) == ["0 to 0.2", "0.5", "1 to 2"]
