"""Pictures. The only module that imports matplotlib."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, NamedTuple, TypedDict

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib import colormaps, get_backend
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.registry import BackendFilter, backend_registry
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, MaxNLocator
from matplotlib.transforms import Bbox, BboxBase

from sidestep.agent.checkpoint import Metadata
from sidestep.arguments import PATH, checked, instance
from sidestep.environment.types import EnvParams
from sidestep.errors import SidestepError
from sidestep.files import OutputError, whole_file
from sidestep.network.graph import RoadNetwork
from sidestep.network.tags import ACROSS
from sidestep.network.town import Town
from sidestep.planners.base import Route
from sidestep.routing.crowds import StreetCrowds
from sidestep.routing.departures import DepartureWindow
from sidestep.routing.facts import SceneFacts, StreetMap
from sidestep.routing.isochrone import Isochrone
from sidestep.routing.matrix import TimeMatrix
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import on_map
from sidestep.scenarios.streets import sources_of

INK = "#1f2933"
LOOKS = {
    "darp": ("#d1495b", "-"),
    "darp-paper": ("#edae49", "-"),
    "shortest-path": ("#30638e", "-"),
    "random-progress": ("#8d99ae", "-."),
    "expected": ("#6a994e", "--"),
    "clairvoyant": ("#003d5b", ":"),
}
"""Colour and line style of planners."""
ROUTE = "#1565c0"  # far from the colours of crowds
# Without the palest colours, which cannot be seen on white.
_CROWDS = LinearSegmentedColormap.from_list("crowds", colormaps["YlOrBr"](np.linspace(0.2, 1, 32)))
_SPARSE = 0.02  # persons/m²; with fewer a street counts as empty
_MARKER = 7.0  # points; of the curves of trade-offs, with its edge
_ROOM = 40.0  # m around the streets of a town
_OTHERS = ("#7b2d8b", "#00838f", "#5d4037", "#455a64")  # of alternatives, as far from the colours of crowds
_WIDE_RATIO = 5.0  # of the longest walk to the shortest: beyond, small differences cannot be seen on a linear axis
_SURE = 0.9  # share of the futures whose areas have a line around them
_MOST_LABELS, _MOST_NUMBERS = 40, 400  # on one side of a matrix, and in it
_MANY_SEGMENTS = 1_000  # from here on they are drawn as thin lines
_HALO: dict[str, Any] = {"path_effects": [withStroke(linewidth=3, foreground="white")]}  # readable on streets


@dataclass(frozen=True)
class Curve:
    """The learning curve of one preset."""

    minutes: Float[np.ndarray, "map round"]
    """Mean minutes of the greedy test walks after every round."""

    round_steps: int
    """Steps of a round."""


@checked(OutputError, figure=instance(Figure, "a picture, such as draw_route(plan)"), path=PATH)
def save(figure: Figure, path: File | str) -> None:
    """Write a picture, whole or not at all.

    Parameters
    ----------
    figure, path
        The picture, and its file.

    Raises
    ------
    OutputError
        Anything else, or a file that cannot be written.
    """
    with whole_file(File(path)) as temporary:
        figure.savefig(temporary, format="png", dpi=150)


def learning_curves(title: str, curves: Mapping[str, Curve], lines: Mapping[str, float]) -> Figure:
    """Draw the paper's figures 4 and 5: minus the minutes of greedy test walks over rounds of training.

    Thick lines are means over maps, bands the middle half of the maps; planners that do not learn are level lines.
    Minutes reach from near zero (walkers that arrive) to the horizon (walkers that do not), hence the logarithmic axis.

    Parameters
    ----------
    title
        Heading of the picture.
    curves
        Learning curves by preset.
    lines
        Mean minutes by planner.

    Returns
    -------
    Figure
        To be saved by :func:`save`.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for number, (name, minutes) in enumerate(lines.items()):
        colour, style = _look(name, number)
        axes.axhline(minutes, color=colour, linestyle=style, linewidth=1.6, label=f"{name} ({-minutes:.0f})")
    for number, (name, curve) in enumerate(curves.items()):
        colour, _ = _look(name, number)
        rounds = np.arange(1, curve.minutes.shape[1] + 1)
        low, high = np.percentile(curve.minutes, [25, 75], axis=0)
        mean = curve.minutes.mean(axis=0)
        axes.fill_between(rounds, low, high, color=colour, alpha=0.2, linewidth=0)
        label = f"{name} ({-mean[-1]:.0f} after {len(rounds)} rounds of {curve.round_steps:,} steps)"
        axes.plot(rounds, mean, color=colour, linewidth=2.4, label=label)
    axes.set_yscale("log")
    axes.invert_yaxis()
    ticks = [50, 75, 100, 150, 250, 500, 1000, 1440]
    axes.set_yticks(ticks, [str(-tick) for tick in ticks])
    axes.minorticks_off()
    axes.set(xlabel="training rounds", ylabel="average time cost (minus minutes)")
    axes.set_title(title, loc="left", color=INK)
    axes.grid(axis="y", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    # Below the axes: inside, some curve would lie under it.
    figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=2)
    return figure


