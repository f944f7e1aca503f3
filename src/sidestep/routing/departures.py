"""When to set out: the latest departure that arrives in time, and the best departure in a window."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import takewhile
from typing import Any

import numpy as np
from jaxtyping import Bool

from sidestep.evaluation.metrics import in_time
from sidestep.planners.base import Planner
from sidestep.routing.facts import End, SceneFacts
from sidestep.routing.formats import table
from sidestep.routing.located import Located
from sidestep.routing.plan import RoutePlan, WalkTimes
from sidestep.routing.request import CONFIDENCE, RouteError, RouteRequest
from sidestep.routing.trees import MINUTE
from sidestep.routing.walks import Walker, Walks, planned

MOST_DEPARTURES = 300
"""The most departures of a window that are walked."""


def latest_departure(located: Located, planner: Planner, request: RouteRequest, earliest: float) -> RoutePlan:
    """Plan the route that departs as late as it may.

    Departures are whole minutes before the deadline. Nobody who sets out later on the same path arrives earlier, so the
    search goes back slot by slot until enough futures arrive, and then looks at every minute of the slot: the planner
    may choose another path, so halving it could miss some.

    Parameters
    ----------
    located
        The request on the streets; its clock is the deadline.
    planner, request
        Who plans, and what was asked for.
    earliest
        The earliest departure, seconds since the scenario's start.

    Returns
    -------
    RoutePlan
        The share of the futures in which it arrives by the deadline is ``arrive_by``.

    Raises
    ------
    RouteError
        A deadline that cannot be met, with the earliest arrival that can (field ``arrive_by``).
    """
    deadline, walker = located.clock, Walker(replace(located, baselines=()), planner, request.futures)
    confidence = CONFIDENCE if request.confidence is None else request.confidence
    step, most = math.ceil(located.scenario.slot_seconds / MINUTE), int((deadline - earliest) // MINUTE)

    def walks(minutes: float) -> Walks:
        departing = walker.departing(deadline - MINUTE * minutes)
        return departing.walk(planner, departing.params.futures.count)

    def sure(minutes: float) -> bool:
        return bool(_in_time(located, walks(minutes), minutes).mean() >= confidence)

    before = 0
    while not sure(after := min(before + step, most)):
        if after == most:
            late = walks((deadline - earliest) / MINUTE)
            raise RouteError(_too_late(located, confidence, late, earliest), field="arrive_by")
        before = after
    after = next((minutes for minutes in range(before + 1, after) if sure(minutes)), after)
    plan = planned(
        Walker(located.departing(deadline - MINUTE * after), planner, request.futures),
        request,
        within=float(after),
    )
    return replace(plan, deadline=located.facts.departs, confidence=confidence)


def _in_time(located: Located, walks: Walks, by: float = math.inf) -> Bool[np.ndarray, " future"]:
    """Which walks arrive within some minutes, and before the horizon."""
    return in_time(walks.minutes, walks.arrived, by, located.scenario.horizon / MINUTE)


def _on_time(located: Located, walks: Walks, due: float) -> float:
    """The share of walks that arrive by a clock in s."""
    return float(_in_time(located, walks, (due - located.clock) / MINUTE).mean())


def _too_late(located: Located, confidence: float, walks: Walks, earliest: float) -> str:
    """Say when a walk that sets out as early as it may arrives."""
    minutes = np.where(_in_time(located, walks), walks.minutes, math.inf)
    surely = float(np.quantile(minutes, confidence, method="higher"))
    sets_out = located.departing(earliest).facts.departs
    said = f"no departure from {sets_out} on arrives by {located.facts.departs} with probability {confidence:g}"
    if not math.isfinite(surely):
        horizon = located.scenario.horizon / MINUTE
        share = f"{100 * np.isfinite(minutes).mean():.0f} % of the walks at that departure"
        return f"{said}; {share} arrive within the horizon of {horizon:g} min"
    arrives = located.departing(MINUTE * math.ceil(earliest / MINUTE + surely)).facts.departs
    return f"{said}; the earliest arrival is {arrives}"


@dataclass(frozen=True, kw_only=True)
class DepartureTimes(WalkTimes):
    """The walks of one departure."""

    departs: str
    """For people."""

    departure: str | None
    """Local time, ISO 8601; None where no day was given."""

    departure_minutes: float
    """Minutes after the first departure of the window."""

    expected_minutes: float
    """Expected travel time, as :attr:`sidestep.routing.plan.RoutePlan.expected_minutes`."""

    arrives: bool
    """Whether that walk arrives."""

    on_time: float | None
    """Share of the futures in which the walk arrives by the deadline; None where there is none."""


@dataclass(frozen=True, kw_only=True)
class DepartureWindow(SceneFacts):
    """How long the walk from one place to another takes at every departure of a window.

    Examples
    --------
    >>> import sidestep
    >>> router = sidestep.Router(sidestep.scenario("rush-16", side=3, crowded_nodes=1))
    >>> window = router.when(0, 8, depart=0, until=30, step=15, futures=10)
    >>> [departure.departs for departure in window.departures]
    ['0 min after the start', '15 min after the start', '30 min after the start']
    """

    origin: End
    destination: End

    planner: str
    """Name of the planner."""

    departures: Sequence[DepartureTimes]
    """The earliest first."""

    @property
    def best(self) -> DepartureTimes:
        """The departure whose walk takes the fewest minutes in 90 % of the futures; of equal ones the earliest.

        Where there is a deadline, only departures count that make it in 90 % of them, or as often as any does.
        """
        share = min(max(departure.on_time or 0.0 for departure in self.departures), CONFIDENCE)
        fine = [departure for departure in self.departures if (departure.on_time or 0.0) >= share]
        return min(fine, key=lambda departure: departure.p90_minutes)

    @property
    def span(self) -> str:
        """The first and the last departure for people, such as "Friday 17:00 to 20:00"."""
        first, last = (self.departures[end].departs.split() for end in (0, -1))
        if first == last:
            return " ".join(first)
        before = _alike(first, last)
        after = _alike(first[before:][::-1], last[before:][::-1])
        return " ".join([*first[: len(first) - after], "to", *last[before:]])

    def to_json(self) -> dict[str, Any]:
        """Everything, ready for ``json.dumps``."""
        return {**asdict(self), "best": asdict(self.best)}

    def to_text(self) -> str:
        """A table for people."""
        rows = [
            (
                each.departs,
                f"{each.expected_minutes:.1f}",
                f"{each.median_minutes:.1f}",
                f"{each.p90_minutes:.1f}",
                f"{100 * each.arrival_rate:.0f} %",
                "best" if each is self.best else "",
            )
            for each in self.departures
        ]
        heading = ("departure", ">expected min", ">median", ">90 % within", ">arrive", "")
        futures = self.departures[0].futures
        lines = [
            f"{self.planner}, {self.origin.asked} to {self.destination.asked}, {futures} simulated futures:",
            "",
            *table(heading, rows),
            "",
            f"Best: {self.best.departs}, {self.best.in_words()}",
            "",
            *self.notes(),
        ]
        return "\n".join(lines) + "\n"


def _alike(one: Sequence[str], other: Sequence[str]) -> int:
    """How many words two texts have in common at their beginning."""
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))


def departure_window(
    located: Located,
    planner: Planner,
    step: float | None,
    futures: int | None,
    due: float | None = None,
    most: int = MOST_DEPARTURES,
) -> DepartureWindow:
    """Walk at every departure of a window.

    Parameters
    ----------
    located
        The request on the streets; its clock is the first departure, ``latest`` the last one.
    planner
        Who plans.
    step
        Minutes between departures; by default a slot.
    futures
        How many to simulate.
    due
        Clock in s by which to arrive, if there is a deadline.
    most
        The most departures.

    Returns
    -------
    DepartureWindow
        One row for each departure.

    Raises
    ------
    RouteError
        A window that ends before it begins, or so late that crowds are not known (field ``until``, or ``depart`` where
        the first departure is too late); too many departures (``step``).
    """
    seconds = located.scenario.slot_seconds if step is None else MINUTE * step
    if located.latest < located.clock:
        raise RouteError("the latest departure of the window is before the first; swap them", field="until")
    number = int((located.latest - located.clock) // seconds) + 1
    if number > most:
        hours = (located.latest - located.clock) / (60 * MINUTE)
        said = f"the window lasts {hours:g} hours and has {number:,} departures, of {most} at most"
        raise RouteError(f"{said}; end it earlier, or take longer steps", field="step")
    walker, rows = Walker(replace(located, baselines=()), planner, futures), []
    for turn in range(number):
        departing = walker.departing(located.clock + turn * seconds)
        route = departing.expected_route(planner)
        departing.located.check_covered(route.seconds, "until" if turn else "depart")
        walks = departing.walk(planner, departing.params.futures.count)
        facts = departing.located.facts
        rows.append(
            DepartureTimes(
                **vars(walks.times),
                departs=facts.departs,
                departure=facts.departure,
                departure_minutes=turn * seconds / MINUTE,
                expected_minutes=route.seconds / MINUTE,
                arrives=route.arrived,
                on_time=None if due is None else _on_time(departing.located, walks, due),
            )
        )
    origin, destination = located.named_ends
    return DepartureWindow(
        **vars(located.facts), origin=origin, destination=destination, planner=planner.name, departures=tuple(rows)
    )
