"""Pictures are drawn of whatever planners there are."""

import numpy as np
import pytest

from sidestep import plotting
from sidestep.planners.base import Route


def texts(figure) -> str:
    return " ".join(item.get_text() for item in figure.findobj(match=lambda artist: hasattr(artist, "get_text")))


def test_learning_curves_take_planners_without_a_colour_of_their_own() -> None:
    curves = {name: plotting.Curve(np.full((2, 3), 70.0), 1_000) for name in ("darp", "mine")}
    figure = plotting.learning_curves("some streets", curves, {"expected": 60.0, "another": 80.0})
    said = texts(figure)
    for text in ("some streets", "expected (-60)", "another (-80)", "mine (-70 after 3 rounds of 1,000 steps)"):
        assert text in said


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
