"""What a scenario's specs stand for: streets of venues with crowds and waits, objectives, reward weights."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from sidestep.crowds.base import FlowModel
from sidestep.environment.types import RewardWeights
from sidestep.files import cached_by_files
from sidestep.network.formats import load_helsinki, load_town
from sidestep.network.graph import RoadNetwork
from sidestep.network.snapping import Snapper
from sidestep.network.town import Town
from sidestep.scenarios.crowd_sources import HOUR, Check, crowds_of
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec
from sidestep.scenarios.places import Light, Place, Traffic, Venue
from sidestep.scenarios.stations import check_ways, crossings, nearest
from sidestep.scenarios.values import Waypoint
from sidestep.walking.objective import TravelTime, WeightedObjective
from sidestep.walking.speed_laws import Law
from sidestep.walking.waits import NoWaits, Waits

MOST_CROSSINGS = 8  # without lights on one street; with more, waits might change faster than time goes by
# Of the busiest hour's traffic, by hour of the day: a working day in a city, as an assumption.
DAY_OF_TRAFFIC = (
    0.10, 0.06, 0.05, 0.05, 0.08, 0.20, 0.45, 0.80, 0.95, 0.75, 0.70, 0.75,
    0.80, 0.80, 0.80, 0.85, 0.95, 1.00, 0.85, 0.65, 0.50, 0.40, 0.30, 0.18,
)  # fmt: skip


class VenueParts(NamedTuple):
    """What a map of a venue is made of."""

    network: RoadNetwork
    flow: FlowModel
    test_flow: FlowModel
    sensors: tuple[str, ...]
    origins: tuple[int, ...]
    destinations: tuple[int, ...]
    waits: Waits | NoWaits


@cached_by_files(lambda streets: (streets,))
def town_of(streets: str) -> Town:
    """The streets of a venue, read once as long as their file stays as it is.

    Parameters
    ----------
    streets
        Name of a file, or ``helsinki``.

    Raises
    ------
    SidestepError
        A file that cannot be read.
    """
    return load_helsinki() if streets == "helsinki" else load_town(Path(streets))


def attribution_of(place: Place) -> str:
    """Whose streets a place has; "" where they are drawn."""
    return town_of(place.streets).attribution if place.streets else ""


@cached_by_files(lambda venue, *_: venue.files)
def venue_parts(venue: Venue, slot_seconds: float, law: Law) -> VenueParts:
    """Streets, crowds and waits of a venue, made once as long as its files stay as they are.

    Parameters
    ----------
    venue
        The place.
    slot_seconds
        Seconds in which crowds do not change.
    law
        Turns speeds into densities, where a table of crowds has speeds.

    Raises
    ------
    SidestepError
        Files that cannot be read, sensors that are not in the counts or outside the town, too few counts, a table
        that does not fit, origins and destinations that are not in the town.
    """
    town = town_of(venue.streets)
    network = town.network()
    return VenueParts(
        network,
        *crowds_of(venue).build(town, network, slot_seconds, law),
        crossings(town, "origins", venue.origins),
        crossings(town, "destinations", venue.destinations),
        waits_of(town, venue),
    )


def checks(venue: Venue) -> Iterator[Check]:
    """Find mistakes in what the files of a venue have for it.

    Parameters
    ----------
    venue
        The place; it need not be that its files exist.

    Yields
    ------
    check
        A field, and a call that raises if it is wrong. Those after a file that cannot be read raise as well.
    """
    yield ("streets",), partial(town_of, venue.streets)
    town = town_of(venue.streets)
    for keys, check in crowds_of(venue).checks(town):
        yield ("crowd_source", *keys), check
    snapper = Snapper(town)
    for light in venue.traffic.lights if venue.traffic else ():
        yield ("traffic", "lights", light.name), partial(_street_of, snapper, light)
    ends: list[tuple[int, ...]] = []
    for name in ("origins", "destinations"):
        yield (name,), partial(_find, ends, town, name, getattr(venue, name))
    if len(ends) == 2:
        yield ("destinations",), partial(check_ways, town.network(), *ends)


def _find(ends: list[tuple[int, ...]], town: Town, name: str, waypoints: tuple[Waypoint, ...]) -> None:
    ends.append(crossings(town, name, waypoints))


def waits_of(town: Town, venue: Venue) -> Waits | NoWaits:
    """What walkers in a venue wait for: the lights and crossings that its streets have, both ways alike.

    Parameters
    ----------
    town
        The streets.
    venue
        The place; without traffic nobody waits.

    Raises
    ------
    ScenarioError
        A light outside the town.
    """
    traffic = venue.traffic
    if traffic is None:
        return NoWaits()
    street, _ = town.street_of_segment()
    signals, timing = _timing(town, traffic)
    unsignalised = np.minimum(town.crossings, MOST_CROSSINGS)
    lights, others, cycle, green, offset = (
        jnp.asarray(each[street], jnp.float32) for each in (signals, unsignalised, *timing)
    )
    vehicles = jnp.asarray(DAY_OF_TRAFFIC, jnp.float32) * traffic.vehicles / HOUR
    return Waits(lights, others, cycle, green, offset, vehicles, traffic.critical_gap)


def _timing(town: Town, traffic: Traffic) -> tuple[np.ndarray, np.ndarray]:
    """Lights on each street; and cycle, green and offset of the first of them."""
    signals, every = town.signals.copy(), np.ones(town.streets)
    drawn = np.random.default_rng([traffic.seed, town.streets]).uniform(0, traffic.cycle, town.streets)
    timing = np.stack([traffic.cycle * every, traffic.green * every, drawn])
    snapper = Snapper(town)
    for light in traffic.lights:
        on = _street_of(snapper, light)
        signals[on] = max(signals[on], 1)
        timing[:, on] = light.cycle, light.green, light.offset
    return signals, timing


def _street_of(snapper: Snapper, light: Light) -> int:
    return nearest(snapper, "lights", f"light {light.name!r}", light.place).street


def objective_of(objective: ObjectiveSpec) -> TravelTime | WeightedObjective:
    """What walkers keep low, as environments have it."""
    return TravelTime() if objective.is_time else WeightedObjective(**objective.model_dump(exclude={"measured"}))


def reward_of(reward: RewardSpec) -> RewardWeights:
    """What an agent is rewarded for, as environments have it."""
    return RewardWeights(**dict(reward))
