"""Planning many routes through one place from one process."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from datetime import datetime
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from sidestep.arguments import INDEX, PATH, SEED, checked, instance
from sidestep.crowds.base import FlowModel
from sidestep.crowds.live import LiveCounts
from sidestep.crowds.profile import time_of_week
from sidestep.planners.base import Planner
from sidestep.planners.registry import BASELINE, find_planner
from sidestep.planners.shortest_path import ShortestPath
from sidestep.planners.time_dependent import Expected
from sidestep.routing import walks
from sidestep.routing.clocks import TownClock
from sidestep.routing.crowds import StreetCrowds, street_crowds
from sidestep.routing.departures import MOST_DEPARTURES, DepartureWindow, departure_window, latest_departure
from sidestep.routing.isochrone import Isochrone, isochrone
from sidestep.routing.locate import Circumstances, TownLocator, connected, locator
from sidestep.routing.located import Located
from sidestep.routing.matrix import TimeMatrix, time_matrix
from sidestep.routing.places import AskedPlace, Places, read_places
from sidestep.routing.plan import RoutePlan
from sidestep.routing.quick import QuickRouter
from sidestep.routing.request import (
    NO_COORDINATES,
    Area,
    Counts,
    Departure,
    Place,
    RouteError,
    RouteRequest,
    at_fault,
    check_count,
    check_files,
    check_list,
    check_minutes,
    check_planner,
    check_request,
    read_departure,
    read_place,
)
from sidestep.routing.street_times import Tables
from sidestep.scenarios.maps import draw_map, sensor_names, with_latest_counts
from sidestep.scenarios.model import ObjectiveSpec, Scenario
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.walkers import Walker

if TYPE_CHECKING:
    from sidestep.planners.learned import Learned

WINDOW = 2 * 3600.0
"""Seconds of departures that :meth:`Router.when` compares by default."""


class Router:
    """A place, loaded once, through which many routes are planned.

    Streets, crowds and a model are read when the router is made. The first route compiles programs, and the next ones
    reuse them, whatever their ends and departures. Programs are compiled anew for another planner, for another number
    of futures, and for the first request with live counts. They are kept on disk for later processes. Several threads
    may share a router.

    Parameters
    ----------
    scenario
        A scenario, the name of a built-in one, or a scenario file.
    model
        Folder of a trained model, which is the planner ``darp``. Without one, routes are searched for.
    seed
        Seed of the map and its futures.
    index
        Number of the map.

    Raises
    ------
    SidestepError
        A scenario or a model that is not there, or that do not fit each other.

    Examples
    --------
    >>> import sidestep
    >>> router = sidestep.Router(sidestep.scenario("paper-congested", side=3, crowded_nodes=1))
    >>> plan = router.plan(0, 8, futures=10)
    >>> plan.nodes[0], plan.nodes[-1]
    (0, 8)
    """

    @checked(
        RouteError,
        scenario=instance((Scenario, str, PathLike), "a scenario, the name of one, or a scenario file"),
        model=PATH,
        seed=SEED,
        index=INDEX,
    )
    def __init__(
        self, scenario: Scenario | str | Path, *, model: Path | str | None = None, seed: int = 0, index: int = 0
    ) -> None:
        self.scenario = scenario if isinstance(scenario, Scenario) else find_scenario(scenario)
        self._seed, self._index = seed, index
        self._map = draw_map(self.scenario, seed, index)
        self._locate = locator(self.scenario, self._map)
        self._learned: Learned | None = None
        self.live: LiveCounts | None = None
        """The counts that crowds of departures soon go on from; None where none are known."""
        if model is None:
            return
        from sidestep.planners import learned  # what agents learn with takes long to import

        with at_fault("model"):
            self._learned = learned.load_planners([Path(model)], self.scenario, seed)
        if self._learned.index not in (None, index):
            raise RouteError(f"the model remembers map {self._learned.index}, not {index}", field="model")

    def changed(self, *, walker: Walker | None = None, objective: ObjectiveSpec | None = None) -> "Router":
        """Another router through the same place, with the same model.

        An objective changes neither streets nor crowds: with another one, all that was loaded and worked out is shared.
        Then let this router go on from counts, not the other.

        Parameters
        ----------
        walker, objective
            Those of the other router; by default they stay.

        Returns
        -------
        Router
            For another walker a new one, whose crowds go on from no counts yet; otherwise it goes on from those that
            this one goes on from now.

        Raises
        ------
        SidestepError
            A walker that can take no street (field ``walker``). A model that learned for another walker or objective
            is refused only once it is asked to plan.
        """
        if walker is None or walker == self.scenario.walker:
            other = copy(self)
        else:
            other = Router(self.scenario.changed(walker=walker), seed=self._seed, index=self._index)
            other._learned = self._learned
        if objective is not None:
            other.scenario = other.scenario.changed(objective=objective)
            other._locate = other._locate.changed(other.scenario)
        return other

    def plan(
        self,
        origin: Place | str | None = None,
        destination: Place | str | None = None,
        *,
        depart: Departure | str | None = None,
        planner: Planner | str | None = None,
        by: float | None = None,
        futures: int | None = None,
        live: Counts | None = None,
        avoid: Area | None = None,
        alternatives: int = 0,
        arrive_by: Departure | str | None = None,
        confidence: float | None = None,
    ) -> RoutePlan:
        """Plan a route. The parameters are the fields of :class:`RouteRequest`, or text as people write it.

        Returns
        -------
        RoutePlan
            As :meth:`answer`.

        Raises
        ------
        SidestepError
            As :meth:`answer`.
        """
        ends = read_place("origin", origin), read_place("destination", destination)
        deadline = read_departure(arrive_by, "arrive_by")
        return self.answer(
            RouteRequest(
                *ends, read_departure(depart), planner, by, futures, live, avoid, alternatives, deadline, confidence
            )
        )

    def answer(self, request: RouteRequest) -> RoutePlan:
        """Plan the route that a request asks for.

        Parameters
        ----------
        request
            What is asked for.

        Returns
        -------
        RoutePlan
            The route, and its times in simulated futures.

        Raises
        ------
        SidestepError
            A request that streets, crowds or the planner do not allow; ``error.field`` names the field at fault.
        """
        check_request(request)
        if request.arrive_by is None:
            given = Circumstances(
                depart=request.depart, live=request.live, avoid=request.avoid, exclude=request.exclude
            )
            located = self._between(request.origin, request.destination, given)
            return walks.planned(
                walks.Walker(located, self.choose_planner(request.planner, located), request.futures), request
            )
        given = Circumstances(
            depart=request.arrive_by,
            after=request.depart,
            avoid=request.avoid,
            exclude=request.exclude,
            field="arrive_by",
            lookback=True,
        )
        located = self._between(request.origin, request.destination, given)
        earliest = 0.0 if request.depart is None else located.start.earliest(request.depart, located.clock)
        return latest_departure(located, self.choose_planner(request.planner, located), request, earliest)

    def when(
        self,
        origin: Place | str | None = None,
        destination: Place | str | None = None,
        *,
        depart: Departure | str | None = None,
        until: Departure | str | None = None,
        step: float | None = None,
        planner: Planner | str | None = None,
        futures: int | None = None,
        live: Counts | None = None,
        avoid: Area | None = None,
        arrive_by: Departure | str | None = None,
        most: int = MOST_DEPARTURES,
    ) -> DepartureWindow:
        """Find out when it is best to set out.

        Parameters
        ----------
        origin, destination, planner, futures, live, avoid
            As for :meth:`plan`.
        depart, until
            First and last departure of the window; by default it begins at the first usual hour, or on grids at the
            start, and lasts two hours.
        step
            Minutes between two departures; by default one slot of the scenario, usually 5.
        arrive_by
            When to be there: each departure then says how likely it arrives by then.
        most
            The most departures of the window.

        Returns
        -------
        DepartureWindow
            How long the walk takes at every departure, and the best of them.

        Raises
        ------
        SidestepError
            As :meth:`answer`; a window that ends before it begins (field ``until``), or more departures in it
            than ``most`` (``step``).
        """
        check_count("futures", futures)
        if step is not None:
            check_minutes("step", step)
        check_files(live=live, avoid=avoid)
        given = Circumstances(
            depart=read_departure(depart),
            live=live,
            avoid=avoid,
            until=read_departure(until, "until"),
            window=WINDOW,
        )
        located = self._between(read_place("origin", origin), read_place("destination", destination), given)
        deadline = read_departure(arrive_by, "arrive_by")
        due = None if deadline is None else located.start.due(deadline, "arrive_by")
        return departure_window(located, self.choose_planner(planner, located), step, futures, due, most)

    def isochrone(
        self,
        origin: Place | str | None = None,
        *,
        minutes: Sequence[float] = (5, 10, 15),
        depart: Departure | str | None = None,
        planner: Planner | str | None = None,
        futures: int | None = None,
        live: Counts | None = None,
        avoid: Area | None = None,
    ) -> Isochrone:
        """Find out how far one gets in some minutes.

        Parameters
        ----------
        origin, depart, live, avoid
            As for :meth:`plan`.
        minutes
            Minutes of walking.
        planner
            ``expected``, which takes the best paths by expected times, or ``shortest-path``.
        futures
            Number of futures to simulate; by default none, and then crowds are as expected.

        Returns
        -------
        Isochrone
            What is reached if crowds are as expected or, with futures, in half and in 90 % of them.

        Raises
        ------
        SidestepError
            As :meth:`answer`; minutes that are none, or more than the horizon (field ``minutes``).
        """
        check_count("futures", futures)
        check_files(live=live, avoid=avoid)
        check_list("minutes", minutes)
        given = Circumstances(depart=read_departure(depart), live=self._lately(live), avoid=avoid)
        located = self._locate.locate([AskedPlace("origin", read_place("origin", origin))], given)
        return isochrone(located, self._search(planner), minutes, futures)

    def matrix(
        self,
        origins: Places,
        destinations: Places | None = None,
        *,
        depart: Departure | str | None = None,
        planner: Planner | str | None = None,
        futures: int | None = None,
        live: Counts | None = None,
        avoid: Area | None = None,
    ) -> TimeMatrix:
        """Find out how long the walks from many places to many others take.

        Parameters
        ----------
        origins, destinations
            Places as for :meth:`plan`, or files of places; by default the destinations are the origins.
        depart, planner, futures, live, avoid
            As for :meth:`isochrone`.

        Returns
        -------
        TimeMatrix
            Minutes if crowds are as expected and, with futures, within which half and 90 % of the walks arrive.

        Raises
        ------
        SidestepError
            As :meth:`answer`; files that cannot be read, and more than ``MOST_PLACES`` places (field ``origins`` or
            ``destinations``).
        """
        check_count("futures", futures)
        check_files(live=live, avoid=avoid)
        froms = read_places("origins", origins)
        asked = froms if destinations is None else [*froms, *read_places("destinations", destinations)]
        given = Circumstances(depart=read_departure(depart), live=self._lately(live), avoid=avoid)
        located = self._locate.locate(asked, given)
        return time_matrix(located, self._search(planner), len(froms), square=destinations is None, futures=futures)

    def crowds(self, at: Departure | str | None = None, *, live: Counts | None = None) -> StreetCrowds:
        """Find out how crowded the streets are expected to be.

        Parameters
        ----------
        at
            When, as a departure of :meth:`plan`.
        live
            Current counts, from which crowds go on; only where crowds are known from sensors.

        Returns
        -------
        StreetCrowds
            The density on every street.

        Raises
        ------
        SidestepError
            Times and counts that the crowds do not know (field ``at`` or ``live``).
        """
        check_files(live=live)
        return street_crowds(
            self._locate.locate([], Circumstances(depart=read_departure(at, "at"), live=self._lately(live), field="at"))
        )

    def clock(self, departure: Departure | None) -> TownClock:
        """Let clock 0 be a departure in a town.

        Parameters
        ----------
        departure
            By default the first usual hour.

        Returns
        -------
        TownClock
            The clock.

        Raises
        ------
        RouteError
            A departure of which crowds know nothing (field ``depart``).
        """
        return self._in_town.clock(departure, "depart")

    @property
    def flow(self) -> FlowModel:
        """The crowds."""
        return self._map.flow

    def expected_counts(self, now: datetime) -> Float[np.ndarray, " sensor"]:
        """Persons/h that each sensor is expected to count at a local time, in the order of their names."""
        counted = self._map.flow.expected_counts(time_of_week(now))
        return counted[[self._map.sensors.index(name) for name in sensor_names(self._map)]]

    def go_on_from(self, live: LiveCounts, now: datetime) -> int:
        """From now on, let crowds of departures soon go on from what sensors counted lately.

        Meanwhile other threads are answered from what was known before.

        Parameters
        ----------
        live
            The counts.
        now
            Local wall time.

        Returns
        -------
        int
            Number of sensors that are known; with 0 crowds are as expected.

        Raises
        ------
        SidestepError
            Crowds that are not known from sensors (field ``live``), or not known now.
        """
        latest = live.latest(sensor_names(self._map), now)
        if latest is None:
            self.live = None
            self.quick.tables.forget_counts()
            return 0
        with at_fault("live"):
            flow = with_latest_counts(self._map, latest).flow
        begins = now.replace(second=0, microsecond=0)  # departures are often given to the minute
        self.quick.tables.go_on_from(flow, self.clock(begins), live.lasts(sensor_names(self._map), begins))
        self.live = live
        return latest.known

    def _lately(self, given: Counts | None) -> Counts | None:
        """The counts that are given, or those that the router goes on from."""
        return self.live if given is None else given

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensor behind each counter of the flow, where crowds are known from sensors."""
        return self._map.sensors

    @cached_property
    def quick(self) -> QuickRouter:
        """Searches hundreds of routes a second by expected times, without simulated futures; only in towns.

        Raises
        ------
        RouteError
            On grids, which have no coordinates (field ``format``).
        """
        town = self._in_town
        return QuickRouter(self._map.network, town.snapper, Tables(self.scenario, self._map, town.paces))

    @property
    def _in_town(self) -> TownLocator:
        """Locates requests in a town; RouteError (field ``format``) on grids, which have no coordinates."""
        if isinstance(self._locate, TownLocator):
            return self._locate
        raise RouteError(NO_COORDINATES, field="format")

    def locate_walk(self, origin: AskedPlace, destination: AskedPlace, given: Circumstances) -> Located:
        """Locate a walk from one place to another, which a path must connect.

        Parameters
        ----------
        origin, destination, given
            The places, and what else was asked.

        Returns
        -------
        Located
            With both places as its ends.

        Raises
        ------
        SidestepError
            As :meth:`answer`; errors of places name the field of the place.
        """
        given = replace(given, live=self._lately(given.live))
        return connected(self._locate.locate([origin, destination], given))

    def _between(self, origin: Place | None, destination: Place | None, given: Circumstances) -> Located:
        return self.locate_walk(AskedPlace("origin", origin), AskedPlace("destination", destination), given)

    def _search(self, planner: Planner | str | None) -> Planner:
        """Find who searches the paths to everywhere.

        Parameters
        ----------
        planner
            What was asked for; by default ``expected``, also where a model was loaded.

        Returns
        -------
        Planner
            The planner.

        Raises
        ------
        RouteError
            Planners that do not search beforehand (field ``planner``).
        """
        check_planner(planner)
        with at_fault("planner"):
            found = find_planner(planner or BASELINE) if planner is None or isinstance(planner, str) else planner
        if not isinstance(found, (Expected, ShortestPath)):
            said = f"{found.name} decides on the way, to one place at a time, or knows the future"
            raise RouteError(f"{said}; paths to everywhere are searched by expected or shortest-path", field="planner")
        return found

    def choose_planner(self, asked: Planner | str | None, located: Located) -> Planner:
        """Find who plans, and refuse ends that a model does not know which remembers nodes.

        Parameters
        ----------
        asked
            What was asked for.
        located
            The request, with origin and destination as its ends.

        Returns
        -------
        Planner
            That of the request, or the default.

        Raises
        ------
        RouteError
            Planners that are not known (field ``planner``), and an end in the middle of a street (``origin`` or
            ``destination``).
        ModelError
            A model that learned for another walker or objective (field ``walker`` or ``objective``), or for other
            destinations (``destination``).
        """
        check_planner(asked)
        model = self._learned
        planner = (BASELINE if model is None else next(iter(model.planners))) if asked is None else asked
        if not isinstance(planner, str):
            return planner
        if model is None or planner not in model.planners:
            with at_fault("planner"):
                return find_planner(planner)
        model.check_problem(self.scenario)
        for field, end in zip(("origin", "destination"), located.ends, strict=True):
            if model.index is not None and end.node >= self._map.network.nodes:
                raise RouteError(f"the model remembers nodes; give the {field} as one", field=field)
        with at_fault("destination"):
            model.check_destination(located.ends[1].node)
        return model.planners[planner]


def plan_route(
    scenario: Scenario | str | Path,
    request: RouteRequest,
    *,
    model: Path | str | None = None,
    seed: int = 0,
    index: int = 0,
) -> RoutePlan:
    """Plan one route; for several through one place make a :class:`Router`, whose parameters the others are.

    Parameters
    ----------
    scenario, model, seed, index
        As for :class:`Router`.
    request
        What is asked for.

    Returns
    -------
    RoutePlan
        The route, and its times in simulated futures.

    Raises
    ------
    RouteError
        Anything but a request (field ``request``).
    SidestepError
        As :class:`Router` and :meth:`Router.answer`.

    Examples
    --------
    >>> import sidestep
    >>> grid = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> plan = sidestep.plan_route(grid, sidestep.RouteRequest(destination=8, planner="shortest-path", futures=10))
    >>> plan.planner, plan.arrives
    ('shortest-path', True)
    """
    check_request(request)  # before all that is loaded
    return Router(scenario, model=model, seed=seed, index=index).answer(request)
