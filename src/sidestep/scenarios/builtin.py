"""The scenarios that come with Sidestep, by name."""

from sidestep.arguments import checked, instance
from sidestep.errors import hint
from sidestep.scenarios.model import RewardSpec, Scenario
from sidestep.scenarios.places import Counters, Grid, RushHours, Sensor, Traffic, Venue
from sidestep.scenarios.spec import ScenarioError

NO_EXTRAS = RewardSpec(progress=0.0, bonus=0.0)
"""Nothing but the cost of the walk."""

HELSINKI_TIMEZONE = "Europe/Helsinki"

# Not those five whose cameras were exchanged between the weeks that are fitted and those that are tested.
_NAMES = (
    "1 Courthouse Lane", "107 Quay Street", "150 K Road", "183 K Road", "188 Quay Street Lower Albert (EW)",
    "188 Quay Street Lower Albert (NS)", "19 Shortland Street", "2 High Street", "45 Queen Street", "59 High Street",
    "61 Federal Street", "7 Custom Street East", "8 Darby Street EW", "8 Darby Street NS", "Commerce Street West",
    "Te Ara Tahuhu Walkway",
)  # fmt: skip
AUCKLAND_SENSORS = tuple(Sensor(name=name) for name in _NAMES)

_RUSH_16 = Scenario(
    name="rush-16",
    summary="16 x 16 nodes, every street with rush hours of its own and noise",
    place=Grid(side=16, crowded_nodes=28, crowded_volume=(5000.0, 1000.0), rush=RushHours()),  # one in nine is crowded
    horizon=6 * 3600.0,
    departures=(0.0, 3600.0),
    law="power-capped",
    reward=NO_EXTRAS,
    level="local",
    maps=1,
    walks=500,
)
_EVENT_DAY = Counters(sensors=AUCKLAND_SENSORS, streets_per_sensor=10, uneven=0.5, reach=40.0)
_HELSINKI = _RUSH_16.changed(
    name="helsinki",
    summary="central Helsinki, with counts of Auckland (a synthetic pairing) on an event day",
    place=Venue(timezone=HELSINKI_TIMEZONE, crowd_source=_EVENT_DAY, crowding=120.0),
    horizon=3 * 3600.0,
    law="weidmann",
    level="map",
)
BUILT_IN = {
    scenario.name: scenario
    for scenario in (
        Scenario(name="paper-unblocked", summary="the paper's 5 x 5 blocks, all segments with 200 to 1,000 people"),
        Scenario(
            name="paper-congested",
            summary="the paper's 5 x 5 blocks, all segments at four nodes crowded by 5,000 people",
            place=Grid(crowded_nodes=4),
        ),
        _RUSH_16,
        _RUSH_16.changed(
            name="rush-32",
            summary="32 x 32 nodes, every street with rush hours of its own and noise",
            side=32,
            crowded_nodes=114,
            horizon=12 * 3600.0,
        ),
        _RUSH_16.changed(
            name="shifting-crowds",
            summary="rush-16 with the crowded nodes elsewhere on every walk",
            rush=RushHours(shifting=True),
            horizon=8 * 3600.0,
        ),
        _RUSH_16.changed(
            name="unseen-maps",
            summary="rush hours on maps that were never walked, some of them larger",
            side=10,
            crowded_nodes=11,
            larger=(14, 18),
            training_maps=32,
            level="map",
            maps=12,
            walks=50,
        ),
        _HELSINKI,
        _HELSINKI.changed(
            name="helsinki-signals",
            summary="helsinki with traffic lights, and vehicles to wait for where there are none (their timing is "
            "invented)",
            traffic=Traffic(),
        ),
    )
}


@checked(ScenarioError, name=instance(str, "the name of a built-in scenario (load_scenario reads files)"))
def scenario(name: str, **changes: object) -> Scenario:
    """A built-in scenario, with some fields changed.

    Parameters
    ----------
    name
        One of ``BUILT_IN``.
    **changes
        Fields of the scenario, its place or its crowd source, as :meth:`~sidestep.scenarios.spec.Spec.changed` takes
        them.

    Returns
    -------
    Scenario
        The scenario, checked again.

    Raises
    ------
    ScenarioError
        Unknown names and wrong values.

    See Also
    --------
    sidestep.scenarios.reader.find_scenario : Takes files as well.

    Examples
    --------
    >>> from sidestep.scenarios.builtin import scenario
    >>> scenario("rush-16", side=8, crowded_nodes=7).place.side
    8
    >>> scenario("helsinki").place.synthetic
    'sensors paired with streets by a seed; demand 120 × the counts (an invented event day)'
    """
    if name not in BUILT_IN:
        meant = hint(name, list(BUILT_IN), "a file such as my-town/scenario.toml")
        raise ScenarioError(f"unknown scenario {name!r:.200}{meant}", field="scenario")
    return BUILT_IN[name].changed(**changes)
