"""The scenarios that come with Sidestep, by name."""

import difflib
from dataclasses import fields, replace
from typing import Any

from sidestep.environment.types import RewardWeights
from sidestep.scenarios.model import RushHours, Scenario, ScenarioError, Sensor, Traffic, Venue

_RUSH: dict[str, Any] = {
    "side": 16,
    "crowded_nodes": 28,  # one in nine
    "crowded_volume": (5000.0, 1000.0),
    "rush": RushHours(),
    "departures": (0.0, 3600.0),
    "law": "power-capped",
    "horizon": 6 * 3600.0,
    "reward": RewardWeights(progress=0.0, bonus=0.0),
    "level": "local",
    "maps": 1,
    "walks": 500,
}


# Not those five whose cameras were exchanged between the weeks that are fitted and those that are tested.
_AUCKLAND = (
    "1 Courthouse Lane", "107 Quay Street", "150 K Road", "183 K Road", "188 Quay Street Lower Albert (EW)",
    "188 Quay Street Lower Albert (NS)", "19 Shortland Street", "2 High Street", "45 Queen Street", "59 High Street",
    "61 Federal Street", "7 Custom Street East", "8 Darby Street EW", "8 Darby Street NS", "Commerce Street West",
    "Te Ara Tahuhu Walkway",
)  # fmt: skip


_TOWN: dict[str, Any] = {
    "venue": Venue(sensors=tuple(map(Sensor, _AUCKLAND))),
    "departures": (0.0, 3600.0),
    "law": "weidmann",
    "horizon": 3 * 3600.0,
    "reward": RewardWeights(progress=0.0, bonus=0.0),
    "level": "map",
    "maps": 1,
    "walks": 500,
}


_EVENT_DAY: Venue = replace(_TOWN["venue"], crowding=120.0, uneven=0.5, reach=40.0, places=10)


BUILT_IN = {
    scenario.name: scenario
    for scenario in (
        Scenario("paper-unblocked", "the paper's 5 x 5 blocks, all segments with 200 to 1,000 people"),
        Scenario(
            "paper-congested",
            "the paper's 5 x 5 blocks, all segments at four nodes crowded by 5,000 people",
            crowded_nodes=4,
        ),
        Scenario("rush-16", "16 x 16 nodes, every street with rush hours of its own and noise", **_RUSH),
        Scenario(
            "rush-32",
            "32 x 32 nodes, every street with rush hours of its own and noise",
            **_RUSH | {"side": 32, "crowded_nodes": 114, "horizon": 12 * 3600.0},
        ),
        Scenario(
            "shifting-crowds",
            "rush-16 with the crowded nodes elsewhere on every walk",
            **_RUSH | {"rush": RushHours(shifting=True), "horizon": 8 * 3600.0},
        ),
        Scenario(
            "unseen-maps",
            "rush hours on maps that were never walked, some of them larger",
            **_RUSH
            | {
                "side": 10,
                "crowded_nodes": 11,
                "larger": (14, 18),
                "training_maps": 32,
                "level": "map",
                "maps": 12,
                "walks": 50,
            },
        ),
        Scenario(
            "helsinki",
            "central Helsinki, with counts of Auckland (a synthetic pairing) on an event day",
            **_TOWN | {"venue": _EVENT_DAY},
        ),
        Scenario(
            "helsinki-signals",
            "helsinki with traffic lights, and vehicles to wait for where there are none (their timing is invented)",
            **_TOWN | {"venue": replace(_EVENT_DAY, traffic=Traffic())},
        ),
    )
}


def scenario(name: str, **changes: object) -> Scenario:
    """A built-in scenario, with some fields changed.

    Raises
    ------
    ScenarioError
        Unknown names and impossible values.

    See Also
    --------
    sidestep.scenarios.reader.find_scenario : Takes files as well.
    """
    if name not in BUILT_IN:
        close = difflib.get_close_matches(name, BUILT_IN, n=1)
        hint = f"; did you mean {close[0]}?" if close else f"; there are {', '.join(BUILT_IN)}"
        raise ScenarioError(f"unknown scenario {name!r}{hint}; or name a file, such as my-town/scenario.toml")
    return changed(BUILT_IN[name], **changes)


def changed(problem: Scenario, **changes: object) -> Scenario:
    """A scenario with some fields changed; those of grids mean nothing where it has a venue.

    Raises
    ------
    ScenarioError
        Unknown fields and impossible values.
    """
    unknown = changes.keys() - {known.name for known in fields(Scenario)}
    if unknown:
        raise ScenarioError(f"a scenario has no field {', '.join(sorted(unknown))}")
    of_grids = changes.keys() & {"side", "crowded_nodes"}
    if problem.venue is not None and of_grids:
        without = " and no ".join(sorted(of_grids))
        raise ScenarioError(f"{problem.name} is a real place, not a grid: it has no {without}")
    return replace(problem, **changes)  # type: ignore[arg-type]
