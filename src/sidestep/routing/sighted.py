"""Crowds that walkers saw: to which streets they belong, how long they are remembered, and as what speeds see them."""

import math
from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np

from sidestep.routing.located import Located
from sidestep.routing.request import RouteError
from sidestep.routing.under_way import Ahead, Sighting, WalkUnderWay
from sidestep.walking.sightings import COUNTS_FOR, FORGOTTEN, Sightings

ASIDE = 45.0
"""Degrees at most between the bearing of a crowd that is seen and that of its street."""


def check_density(density: object, located: Located, field: str) -> None:
    """Refuse densities that nobody sees; RouteError with the parameter as its field."""
    number = isinstance(density, (int, float)) and not isinstance(density, bool)
    if not (number and 0 <= density <= located.densest):  # type: ignore[operator]
        said = f"a density that is seen must be 0 to {located.densest:g} persons/m²"
        raise RouteError(f"{said}, not {density!r:.60}", field=field)


def sightings_of(
    walk: WalkUnderWay, located: Located, node: int, density: float | None, ahead: Sequence[Ahead]
) -> list[Sighting]:
    """The crowds that a walker sees, by streets.

    Parameters
    ----------
    walk, located
        The walk, and its streets.
    node
        The crossing ahead.
    density, ahead
        The crowd on the street that the walker is on, and those ahead.

    Returns
    -------
    list of Sighting
        Without those in a direction in which no street leaves the crossing: the walker may see another one.

    Raises
    ------
    RouteError
        A crowd ahead of no street (field ``ahead``).
    """
    street, network, seen = located.street_numbers, located.scenario_map.network, []

    def see(segment: int, density: float) -> None:
        seen.append(Sighting(int(street[segment]), float(density), walk.clock))

    if density is not None:
        # Where a walker has just left the route, it is in the middle of a street, or else at a crossing.
        for segment in walk.segments[:1] or located.exits(node)[: node >= located.nodes]:
            see(segment, density)
    for each in ahead:
        if each.segment is None:
            found = _towards(each.bearing, located, node)
        else:
            found = each.segment
            if not 0 <= found < network.segments:
                said = f"segments are numbered 0 to {network.segments - 1}"
                raise RouteError(f"{said}; a crowd ahead is not on segment {found}", field="ahead")
        if found is not None:
            see(found, each.density)
    return seen


def _towards(bearing: float | None, located: Located, node: int) -> int | None:
    """The segment that leaves a node about in a direction; None where there is none."""
    if bearing is None or not math.isfinite(bearing):
        raise RouteError("a crowd ahead is that of a street; give its bearing or its segment", field="ahead")
    aside = {abs((located.bearings(one)[0] - bearing + 180) % 360 - 180): one for one in located.exits(node)}
    nearest = min(aside, default=math.inf)
    return aside[nearest] if nearest <= ASIDE else None


def remembering(walk: WalkUnderWay, seen: Sequence[Sighting]) -> WalkUnderWay:
    """The walk with what is seen now, and without what is forgotten; of each street the latest counts."""
    latest = {each.street: each for each in (*walk.sightings, *seen)}
    return replace(walk, sightings=tuple(each for each in latest.values() if walk.clock - each.clock < FORGOTTEN))


def as_arrays(walk: WalkUnderWay, located: Located) -> Sightings | None:
    """What was seen, on both segments of its streets and all their pieces."""
    if not walk.sightings:
        return None
    street, scenario = located.street_numbers, located.scenario
    begins = scenario.slot_seconds * np.arange(scenario.slots) + walk.crowds_from
    density, share = np.zeros(len(street), np.float32), np.zeros((len(street), scenario.slots), np.float32)
    for each in walk.sightings:
        segments, age = street == each.street, np.maximum(begins - each.clock, 0.0)
        density[segments] = each.density
        share[segments] = np.clip((FORGOTTEN - age) / (FORGOTTEN - COUNTS_FOR), 0.0, 1.0)
    return Sightings(*jax.device_put((density, share)))


def is_seen(walk: WalkUnderWay, located: Located, node: int) -> bool:
    """Whether the crowd on a street from a node was seen lately."""
    street = located.street_numbers[np.array(located.exits(node), int)].tolist()
    return any(each.street in street and walk.clock - each.clock <= COUNTS_FOR for each in walk.sightings)
