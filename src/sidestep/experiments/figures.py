"""Pictures. The only module that imports matplotlib."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from sidestep.environment.types import EnvParams
from sidestep.files import whole_file
from sidestep.network.graph import RoadNetwork
from sidestep.planners.base import Route

INK = "#1f2933"
COLOURS = {
    "darp": "#d1495b",
    "darp-paper": "#edae49",
    "shortest-path": "#30638e",
    "random-progress": "#8d99ae",
    "expected": "#6a994e",
    "clairvoyant": "#003d5b",
}
STYLES = {"clairvoyant": ":", "expected": "--", "shortest-path": "-", "random-progress": "-."}


@dataclass(frozen=True)
class Curve:
    """Minutes after every round, over maps."""

    minutes: Float[np.ndarray, "map round"]
    round_steps: int


def save(figure: Figure, path: Path) -> None:
    """Write a picture, whole or not at all."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)


def learning_curves(title: str, curves: Mapping[str, Curve], lines: Mapping[str, float]) -> Figure:
    """The paper's figures 4 and 5: minus the minutes of greedy test walks over rounds of training.

    Thick lines are means over maps, bands the middle half of the maps; baselines that do not learn are level. Minutes
    go from near zero (walkers that arrive) to the horizon (walkers that do not), hence the logarithmic axis.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for name, minutes in lines.items():
        label = f"{name} ({-minutes:.0f})"
        axes.axhline(minutes, color=COLOURS[name], linestyle=STYLES[name], linewidth=1.6, label=label)
    for name, curve in curves.items():
        rounds = np.arange(1, curve.minutes.shape[1] + 1)
        low, high = np.percentile(curve.minutes, [25, 75], axis=0)
        mean = curve.minutes.mean(axis=0)
        axes.fill_between(rounds, low, high, color=COLOURS[name], alpha=0.2, linewidth=0)
        label = f"{name} ({-mean[-1]:.0f} after {len(rounds)} rounds of {curve.round_steps:,} steps)"
        axes.plot(rounds, mean, color=COLOURS[name], linewidth=2.4, label=label)
    axes.set_yscale("log")
    axes.invert_yaxis()
    ticks = [50, 75, 100, 150, 250, 500, 1000, 1440]
    axes.set_yticks(ticks, [str(-tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("training rounds")
    axes.set_ylabel("average time cost (minus minutes)")
    axes.set_title(title, loc="left", color=INK)
    axes.grid(axis="y", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    # Below the axes: inside, some curve would lie under it.
    figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=2)
    return figure


def crowded_map(
    title: str, params: EnvParams, volume: Float[np.ndarray, " segment"], routes: Mapping[str, Route]
) -> Figure:
    """The streets, coloured by the people on them at departure, and the routes of planners side by side."""
    network = params.network
    figure = Figure(figsize=(8.5, 7.5), layout="constrained")
    axes = figure.subplots()
    ends = np.asarray(network.position)[np.stack([network.tail, network.head], axis=1)]  # [segment, end, xy]
    spacing = float(np.abs(ends[:, 0] - ends[:, 1]).max())
    fewest, most = max(float(volume.min()), 1.0), float(volume.max())
    streets = LineCollection(
        list(_beside(ends, 0.035 * spacing)),
        array=volume,
        cmap="YlOrBr",
        norm=LogNorm(fewest, most),
        linewidths=4,
        capstyle="round",
    )
    axes.add_collection(streets)
    bar = figure.colorbar(streets, ax=axes, shrink=0.7, label="people on the segment at departure")
    ticks = [tick for tick in (200, 500, 1000, 2000, 5000) if fewest <= tick <= most]
    bar.set_ticks(ticks, labels=[f"{tick:,}" for tick in ticks])
    bar.minorticks_off()
    _label_lengths(axes, network, ends)
    for rank, (name, route) in enumerate(routes.items()):
        points = np.asarray(network.position)[list(route.nodes)]
        legs = np.stack([points[:-1], points[1:]], axis=1)
        shift = (rank - (len(routes) - 1) / 2) * 0.045 * spacing
        line = _beside(legs, shift).reshape(-1, 2)
        label = f"{name}: {route.seconds / 60:.0f} min" + ("" if route.arrived else " (did not arrive)")
        axes.plot(*line.T, color=COLOURS[name], linewidth=2.6, label=label, zorder=3, solid_joinstyle="round")
    for node, text in ((_routes_end(routes, 0), "origin"), (_routes_end(routes, -1), "destination")):
        x, y = np.asarray(network.position)[node]
        axes.plot(x, y, "o", color=INK, markersize=9, zorder=4)
        axes.annotate(
            text,
            (x, y),
            xytext=(0, -16 if text == "origin" else 10),
            textcoords="offset points",
            ha="center",
            color=INK,
        )
    axes.set_aspect("equal")
    axes.axis("off")
    axes.margins(0.08)
    # Of the figure, not of the axes: its layout then leaves room for them.
    figure.suptitle(title, color=INK)
    figure.legend(frameon=False, loc="outside lower center", ncols=len(routes))
    return figure


def _routes_end(routes: Mapping[str, Route], which: int) -> int:
    """First or last node of the routes; the last is taken from one that arrived, if any did."""
    arrived = [route for route in routes.values() if route.arrived] or list(routes.values())
    return arrived[0].nodes[which]


def _beside(legs: Float[np.ndarray, "leg 2 2"], shift: float) -> Float[np.ndarray, "leg 2 2"]:
    """Move legs sideways, to the right of their direction, so that those over the same street stay apart."""
    along = legs[:, 1] - legs[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    right = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return legs + shift * right[:, None]


def _label_lengths(axes, network: RoadNetwork, ends: Float[np.ndarray, "segment 2 2"]) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    """Write lengths beside the streets: on this map they are not to scale."""
    tail, head, length = (np.asarray(part) for part in (network.tail, network.head, network.length))
    for segment in np.flatnonzero(tail < head):
        (x0, y0), (x1, y1) = ends[segment]
        upright = abs(y1 - y0) > abs(x1 - x0)
        axes.annotate(
            f"{length[segment]:.0f} m",
            ((x0 + x1) / 2, (y0 + y1) / 2),
            xytext=(-9, 0) if upright else (0, 9),
            textcoords="offset points",
            rotation=90 if upright else 0,
            ha="center",
            va="center",
            fontsize=6.5,
            color=INK,
            alpha=0.6,
        )
