"""What a scenario's specs stand for: streets of venues and waits on them, objectives, reward weights.

And what is wrong with the files that a venue names.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from sidestep.environment.types import RewardWeights
from sidestep.errors import SidestepError
from sidestep.files import cached_by_files
from sidestep.network.formats import load_helsinki, load_town
from sidestep.network.snapping import Snapper
from sidestep.network.town import Town
from sidestep.scenarios.crowd_sources import HOUR, check_crowds
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec
from sidestep.scenarios.places import Place, Traffic, Venue
from sidestep.scenarios.spec import Fault
from sidestep.scenarios.stations import check_ways, crossings, nearest
from sidestep.walking.objective import TravelTime, WeightedObjective
from sidestep.walking.waits import NoWaits, Waits

MOST_CROSSINGS = 8  # without lights on one street; with more, waits might change faster than time goes by
# Of the busiest hour's traffic, by hour of the day: a working day in a city, as an assumption.
DAY_OF_TRAFFIC = (
    0.10, 0.06, 0.05, 0.05, 0.08, 0.20, 0.45, 0.80, 0.95, 0.75, 0.70, 0.75,
    0.80, 0.80, 0.80, 0.85, 0.95, 1.00, 0.85, 0.65, 0.50, 0.40, 0.30, 0.18,
)  # fmt: skip


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


def mistakes(venue: Venue) -> list[Fault]:
    """Find what is wrong with the files that a venue names, and with what is looked for in them.

    Parameters
    ----------
    venue
        The place; it need not be that its files hold anything.

    Returns
    -------
    list[Fault]
        The mistakes, with their fields from the scenario inwards. After a file that cannot be read there is no other.
    """
    found: list[Fault] = []

    def attempt(keys: tuple[str, ...], function: Callable[..., Any], *arguments: Any) -> Any:
        path = ("place", *keys)
        try:
            return function(*arguments)
        except SidestepError as error:
            found.append(Fault(path, str(error) if error.field else f"{'.'.join(path)}: {error}"))

    if (town := attempt(("streets",), town_of, venue.streets)) is None:
        return found
    snapper = Snapper(town)
    if check_crowds(venue, snapper, attempt) is None:
        return found
    for light in venue.traffic.lights if venue.traffic else ():
        attempt(("traffic", "lights", light.name), nearest, snapper, light.place, "lights", light.name)
    ends = [attempt((name,), crossings, snapper, name, getattr(venue, name)) for name in ("origins", "destinations")]
    if None not in ends:
        attempt(("destinations",), check_ways, town.network(), *ends)
    return found


def waits_of(snapper: Snapper, traffic: Traffic | None) -> Waits | NoWaits:
    """What walkers in a venue wait for: the lights and crossings that its streets have, both ways alike.

    Parameters
    ----------
    snapper
        The streets.
    traffic
        The vehicles; without them nobody waits.

    Returns
    -------
    Waits | NoWaits
        The waits before each segment.

    Raises
    ------
    ScenarioError
        A light outside the town.
    """
    if traffic is None:
        return NoWaits()
    town = snapper.town
    drawn = np.random.default_rng([traffic.seed, town.streets]).uniform(0, traffic.cycle, town.streets)
    timing = np.broadcast_arrays(traffic.cycle, traffic.green, drawn)
    # One row a street: its lights and its other crossings; cycle, green and offset of the first light.
    rows = np.stack([town.signals, np.minimum(town.crossings, MOST_CROSSINGS), *timing], axis=1)
    for light in traffic.lights:
        row = rows[nearest(snapper, light.place, "lights", light.name).street]
        row[:] = max(row[0], 1), row[1], light.cycle, light.green, light.offset
    street, _ = town.street_of_segment()
    lights, others, cycle, green, offset = (jnp.asarray(column[street], jnp.float32) for column in rows.T)
    vehicles = jnp.asarray(DAY_OF_TRAFFIC, jnp.float32) * traffic.vehicles / HOUR
    return Waits(lights, others, cycle, green, offset, vehicles, traffic.critical_gap)


def objective_of(objective: ObjectiveSpec) -> TravelTime | WeightedObjective:
    """What walkers keep low, as environments have it."""
    return TravelTime() if objective.is_time else WeightedObjective(**objective.model_dump(exclude={"measured"}))


def reward_of(reward: RewardSpec) -> RewardWeights:
    """What an agent is rewarded for, as environments have it."""
    return RewardWeights(**dict(reward))
