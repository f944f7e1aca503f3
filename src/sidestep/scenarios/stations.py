"""Where things of a venue are on its streets: sensors, lights, origins and destinations."""

import numpy as np
from jaxtyping import Bool, Int

from sidestep.network.connected import components, reached
from sidestep.network.graph import ABSENT, RoadNetwork
from sidestep.network.snapping import Snapper, StreetPoint
from sidestep.network.town import TownError
from sidestep.programs import on_device
from sidestep.scenarios.places import Sensor
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.values import Waypoint

APART = 150.0  # m between sensors that are paired with streets, as far as there is room
STEPS = "steps"


def nearest(snapper: Snapper, place: tuple[float, float], field: str, name: str | None = None) -> StreetPoint:
    """Find the point on the streets that is nearest to a place of a venue.

    Parameters
    ----------
    snapper
        The streets.
    place
        Latitude and longitude in degrees.
    field
        ``sensors``, ``lights``, ``origins`` or ``destinations``, for messages.
    name
        Which of the sensors or lights is there.

    Returns
    -------
    StreetPoint
        The street, and where on it.

    Raises
    ------
    ScenarioError
        A place outside the town.
    """
    try:
        return snapper.nearest(*place)
    except TownError as error:
        what = field if name is None else f"{field.removesuffix('s')} {name!r}"
        raise ScenarioError(f"{what}: {error}", field=field) from error


def stations(
    snapper: Snapper, network: RoadNetwork, sensors: tuple[Sensor, ...], pairing: int
) -> Int[np.ndarray, " sensor"]:
    """The segment that each sensor stands on: the street nearest to its place, or, without one, a street drawn for it.

    Streets are drawn in proportion to their length, at least ``APART`` from one another as long as there are such.

    Parameters
    ----------
    snapper, network
        The streets.
    sensors
        Each as often as it stands on a street.
    pairing
        Seed of the streets that are drawn.

    Returns
    -------
    Int[np.ndarray, " sensor"]
        The segment of each sensor, which leads from its street's tail to the head.

    Raises
    ------
    ScenarioError
        More sensors, counted once for each of their streets, than streets; places outside the town.
    """
    town = snapper.town
    if len(sensors) > town.streets:
        names = len({sensor.name for sensor in sensors})
        each = f" on {len(sensors)} streets" if names < len(sensors) else ""
        raise ScenarioError(f"there are {names} sensors{each}, but {town.streets} streets in the town")
    placed = [
        None if sensor.place is None else nearest(snapper, sensor.place, "sensors", sensor.name).street
        for sensor in sensors
    ]
    taken = [street for street in placed if street is not None]
    middle = (np.asarray(network.position)[town.tail] + np.asarray(network.position)[town.head]) / 2
    weight = np.where(np.array(town.kind) == STEPS, 0.0, town.length) + 1e-9
    rng = np.random.default_rng([pairing, len(sensors)])
    drawn = rng.choice(town.streets, town.streets, replace=False, p=weight / weight.sum()).tolist()
    first_drawn, apart = len(taken), APART
    while len(taken) < len(sensors):
        for street in drawn:
            if len(taken) < len(sensors) and street not in taken:
                away = np.linalg.norm(middle[taken] - middle[street], axis=1)
                if (away >= apart).all():
                    taken.append(street)
        apart = apart / 2 if apart > 1 else 0.0
    free = iter(taken[first_drawn:])
    return np.array([next(free) if street is None else street for street in placed], np.int64)


def crossings(snapper: Snapper, name: str, waypoints: tuple[Waypoint, ...]) -> tuple[int, ...]:
    """Numbers of the crossings that the origins or destinations of a venue are.

    A place is taken to the nearest street, and there to the nearer end.

    Parameters
    ----------
    snapper
        The streets.
    name
        ``origins`` or ``destinations``, for messages.
    waypoints
        What the venue says of them.

    Returns
    -------
    tuple[int, ...]
        A crossing for each of them.

    Raises
    ------
    ScenarioError
        Crossings that do not exist, places outside the town, and two places that are one crossing.
    """
    town, found = snapper.town, dict[int, Waypoint]()
    for waypoint in waypoints:
        if not isinstance(waypoint, int):
            on = nearest(snapper, waypoint, name)
            node = int(town.tail[on.street] if on.fraction < 0.5 else town.head[on.street])
        elif waypoint < town.nodes:
            node = waypoint
        else:
            numbers = f"they are numbered 0 to {town.nodes - 1}"
            raise ScenarioError(f"{name}: there is no crossing {waypoint}; {numbers}", field=name)
        if node in found:
            both = f"{found[node]} and {waypoint} are both crossing {node}"
            raise ScenarioError(f"{name} must all be different, but {both}", field=name)
        found[node] = waypoint
    return tuple(found)