def draw_training(trained: Metadata) -> Figure:
    """Draw the learning curve of one training, finished or not: how long its greedy test walks took, round by round.

    The line is the mean of the test walks, the band the middle half of them.

    Parameters
    ----------
    trained
        What was trained: the ``metadata`` of a run, a checkpoint or a model.

    Returns
    -------
    Figure
        To be saved by :func:`save`.

    Examples
    --------
    >>> import sidestep
    >>> from sidestep.plotting import draw_training
    >>> small = sidestep.preset("default").changed(rounds=2, round_steps=64, walkers=8, batch=16, capacity=64)
    >>> run = sidestep.train(sidestep.scenario("paper-congested", side=3, crowded_nodes=1), small)
    >>> draw_training(run.metadata).axes[0].get_xlabel()
    'rounds of 64 transitions'
    """
    config, scenario = trained.config, trained.scenario
    minutes = np.array(trained.curve)  # [round, walk]
    mean, rounds = minutes.mean(axis=1), np.arange(1, len(minutes) + 1)
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    colour = LOOKS["darp"][0]
    low, high = np.percentile(minutes, [25, 75], axis=1)
    axes.fill_between(rounds, low, high, color=colour, alpha=0.2, linewidth=0, label="middle half of the walks")
    axes.plot(rounds, mean, color=colour, linewidth=2.2, label=f"mean of {minutes.shape[1]} greedy test walks")
    kept = int(np.flatnonzero(mean == mean.min())[-1]) if config.keep == "best" else len(mean) - 1
    style: dict[str, Any] = {"color": INK, "markersize": 7, "zorder": 4, "clip_on": False}
    which = "last" if config.keep == "mean" else "kept"  # the mean network is none of those that were tested
    axes.plot(rounds[kept], mean[kept], "o", label=f"{which}: {mean[kept]:.1f} after round {rounds[kept]}", **style)
    if minutes.max() > _WIDE_RATIO * minutes.min() > 0:  # early walks often do not arrive
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:,.0f}")
        axes.yaxis.set_minor_formatter("")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    unit = "minutes" if scenario.objective.is_time else "minutes of cost"
    axes.set(xlabel=f"rounds of {config.round_steps:,} transitions", ylabel=f"{unit} (lower is better)")
    what = f"{scenario.name}, map {trained.map}, seed {trained.seed}, level {config.level}"
    axes.set_title(f"{what}: {len(rounds):,} of {config.rounds:,} rounds", loc="left", fontsize=10, color=INK)
    axes.grid(axis="y", alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    horizon = f"A walk that does not arrive counts as the horizon, {scenario.horizon / 60:,.0f} minutes."
    figure.supxlabel("\n".join([*sources_of(scenario), horizon]), fontsize=8, color=INK)
    return figure


def crowded_map(
    title: str, params: EnvParams, volume: Float[np.ndarray, " segment"], routes: Mapping[str, Route]
) -> Figure:
    """Draw a grid's streets, coloured by the people on them, and the routes of planners side by side.

    Parameters
    ----------
    title
        Heading of the picture.
    params
        The environment.
    volume
        Persons on each segment at the departure.
    routes
        One route by each planner.

    Returns
    -------
    Figure
        To be saved by :func:`save`.
    """
    network = params.network
    figure = Figure(figsize=(8.5, 7.5), layout="constrained")
    axes = figure.subplots()
    ends = np.asarray(network.position)[np.stack([network.tail, network.head], axis=1)]  # [segment, end, xy]
    spacing = float(np.abs(ends[:, 0] - ends[:, 1]).max())
    streets = LineCollection(
        list(_beside(ends, 0.035 * spacing)), array=volume, cmap="YlOrBr", linewidths=4, capstyle="round"
    )
    streets.set_norm(LogNorm(max(float(volume.min()), 1.0), float(volume.max())))
    _add_coloured(axes, streets, "people on the segment at the departure", (200, 500, 1000, 2000, 5000))
    _label_lengths(axes, network, ends)
    for rank, (name, route) in enumerate(routes.items()):
        points = np.asarray(network.position)[list(route.nodes)]
        legs = np.stack([points[:-1], points[1:]], axis=1)
        shift = (rank - (len(routes) - 1) / 2) * 0.045 * spacing
        line = _beside(legs, shift).reshape(-1, 2)
        label = f"{name}: {route.seconds / 60:.0f} min" + ("" if route.arrived else " (did not arrive)")
        axes.plot(*line.T, color=_look(name, rank)[0], linewidth=2.6, label=label, zorder=3, solid_joinstyle="round")
    # The destination is that of a walk that arrived, if any did.
    shown = next((route for route in routes.values() if route.arrived), next(iter(routes.values())))
    for node, text, up in ((shown.nodes[0], "origin", -16), (shown.nodes[-1], "destination", 10)):
        place = np.asarray(network.position)[node]
        axes.plot(*place, "o", color=INK, markersize=9, zorder=4)
        _note(axes, text, place, (0, up), ha="center")
    axes.set_aspect("equal")
    axes.axis("off")
    axes.margins(0.08)
    # Of the figure, not of the axes: its layout then leaves room for them.
    figure.suptitle(title, color=INK)
    figure.legend(frameon=False, loc="outside lower center", ncols=len(routes))
    return figure


class WalkPicture:
    """A walker under way, drawn anew after every step: an image, or a window.

    Parameters
    ----------
    network, free_speed
        The streets, and the speed of the walker in an empty one, m/s.
    window
        Whether it is shown in a window.

    Raises
    ------
    SidestepError
        No window can be opened here (field ``render_mode``).
    """

    def __init__(self, network: RoadNetwork, free_speed: float, *, window: bool = False) -> None:
        self._position, self.window = np.asarray(network.position), window
        self.figure = _window() if window else Figure()
        self.figure.set(figwidth=7.2, figheight=7.2, layout_engine="constrained")
        if not window:
            FigureCanvasAgg(self.figure)
        axes = self.figure.subplots()
        ends = self._position[np.stack([network.tail, network.head], axis=1)]  # [segment, end, xy]
        legs = _beside(ends, 0.06 * float(np.median(np.asarray(network.length))))
        slow = _CROWDS.reversed()
        width = 4 if len(legs) < _MANY_SEGMENTS else 1.2
        self._streets = LineCollection(list(legs), array=np.full(len(legs), free_speed), cmap=slow, linewidths=width)
        self._streets.set_clim(0, free_speed)
        _add_coloured(axes, self._streets, "walking speed now, m/s", (0, 0.25, 0.5, 0.75, 1, 1.25, 1.5), pad=0.02)
        style: dict[str, Any] = {"zorder": 3, "solid_joinstyle": "round", "clip_on": False}
        self._walk = axes.plot([], [], color=ROUTE, linewidth=3, **style)[0]
        dots: dict[str, Any] = {"linestyle": "", "marker": "o", "zorder": 4, "clip_on": False, "markeredgecolor": INK}
        self._end = axes.plot([], [], color=INK, markersize=11, label="destination", **dots)[0]
        self._walker = axes.plot([], [], color="white", markersize=11, markeredgewidth=2.5, label="walker", **dots)[0]
        axes.set_aspect("equal")
        axes.axis("off")
        axes.autoscale_view()
        axes.margins(0.04)
        self._title = axes.set_title("", color=INK, fontsize=11)
        self.figure.legend(frameon=False, loc="outside lower center", ncols=2)

    def update(self, title: str, nodes: Sequence[int], destination: int, speed: Float[np.ndarray, " segment"]) -> None:
        """Draw where the walker is now.

        Parameters
        ----------
        title
            Heading of the picture.
        nodes, destination
            Where the walker has been, the latest last, and where it goes.
        speed
            Of walkers on each segment now, m/s.
        """
        walked = self._position[list(nodes)]
        for line, points in (
            (self._walk, walked),
            (self._walker, walked[-1:]),
            (self._end, self._position[[destination]]),
        ):
            line.set_data(*points.T)
        self._streets.set_array(speed)
        self._title.set_text(title)
        self.figure.canvas.draw()

    def pixels(self) -> UInt8[np.ndarray, "row column 3"]:
        """The picture as it was drawn last."""
        canvas: Any = self.figure.canvas
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def show(self, seconds: float) -> None:
        """Keep the window open, and answer to the mouse, for some seconds."""
        manager = self.figure.canvas.manager
        if _has_windows() and manager is not None:
            manager.show()
            self.figure.canvas.start_event_loop(seconds)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.window:
            from matplotlib import pyplot as plt

            plt.close(self.figure)


def _has_windows() -> bool:
    return get_backend() in backend_registry.list_builtin(BackendFilter.INTERACTIVE)  # type: ignore[no-untyped-call]


def _window() -> Figure:
    """A figure of its own window. A backend without windows is taken only where somebody has chosen it."""
    from matplotlib import pyplot as plt

    chosen = get_backend(auto_select=False)
    if chosen is None:
        plt.switch_backend(get_backend())
    if chosen is None and not _has_windows():
        raise SidestepError(
            "render_mode human needs a display, and none is here; take rgb_array, or set MPLBACKEND",
            field="render_mode",
        )
    return plt.figure()


def draw_route(plan: RoutePlan) -> Figure:
    """Draw a route, and the streets around it, coloured by the crowds that are expected on them at the departure.

    Parameters
    ----------
    plan
        The route, in a town.

    Returns
    -------
    Figure
        To be saved by :func:`save`.

    Raises
    ------
    RouteError
        On grids, which have no coordinates (field ``format``).
    """
    streets = on_map(plan.streets)
    town = streets.town
    course = town.project(np.array(plan.course))
    others = [town.project(np.array(other.course)) for other in plan.alternatives]
    frame = _frame(np.concatenate([course, *others]), town.project(town.points))
    figure, axes = _map_of(frame)
    _add_crowds(axes, streets, frame, "persons/m² expected at the departure")
    for number, other in reversed(list(enumerate(others, start=1))):
        colour, label = _OTHERS[(number - 1) % len(_OTHERS)], _other_in_words(number, plan.alternatives[number - 1])
        _draw_course(axes, other, colour, 2.6, label=label, zorder=2.5)
    _draw_course(axes, course, ROUTE, 3.4, label="best" if others else "route")
    for place, text, face in ((course[0], "start", "white"), (course[-1], "end", INK)):
        _mark(axes, place, text, face)
    _draw_avoided(axes, town, plan)
    if others or plan.avoided_area:
        _legend_below(axes, 2)
    walk = f"{plan.metres:,.0f} m, {plan.expected_minutes:.0f} min, planned by {plan.planner}"
    return _titled(figure, f"{plan.scenario}, {plan.departs}: {walk}", plan)


def _other_in_words(number: int, other: RoutePlan) -> str:
    return f"alternative {number}: {other.metres:,.0f} m, {other.expected_minutes:.0f} min"


def draw_crowds(crowds: StreetCrowds) -> Figure:
    """Draw all streets of a town, coloured by the crowds that are expected on them.

    Parameters
    ----------
    crowds
        The crowds, in a town.

    Returns
    -------
    Figure
        To be saved by :func:`save`.

    Raises
    ------
    RouteError
        On grids, which have no coordinates (field ``format``).
    """
    streets = on_map(crowds.map)
    town = streets.town
    frame = _whole(town)
    figure, axes = _map_of(frame)
    _add_crowds(axes, streets, frame, "expected persons/m²")
    return _titled(figure, f"{crowds.scenario}, {crowds.departs}: crowds as expected", crowds)


def draw_isochrone(reach: Isochrone) -> Figure:
    """Draw what is reached in some minutes: areas, on the streets of a town.

    Colours are those of the minutes. With futures, what is reached in half of them is pale, and what is reached in 90 %
    has a line around it.

    Parameters
    ----------
    reach
        What is reached, in a town.

    Returns
    -------
    Figure
        To be saved by :func:`save`.

    Raises
    ------
    RouteError
        On grids, which have no coordinates (field ``format``).
    """
    town, origin = on_map(reach.town), np.array([[reach.origin.longitude, reach.origin.latitude]], float)
    rings = [town.project(np.array(rings[0])) for area in reach.areas for rings in area.polygons or []]
    frame = _frame(np.concatenate([town.project(origin), *rings]), town.project(town.points), room=1.1)
    figure, axes = _map_of(frame)
    near = _near(town, frame)
    axes.add_collection(LineCollection(near.courses, colors="#8d99ae", linewidths=0.8, zorder=2.5))
    limits = sorted({area.minutes for area in reach.areas})
    shades = colormaps["viridis_r"](np.linspace(0.1, 0.85, len(limits)))
    for area in reversed(reach.areas):
        shade, outlined = shades[limits.index(area.minutes)], area.share == _SURE
        path = _outline(town, area.polygons or [])
        look = {"facecolor": "none", "edgecolor": shade, "linewidth": 2.0, "zorder": 3} if outlined else {}
        face = {"facecolor": 0.5 + shade / 2, "edgecolor": "none", "zorder": 2} | look
        axes.add_patch(PathPatch(path, label=area.called, **face))
    _mark(axes, town.project(origin)[0], "start", "white")
    _draw_avoided(axes, town, reach)
    _legend_below(axes, 3)
    crowds = "crowds as expected" if reach.futures is None else f"{reach.futures} simulated futures"
    return _titled(figure, f"{reach.scenario}, {reach.departs}: reached on foot, {crowds}", reach)


def draw_departures(window: DepartureWindow) -> Figure:
    """Draw how long a walk takes by its departure: half of the futures, 90 % of them, and if crowds are as expected.

    Parameters
    ----------
    window
        The departures.

    Returns
    -------
    Figure
        To be saved by :func:`save`.
    """
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    after = [departure.departure_minutes for departure in window.departures]
    for name, colour, style, label in (
        ("p90_minutes", "#d1495b", "-", "90 % arrive within"),
        ("median_minutes", ROUTE, "-", "half arrive within"),
        ("expected_minutes", "#6a994e", "--", "if crowds are as expected"),
    ):
        minutes = [getattr(departure, name) for departure in window.departures]
        axes.plot(after, minutes, color=colour, linestyle=style, linewidth=2, label=label)
    best = window.best
    dot: dict[str, Any] = {"color": INK, "markersize": 7, "zorder": 4, "label": f"best: {best.departs}"}
    axes.plot(best.departure_minutes, best.p90_minutes, "o", **dot)
    shown = window.departures[:: max(1, -(-len(after) // 8))]
    axes.set_xticks([each.departure_minutes for each in shown], [_clock_word(each.departs) for each in shown])
    axes.set(xlabel="departure", ylabel="minutes", ylim=(0, None))
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="lower left")
    ends = f"{window.origin.asked} to {window.destination.asked}"
    axes.set_title(f"{window.scenario}, {window.span}: {ends}, by {window.planner}", loc="left", fontsize=10, color=INK)
    figure.supxlabel("\n".join(window.sources), fontsize=8, color=INK)
    return figure


def _clock_word(departs: str) -> str:
    """The time of a departure, without its day: the word with a colon, or else minutes."""
    words = departs.split()
    return next((word for word in words if ":" in word), words[0])


def draw_matrix(matrix: TimeMatrix) -> Figure:
    """Draw the minutes from many places to many others as a table of colours; grey where no path leads.

    Parameters
    ----------
    matrix
        The minutes. Those within which 90 % of the walks arrive are drawn if they are known.

    Returns
    -------
    Figure
        To be saved by :func:`save`.
    """
    minutes = np.array(matrix.minutes if matrix.p90 is None else matrix.p90, float)
    rows, columns = minutes.shape
    figure = Figure(figsize=(6 + min(0.25 * columns, 6), 3.5 + min(0.3 * rows, 8)), layout="constrained")
    axes = figure.subplots()
    colours = colormaps["viridis_r"].with_extremes(bad="#d0d4da")
    image = axes.imshow(np.ma.masked_invalid(minutes), cmap=colours, aspect="auto", vmin=0)
    label = "minutes, crowds as expected" if matrix.p90 is None else "minutes, 90 % arrive"
    figure.colorbar(image, ax=axes, label=label)
    for axis, ends in ((axes.xaxis, matrix.destinations), (axes.yaxis, matrix.origins)):
        every = max(1, -(-len(ends) // _MOST_LABELS))
        names = [end.called for end in ends[::every]]
        axis.set_ticks(range(0, len(ends), every), names, fontsize=7, rotation=90 if axis is axes.xaxis else 0)
    axes.set(xlabel="to", ylabel="from")
    if minutes.size <= _MOST_NUMBERS:
        middle = float(np.nanmax(minutes, initial=0.0)) / 2
        for (row, column), each in np.ndenumerate(minutes):
            said = "none" if np.isnan(each) else f"{each:.0f}"
            ink = "white" if each > middle else INK
            axes.text(column, row, said, ha="center", va="center", fontsize=7, color=ink)
    axes.set_title(f"{matrix.scenario}, {matrix.departs}, by {matrix.planner}", loc="left", fontsize=10, color=INK)
    figure.supxlabel("\n".join(matrix.sources), fontsize=7, color=INK)
    return figure


class TradeOffPoint(TypedDict):
    """Means of the walks of one planner with one weight of exposure."""

    weight: float | None
    """Seconds for each person·s/m²; None where it makes no difference."""

    minutes: float

    exposure: float
    """Crowd met, person·s/m²."""

    metres: float
    arrival_rate: float


def trade_off_curve(title: str, caption: str, curves: Mapping[str, Sequence[TradeOffPoint]]) -> Figure:
    """Draw minutes against the crowd met.

    Points are labelled by their weights: those in one place together, and those without room for a label not at all.

    Parameters
    ----------
    title, caption
        Texts above and below the picture.
    curves
        By planner: one point for each weight of exposure.

    Returns
    -------
    Figure
        To be saved by :func:`save`.
    """
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    axes = figure.subplots()
    for number, (name, points) in enumerate(curves.items()):
        minutes, exposure = [point["minutes"] for point in points], [point["exposure"] for point in points]
        colour, _ = _look(name, number)
        axes.plot(minutes, exposure, color=colour, linewidth=2, marker="o", markersize=6, label=name, zorder=3)
    axes.margins(0.12)
    axes.set(xlabel="minutes", ylabel="crowd met, person·s/m²", ylim=(0, None))
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(title, loc="left", fontsize=10, color=INK)
    figure.legend(frameon=False, loc="outside upper right", ncols=4)  # inside, some curve would lie under it
    figure.supxlabel(caption, fontsize=8, color=INK)
    figure.draw_without_rendering()  # from here on it is known where things are on the page,
    figure.set_layout_engine("none")  # and they stay there
    _label_weights(axes, list(curves.values()))
    return figure


class _Label(NamedTuple):
    """What is to be written beside a point."""

    text: str
    colour: str
    place: Float[np.ndarray, "2"]
    """On the page, in pixels."""
    at_end: bool
    """Whether the point is the first or the last of its curve."""


def _label_weights(axes: Axes, curves: Sequence[Sequence[TradeOffPoint]]) -> None:
    """Write weights beside points, those at the ends of curves first, where text covers no text, point or curve."""
    figure, inward = axes.figure, axes.transData.inverted()
    places = [axes.transData.transform(line.get_xydata()) for line in axes.lines]
    pixels = figure.dpi / 72  # of a point
    dot = _MARKER * pixels
    labels = [
        label
        for line, points, place in zip(axes.lines, curves, places, strict=True)
        for label in _labels(str(line.get_color()), points, place, dot)
    ]
    dots = np.concatenate(places)
    taken = [Bbox.from_extents(*(middle - dot / 2), *(middle + dot / 2)) for middle in dots]
    for label in sorted(labels, key=lambda each: not each.at_end):
        style: dict[str, Any] = {"color": label.colour, "fontsize": 8, "ha": "center", "va": "center", **_HALO}
        text = axes.annotate(
            label.text, tuple(inward.transform(label.place)), xytext=(0, 0), textcoords="offset points", **style
        )
        text.set_in_layout(False)
        size = np.array(text.get_window_extent().size)
        for shift in _shifts(size, pixels):
            box = Bbox.from_bounds(*(label.place + shift - size / 2), *size).padded(pixels)
            if _is_free(box, axes.bbox, taken, places):
                text.set_position(tuple(shift / pixels))
                taken.append(box)
                break
        else:
            text.remove()


def _labels(
    colour: str, points: Sequence[TradeOffPoint], place: Float[np.ndarray, "point 2"], near: float
) -> Iterator[_Label]:
    """The labels of a curve: one for all points that follow one another within some pixels of the first of them."""
    begins = 0
    for after in range(1, len(points) + 1):
        if after < len(points) and np.hypot(*(place[after] - place[begins])) < near:
            continue
        ends = dict.fromkeys(f"{points[index]['weight']:g}" for index in (begins, after - 1))
        yield _Label(" to ".join(ends), colour, place[begins], at_end=begins == 0 or after == len(points))
        begins = after


def _shifts(size: Float[np.ndarray, "2"], pixels: float) -> Iterator[Float[np.ndarray, "2"]]:
    """Where the middle of a text may be, in pixels from its point: on all sides, the nearest and upper right first."""
    for away in (5.0, 8.0, 12.0, 16.0):
        for turn in sorted(
            np.linspace(0, 2 * np.pi, 24, endpoint=False), key=lambda turn: 1 - np.cos(turn - np.pi / 4)
        ):
            yield np.array([np.cos(turn), np.sin(turn)]) * (size / 2 + away * pixels)


def _is_free(box: Bbox, frame: BboxBase, taken: Sequence[Bbox], curves: Sequence[Float[np.ndarray, "_ 2"]]) -> bool:
    """Whether a box lies within a frame and covers nothing of what is taken, and nothing of curves."""
    inside = frame.contains(*box.min) and frame.contains(*box.max)
    covered = inside and (
        any(box.overlaps(other) for other in taken)
        or any(Path(curve).intersects_bbox(box, filled=False) for curve in curves)
    )
    return bool(inside and not covered)


def _look(planner: str, number: int) -> tuple[str, str]:
    """Colour and line style of a planner: its own, or one of matplotlib's colours."""
    return LOOKS.get(planner, (f"C{number}", "-"))


def _note(axes: Axes, text: str, place: Iterable[Any], shift: tuple[float, float], **style: Any) -> None:
    """Write beside a place, a few points away."""
    x, y = place
    axes.annotate(text, (x, y), xytext=shift, textcoords="offset points", **{"color": INK, **style})


def _add_coloured(axes: Axes, streets: LineCollection, label: str, ticks: Sequence[float], pad: float = 0.05) -> None:
    """Add streets that are coloured by the crowds on them, and a bar with some of these ticks."""
    axes.add_collection(streets)
    bar = axes.figure.colorbar(streets, ax=axes, shrink=0.7, label=label, pad=pad, panchor=False)
    fewest, most = streets.get_clim()
    shown = [tick for tick in ticks if fewest <= tick <= most]
    bar.set_ticks(shown, labels=[f"{tick:,g}" for tick in shown])
    bar.minorticks_off()


class _Near(NamedTuple):
    """The streets of a town that are seen in a part of its map."""

    streets: list[int]
    courses: list[Float[np.ndarray, "_ 2"]]


_Frame = tuple[float, float, float, float]
"""West, east, south and north of a map, in metres."""


def _near(town: Town, frame: _Frame) -> _Near:
    west, east, south, north = frame
    courses = np.split(town.project(town.points), town.first[1:-1])
    near = [
        street
        for street, course in enumerate(courses)
        if (course.max(axis=0) >= (west, south)).all() and (course.min(axis=0) <= (east, north)).all()
    ]
    return _Near(near, [courses[street] for street in near])


def _map_of(frame: _Frame) -> tuple[Figure, Axes]:
    """An empty map with a scale."""
    west, east, south, north = frame
    figure = Figure(figsize=(8, 7.5), layout="constrained")
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.set(xlim=(west, east), ylim=(south, north))
    axes.axis("off")
    _scale_bar(axes, west, south, east - west)
    return figure, axes


def _add_crowds(axes: Axes, streets: StreetMap, frame: _Frame, label: str) -> None:
    """Add the streets of a map, coloured by the crowds on them."""
    town, near = streets.town, _near(streets.town, frame)
    density = np.maximum(streets.density[near.streets], _SPARSE)
    # The ways across a square are as wide as the square: drawn so, they would hide it.
    wide = np.array([town.kind[street] not in ACROSS for street in near.streets])
    widths = np.clip(wide * town.width[near.streets] / 2, 1.2, 4.0)
    lines = LineCollection(near.courses, array=density, cmap=_CROWDS, linewidths=widths, capstyle="round")
    lines.set_norm(LogNorm(float(np.quantile(density, 0.02)), 1.01 * float(density.max())))
    _add_coloured(axes, lines, label, (0.02, 0.05, 0.1, 0.2, 0.5, 1, 1.5, 2, 3, 5, 10), pad=0.01)


def _draw_course(
    axes: Axes, course: Float[np.ndarray, "point 2"], colour: str, width: float, label: str | None, zorder: float = 3
) -> None:
    style: dict[str, Any] = {"zorder": zorder, "solid_joinstyle": "round", "solid_capstyle": "round"}
    axes.plot(*course.T, color="white", linewidth=width + 3.1, **style)
    axes.plot(*course.T, color=colour, linewidth=width, label=label, **style)


def _outline(town: Town, polygons: Sequence[Sequence[Any]]) -> Path:
    """The rings of polygons, given in degrees."""
    return Path.make_compound_path(
        *(Path(town.project(np.array(ring)), closed=True) for rings in polygons for ring in rings)
    )


def _draw_avoided(axes: Axes, town: Town, facts: SceneFacts) -> None:
    """Hatch the area whose streets are not walked, if there is one."""
    if facts.avoided_area:
        look = {"facecolor": "none", "edgecolor": INK, "hatch": "///", "linewidth": 1.6, "zorder": 2.8}
        axes.add_patch(PathPatch(_outline(town, facts.avoided_area), label="area to avoid", **look))


def _mark(axes: Axes, place: Float[np.ndarray, "2"], text: str, face: str) -> None:
    axes.plot(*place, "o", color=face, markeredgecolor=INK, markeredgewidth=2.2, markersize=11, zorder=4)
    _note(axes, text, place, (10, 8), zorder=5, **_HALO)


def _legend_below(axes: Axes, columns: int) -> None:
    """Explain the lines and areas of a map below it, the last drawn first."""
    handles, labels = axes.get_legend_handles_labels()
    style: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "frameon": False, "fontsize": 8}
    axes.legend(handles[::-1], labels[::-1], ncols=columns, **style)


def _titled(figure: Figure, title: str, facts: SceneFacts) -> Figure:
    """Write above and below a map."""
    figure.suptitle(title, color=INK)
    # Below the axes, where nothing lies under it.
    figure.supxlabel("\n".join(facts.sources), fontsize=8, color=INK)
    return figure


def _whole(town: Town) -> _Frame:
    """A frame around all streets."""
    streets = town.project(town.points)
    (west, south), (east, north) = streets.min(axis=0) - _ROOM, streets.max(axis=0) + _ROOM
    return float(west), float(east), float(south), float(north)


def _frame(walk: Float[np.ndarray, "step 2"], streets: Float[np.ndarray, "point 2"], room: float = 1.3) -> _Frame:
    """Room on all sides of a walk, as far as there are streets."""
    low, high = walk.min(axis=0), walk.max(axis=0)
    half = max(room / 2 * float((high - low).max()), 300.0)
    middle = (low + high) / 2
    west, south = np.maximum(middle - half, streets.min(axis=0) - _ROOM)
    east, north = np.minimum(middle + half, streets.max(axis=0) + _ROOM)
    return float(west), float(east), float(south), float(north)


def _scale_bar(axes: Axes, west: float, south: float, width: float) -> None:
    metres = max(step for step in (50, 100, 200, 500, 1000, 2000, 5000) if step <= max(width / 4, 50))
    x, y = west + 0.03 * width, south + 0.03 * width
    axes.plot([x, x + metres], [y, y], color=INK, linewidth=3, solid_capstyle="butt", zorder=5)
    _note(axes, f"{metres:,} m", (x + metres / 2, y), (0, 6), ha="center", **_HALO)


def _beside(legs: Float[np.ndarray, "leg 2 2"], shift: float) -> Float[np.ndarray, "leg 2 2"]:
    """Move legs sideways, to the right of their direction, so that those over the same street stay apart."""
    along = legs[:, 1] - legs[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    right = np.stack([along[:, 1], -along[:, 0]], axis=1)
    return legs + shift * right[:, None]


def _label_lengths(axes: Axes, network: RoadNetwork, ends: Float[np.ndarray, "segment 2 2"]) -> None:
    """Write lengths beside the streets: on this map they are not to scale."""
    tail, head, length = (np.asarray(part) for part in (network.tail, network.head, network.length))
    for segment in np.flatnonzero(tail < head):
        (x0, y0), (x1, y1) = ends[segment]
        shift, rotation = ((-9, 0), 90) if abs(y1 - y0) > abs(x1 - x0) else ((0, 9), 0)
        style = {"rotation": rotation, "ha": "center", "va": "center", "fontsize": 6.5, "alpha": 0.6}
        _note(axes, f"{length[segment]:.0f} m", ((x0 + x1) / 2, (y0 + y1) / 2), shift, **style)
