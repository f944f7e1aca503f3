"""Colours of routes: seen against what they are drawn on, and told apart by all eyes."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

WEB = Path(__file__).parents[2] / "src" / "sidestep" / "web"
GROUNDS = ("paper", "card", "raised", "tint")
"""What routes are drawn on: the map, and rows of their table."""
TO_OKLAB = (
    np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]]),
    np.array([[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]]),
)
"""Ottosson (2020), in which distances are about those that are seen."""
EYES = {
    "all cones": np.eye(3),
    "protanopia": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deuteranopia": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
    "tritanopia": np.array([[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]]),
}
"""Linear RGB as these see it: Machado, Oliveira and Fernandes (2009), severity 1."""
LEAST = {"all cones": 0.12, "protanopia": 0.12, "deuteranopia": 0.12, "tritanopia": 0.05}
"""Distance between two routes; of tritanopia, which one person in 30,000 has, dashes do the rest."""


@pytest.fixture(params=["light", "dark"])
def colours(request) -> dict[str, np.ndarray]:
    """The colours of a theme, as linear RGB by name."""
    sheets = "".join(path.read_text() for path in WEB.glob("*.css"))
    found = re.findall(r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\)", sheets)
    chosen = {name: light if request.param == "light" else dark for name, light, dark in found}
    srgb = {name: np.array([int(code[at : at + 2], 16) for at in (1, 3, 5)]) / 255 for name, code in chosen.items()}
    return {name: np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for name, c in srgb.items()}


def contrast(one: np.ndarray, other: np.ndarray) -> float:
    """As WCAG 2 defines it."""
    dark, light = sorted(each @ (0.2126, 0.7152, 0.0722) for each in (one, other))
    return (light + 0.05) / (dark + 0.05)


def test_routes_stand_out_from_what_they_are_drawn_on(colours):
    routes = [colour for name, colour in colours.items() if name.startswith("route-")]
    assert len(routes) == 6
    assert min(contrast(route, colours[ground]) for route in routes for ground in GROUNDS) >= 3


@pytest.mark.parametrize("eyes", EYES)
def test_routes_are_told_apart(colours, eyes):
    one, two = TO_OKLAB
    routes = [colour for name, colour in colours.items() if name.startswith("route-")]
    seen = [two @ np.cbrt(np.clip(one @ np.clip(EYES[eyes] @ route, 0, 1), 0, None)) for route in routes]
    assert min(np.linalg.norm(a - b) for a, b in combinations(seen, 2)) >= LEAST[eyes]