def check_ways(network: RoadNetwork, origins: tuple[int, ...], destinations: tuple[int, ...]) -> None:
    """Make sure that a path leads to each destination from wherever walkers may stray.

    Imported towns are in one part. Those of other programs need not be, and a walker must not come to a crossing from
    which no path leads on. Nobody strays into restricted areas that the walk does not end in.

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
    if len(origins) == 1 and origins[0] in destinations:
        raise ScenarioError(
            f"destinations: crossing {origins[0]} is the only origin, so nobody walks there", field="destinations"
        )
    origins, destinations = (_one_each(network, ends) for ends in (origins, destinations))
    if not destinations:
        _check_everywhere(network, origins)
    for destination in destinations:
        taken = np.asarray(network.may_take(on_device(destination, np.int32)))
        strays = _reached(network, taken, *origins) if origins else np.arange(network.nodes)
        _refuse(np.setdiff1d(strays, _reached(network, taken, destination, back=True)), destination)


def _check_everywhere(network: RoadNetwork, origins: tuple[int, ...]) -> None:
    """The same for walks to any crossing that walkers come to."""
    strays = np.arange(network.nodes)
    if origins:
        strays = np.unique(np.concatenate([_reached(network, _from(network, node), node) for node in origins]))
    # If all come to one crossing, and from there to all, then all come to all. It is in no restricted area, where there
    # is such a crossing: then nobody on the way to it enters one.
    outside = strays if network.area is None else strays[np.asarray(network.area)[strays] == ABSENT]
    first = int((*outside, *strays)[0])
    taken = np.asarray(network.may_take(on_device(first, np.int32)))
    _refuse(np.setdiff1d(strays, _reached(network, taken, first, back=True)), first)
    for lost in np.setdiff1d(np.arange(network.nodes), _reached(network, _from(network, first), first)).tolist():
        _refuse([first], lost)


def _from(network: RoadNetwork, origin: int) -> Bool[np.ndarray, " segment"]:
    """Which segments walks from a crossing take, wherever they end."""
    valid, taken = np.asarray(network.exits_from(on_device(origin, np.int32))), np.zeros(network.segments, bool)
    taken[np.asarray(network.exit_segment)[valid]] = True
    return taken


def _reached(
    network: RoadNetwork, taken: Bool[np.ndarray, " segment"], *starts: int, back: bool = False
) -> Int[np.ndarray, " reached"]:
    """Nodes to which paths over the segments taken lead from any of some nodes or, if ``back``, from which to them."""
    tail, head = (np.asarray(each)[taken] for each in (network.tail, network.head))
    begin, end = (head, tail) if back else (tail, head)
    return reached(network.nodes, begin, end, starts)


def _refuse(lost: Int[np.ndarray, " node"] | list[int], destination: int) -> None:
    if len(lost):
        raise ScenarioError(
            f"no path leads from crossing {lost[0]} to crossing {destination}; choose origins and destinations in "
            "the part of the town in which all crossings reach each other, or import the streets by sidestep "
            "import-osm, which keeps it",
        )


def _one_each(network: RoadNetwork, ends: tuple[int, ...]) -> tuple[int, ...]:
    """The first of those ends that reach each other: from all of them, and to all, paths lead alike."""
    if len(ends) < 2:
        return ends
    taken = slice(None) if network.enters is None else np.asarray(network.enters) == ABSENT
    tail, head = (np.asarray(each)[taken] for each in (network.tail, network.head))
    component = components(network.nodes, tail, head)
    _, first = np.unique(component[list(ends)], return_index=True)
    return tuple(ends[number] for number in sorted(first.tolist()))
