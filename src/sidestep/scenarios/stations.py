"""Where things of a venue are on its streets: sensors, lights, origins and destinations."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from sidestep.network.graph import RoadNetwork
from sidestep.network.snapping import Snapper, StreetPoint
from sidestep.network.town import Town, TownError
from sidestep.scenarios.places import Sensor
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.values import Waypoint

APART = 150.0  # m between sensors that are paired with streets, as far as there is room
STEPS = "steps"


def stations(town: Town, network: RoadNetwork, sensors: tuple[Sensor, ...], pairing: int) -> Int[np.ndarray, " sensor"]:
    """The segment that each sensor stands on: the street nearest to its place, or, without one, a street drawn for it.

    Streets are drawn in proportion to their length, at least ``APART`` from one another as long as there are such.

    Parameters
    ----------
    town, network
        The streets.
    sensors
        Each as often as it stands on a street.
    pairing
        Seed of the streets that are drawn.

    Raises
    ------
    ScenarioError
        More sensors, counted once for each of their streets, than streets; places outside the town.
    """
    if len(sensors) > town.streets:
        names = len({sensor.name for sensor in sensors})
        each = f" on {len(sensors)} streets" if names < len(sensors) else ""
        raise ScenarioError(f"there are {names} sensors{each}, but {town.streets} streets in the town")
    snapper = Snapper(town)
    found = [nearest_street(snapper, sensor) for sensor in sensors]
    taken = [street for street in found if street is not None]
    rng = np.random.default_rng([pairing, len(sensors)])
    drawn = _streets_apart(town, network, taken, len(found) - len(taken), rng)
    return np.array([next(drawn) if street is None else street for street in found], np.int64)


def _streets_apart(
    town: Town, network: RoadNetwork, taken: list[int], number: int, rng: np.random.Generator
) -> Iterator[int]:
    """Draw streets away from those that are taken, and from one another."""
    middle = (np.asarray(network.position)[town.tail] + np.asarray(network.position)[town.head]) / 2
    weight = np.where(np.array(town.kind) == STEPS, 0.0, town.length) + 1e-9
    drawn = rng.choice(town.streets, town.streets, replace=False, p=weight / weight.sum()).tolist()
    free: list[int] = []
    apart = APART
    while len(free) < number:
        for street in drawn:
            away = middle[[*taken, *free]] - middle[street]
            if (np.linalg.norm(away, axis=1) >= apart).all() and street not in (*taken, *free):
                free.append(street)
            if len(free) == number:
                break
        apart = apart / 2 if apart > 1 else 0.0
    return iter(free)


def nearest_street(snapper: Snapper, sensor: Sensor) -> int | None:
    """The street that a sensor stands on, where it has a place.

    Raises
    ------
    ScenarioError
        A place outside the town.
    """
    if sensor.place is None:
        return None
    return nearest(snapper, "sensors", f"sensor {sensor.name!r}", sensor.place).street


def nearest(snapper: Snapper, field: str, what: str, place: tuple[float, float]) -> StreetPoint:
    """The nearest place on a street.

    Raises
    ------
    ScenarioError
        A place outside the town, with the ``field`` that has it and a word for ``what`` should be there.
    """
    try:
        return snapper.nearest(*place)
    except TownError as error:
        raise ScenarioError(f"{what}: {error}", field=field) from error


def crossings(town: Town, name: str, waypoints: tuple[Waypoint, ...]) -> tuple[int, ...]:
    """Numbers of the crossings that the origins or destinations of a venue are.

    A place is taken to the nearest street, and there to the nearer end.

    Parameters
    ----------
    town
        The streets.
    name
        ``origins`` or ``destinations``, for messages.
    waypoints
        What the venue says of them.

    Raises
    ------
    ScenarioError
        Crossings that do not exist, places outside the town, and two places that are one crossing.
    """
    snapper, found = Snapper(town), dict[int, Waypoint]()
    for waypoint in waypoints:
        node = _crossing(town, snapper, name, waypoint)
        if node in found:
            both = f"{found[node]} and {waypoint} are both crossing {node}"
            raise ScenarioError(f"{name} must all be different, but {both}", field=name)
        found[node] = waypoint
    return tuple(found)


def _crossing(town: Town, snapper: Snapper, name: str, waypoint: Waypoint) -> int:
    if isinstance(waypoint, int):
        if waypoint >= town.nodes:
            raise ScenarioError(
                f"{name}: there is no crossing {waypoint}; they are numbered 0 to {town.nodes - 1}", field=name
            )
        return waypoint
    on = nearest(snapper, name, name, waypoint)
    return int(town.tail[on.street] if on.fraction < 0.5 else town.head[on.street])


def check_ways(network: RoadNetwork, origins: tuple[int, ...], destinations: tuple[int, ...]) -> None:
    """Make sure that a path leads to each destination from wherever walkers may stray.

    Imported towns are in one part. Those of other programs need not be, and a walker must not come to a crossing from
    which no path leads on.

    Parameters
    ----------
    network
        The streets.
    origins, destinations
        Nodes where walks begin and end; none: anywhere.

    Raises
    ------
    ScenarioError
        A crossing from which no path leads to a destination, or a destination where all walks would begin.
    """
    for destination in destinations:
        if origins == (destination,):
            raise ScenarioError(
                f"destinations: crossing {destination} is the only origin, so nobody walks there", field="destinations"
            )
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    forth = coo_array((np.ones(len(tail)), (tail, head)), shape=(network.nodes,) * 2).tocsr()
    if connected_components(forth, connection="strong")[0] == 1:
        return
    back = forth.T.tocsr()
    met = [breadth_first_order(forth, node, return_predecessors=False) for node in origins]
    strays = np.unique(np.concatenate(met)) if met else np.arange(network.nodes)
    # If all come to one crossing, and from there to all, then all come to all.
    for destination in destinations or (int(strays[0]),):
        lost = np.setdiff1d(strays, breadth_first_order(back, destination, return_predecessors=False))
        if len(lost):
            raise _no_path(int(lost[0]), destination)
    if not destinations:
        first = int(strays[0])
        missed = np.setdiff1d(np.arange(network.nodes), breadth_first_order(forth, first, return_predecessors=False))
        if len(missed):
            raise _no_path(first, int(missed[0]))


def _no_path(start: int, end: int) -> ScenarioError:
    return ScenarioError(
        f"no path leads from crossing {start} to crossing {end}; choose origins and destinations in the part of the "
        "town in which all crossings reach each other, or import the streets by sidestep import-osm, which keeps it",
    )
