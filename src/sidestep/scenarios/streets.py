"""The streets of a venue: all of them, and those that its walker takes."""

from collections.abc import Sequence
from functools import reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sidestep.files import cached_by_files
from sidestep.network.formats import load_helsinki, load_town
from sidestep.network.parts import TownPart, largest_part
from sidestep.network.snapping import Snapper
from sidestep.network.town import Town, TownError
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Place, Venue
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import crossings
from sidestep.scenarios.walkers import Walker

ENDS: tuple[Literal["origins", "destinations"], ...] = ("origins", "destinations")


@cached_by_files(lambda streets: (streets,))
def town_of(streets: str) -> Town:
    """The streets of a venue, read once as long as their file stays as it is.

    Parameters
    ----------
    streets
        Name of a file, or ``helsinki``.

    Returns
    -------
    Town
        Its crossings and streets.

    Raises
    ------
    SidestepError
        A file that cannot be read.
    """
    return load_helsinki() if streets == "helsinki" else load_town(Path(streets))


def attribution_of(place: Place) -> str:
    """Whose streets a place has; "" where they are drawn."""
    return town_of(place.streets).attribution if place.streets else ""


def sources_of(scenario: Scenario) -> list[str]:
    """What a scenario is, what is invented of it, who walks, and whose streets they are: the lines below pictures."""
    attribution = attribution_of(scenario.place)
    said = (
        scenario.summary,
        scenario.place.synthetic,
        scenario.walker.remark,
        attribution and f"Streets: {attribution}",
    )
    return [line for line in said if line]


@cached_by_files(lambda streets, _: (streets,))
def walked_streets(streets: str, walker: Walker) -> TownPart:
    """The streets of a venue that a walker takes, found once as long as their file stays as it is.

    Parameters
    ----------
    streets
        Name of a file, or ``helsinki``.
    walker
        Who walks.

    Returns
    -------
    TownPart
        The largest part in which the walker gets from every crossing to every other; all of the town where the walker
        takes all streets.

    Raises
    ------
    SidestepError
        A file that cannot be read.
    ScenarioError
        No street that the walker takes (field ``walker``).
    """
    town = town_of(streets)
    try:
        return largest_part(town, walker.passable(town))
    except TownError as error:
        raise ScenarioError(f"walker: {error} for {walker.in_words()}", field="walker") from error


def ends_of(venue: Venue, walker: Walker, name: str) -> tuple[int, ...]:
    """Crossings where walks begin or end.

    Parameters
    ----------
    venue, walker
        The place, and who walks there.
    name
        ``origins`` or ``destinations``.

    Returns
    -------
    tuple[int, ...]
        Those that the venue names or, where the walker does not take all streets, those that it can get to; none:
        anywhere.

    Raises
    ------
    ScenarioError
        As :func:`sidestep.scenarios.stations.crossings`, and for crossings that the walker cannot get to.
    """
    part = walked_streets(venue.streets, walker)
    ends = crossings(Snapper(part.town), name, getattr(venue, name))
    if not part.left_out:
        return ends
    if lost := sorted(set(ends) - set(part.crossings.tolist())):
        raise ScenarioError(f"{name}: {walker.called} cannot get to crossing {lost[0]}; choose another", field=name)
    return ends or tuple(part.crossings.tolist())


def for_walkers(scenario: Scenario, walkers: Sequence[Walker]) -> list[Scenario]:
    """One scenario for several walkers, who all take the same walks.

    Parameters
    ----------
    scenario
        The problem.
    walkers
        Who walks.

    Returns
    -------
    list[Scenario]
        One for each. Where some walkers cannot get everywhere, walks that might begin or end anywhere do so where all
        of them can get to.

    Raises
    ------
    ScenarioError
        A walker that can take no street, or fewer than two crossings that all can get to (field ``walker``).
    """
    place = scenario.place
    if isinstance(place, Venue):
        parts = [walked_streets(place.streets, walker) for walker in walkers]
        if any(part.left_out for part in parts):
            common = tuple(reduce(np.intersect1d, [part.crossings for part in parts]).tolist())
            if len(common) < 2:
                raise ScenarioError("walker: there are no two crossings that all of them can get to", field="walker")
            scenario = scenario.changed(**{name: common for name in ENDS if not getattr(place, name)})
    return [scenario.changed(walker=walker) for walker in walkers]


def walker_facts(scenario: Scenario) -> dict[str, Any] | None:
    """A scenario's walker for results: its numbers and, in venues, how many streets there are and are left out.

    Returns
    -------
    dict[str, Any] | None
        Ready for JSON; None for the adult that walks where nothing else is said.
    """
    facts = scenario.walker.to_json()
    if facts is None or not isinstance(scenario.place, Venue):
        return facts
    part = walked_streets(scenario.place.streets, scenario.walker)
    return facts | {"streets": part.whole.streets, "streets_left_out": part.left_out}
