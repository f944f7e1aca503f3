"""Planning many routes through one place from one process."""

from datetime import datetime
from pathlib import Path

from sidestep.planners.base import Planner
from sidestep.planners.learned import Darp, load_planners
from sidestep.planners.registry import BASELINE, find_planner
from sidestep.routing.locate import LocatedRequest, locator
from sidestep.routing.plan import RoutePlan
from sidestep.routing.request import Counts, Place, RouteError, RouteRequest, at_fault, read_departure, read_place
from sidestep.routing.walks import plan_located
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.reader import find_scenario


class Router:
    """A place, loaded once, through which many routes are planned.

    Streets, crowds and a model are read when the router is made. The first route compiles programs, and the next ones
    reuse them, whatever their ends and departures. Programs are compiled anew for another planner, for another number
    of futures, for the first request with live counts, and, for planners that see all counts, for walks more than
    twice as long as those before. Several threads may share a router.

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

    def __init__(
        self, scenario: Scenario | str | Path, *, model: Path | str | None = None, seed: int = 0, index: int = 0
    ) -> None:
        self.scenario = scenario if isinstance(scenario, Scenario) else find_scenario(scenario)
        self._map = draw_map(self.scenario, seed, index)
        self._locate = locator(self.scenario, self._map)
        with at_fault("model"):
            self._learned = load_planners([] if model is None else [Path(model)], self.scenario, seed)
        if self._learned.index not in (None, index):
            raise RouteError(f"the model remembers map {self._learned.index}, not {index}", field="model")
        self._default = BASELINE if model is None else Darp.name

    def plan(
        self,
        origin: Place | str | None = None,
        destination: Place | str | None = None,
        *,
        depart: datetime | float | str | None = None,
        planner: Planner | str | None = None,
        by: float | None = None,
        futures: int | None = None,
        live: Counts | None = None,
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
        return self.answer(RouteRequest(*ends, read_departure(depart), planner, by, futures, live))

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
        located = self._locate(request)
        return plan_located(located, self._planner(located))

    def _planner(self, located: LocatedRequest) -> Planner:
        """Find who plans, and refuse ends that a model does not know which remembers nodes.

        Parameters
        ----------
        located
            The request.

        Returns
        -------
        Planner
            That of the request, or the default.

        Raises
        ------
        RouteError
            An end in the middle of a street (field ``origin`` or ``destination``).
        """
        planner, facts = located.request.planner or self._default, located.facts
        if not isinstance(planner, str):
            return planner
        if planner not in self._learned.planners:
            with at_fault("planner"):
                return find_planner(planner)
        for field, end in (("origin", facts.origin), ("destination", facts.destination)):
            if self._learned.index is not None and end.node >= self._map.network.nodes:
                raise RouteError(f"the model remembers nodes; give the {field} as one", field=field)
        with at_fault("destination"):
            self._learned.check_destination(facts.destination.node)
        return self._learned.planners[planner]


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
    return Router(scenario, model=model, seed=seed, index=index).answer(request)
