"""Tags: what is walked, in which direction, and by whom."""

import pytest

from sidestep.network.meanings import meanings
from sidestep.network.tags import (
    FULL_WIDTH,
    KINDS,
    WIDTHS,
    CrossingKind,
    crossing_kind,
    directions,
    exclusion_reason,
)


def tags(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split())


@pytest.mark.parametrize("kind", sorted(set(WIDTHS) - {"cycleway", "bridleway", "busway", "trunk", "trunk_link"}))
def test_kinds_that_are_walked(kind: str) -> None:
    assert exclusion_reason({"highway": kind}) is None


@pytest.mark.parametrize(
    "said",
    [
        "highway=cycleway foot=yes",
        "highway=cycleway foot=designated",
        "highway=bridleway foot=permissive",
        "highway=trunk sidewalk=both",
        "highway=trunk foot=yes",
        "highway=trunk_link sidewalk:left=yes",
        "highway=service access=private foot=yes",
        "highway=footway access=customers",
        "highway=residential sidewalk=no",  # walked on the road
        "highway=tertiary sidewalk=none",
        "highway=secondary sidewalk=no foot=yes",
        "highway=secondary sidewalk:left=separate sidewalk:right=yes",
        "highway=secondary sidewalk:left=separate",  # nothing is said of the right
        "highway=footway sidewalk=separate",  # makes no sense on a footway
    ],
)
def test_ways_that_are_walked(said: str) -> None:
    assert exclusion_reason(tags(said)) is None


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("highway=motorway", "not a walkable kind"),
        ("highway=construction", "not a walkable kind"),
        ("highway=proposed", "not a walkable kind"),
        ("highway=ferry", "ferry"),
        ("highway=motorway foot=yes", "not a walkable kind"),
        ("highway=cycleway", "not tagged as walkable"),
        ("highway=cycleway foot=no", "no access"),
        ("highway=bridleway", "not tagged as walkable"),
        ("highway=trunk", "not tagged as walkable"),
        ("highway=trunk sidewalk=no", "not tagged as walkable"),
        ("highway=footway access=no", "no access"),
        ("highway=footway access=private", "no access"),
        ("highway=service foot=private", "no access"),
        ("highway=residential foot=no access=yes", "no access"),
        ("highway=residential foot=use_sidepath", "mapped separately"),
        ("highway=residential sidewalk=separate", "mapped separately"),
        ("highway=residential sidewalk=separate foot=yes", "mapped separately"),
        ("highway=residential sidewalk:both=separate", "mapped separately"),
        ("highway=primary sidewalk:left=separate sidewalk:right=no", "mapped separately"),
        ("highway=primary sidewalk=no", "no pavement"),
        ("highway=secondary_link sidewalk=none", "no pavement"),
        ("highway=secondary sidewalk:both=no", "no pavement"),
        ("highway=footway oneway:foot=yes foot:forward=no", "contradicting directions"),
    ],
)
def test_ways_that_are_not_walked(said: str, why: str) -> None:
    assert why in (exclusion_reason(tags(said)) or "")


BY_FOOT = [
    "highway=residential motorroad=yes",
    "highway=primary motorroad=yes sidewalk=both",
    "highway=trunk",
    "highway=trunk_link sidewalk=no",
    "highway=busway",
    "highway=cycleway",
    "highway=bridleway",
    "highway=primary sidewalk=no",
    "highway=secondary_link sidewalk:both=none",
]
"""Ways that are closed unless ``foot`` lets people walk."""


@pytest.mark.parametrize("way", BY_FOOT)
@pytest.mark.parametrize(
    ("foot", "walked"),
    [
        ("", []),
        ("access=yes", []),
        ("foot=unheard-of", []),
        ("foot:conditional=no@22:00-06:00", []),
        ("access:conditional=yes@06:00-22:00", []),
        ("foot=yes", [(0, "")]),
        ("foot:forward=yes", [(1, "")]),
        ("foot:conditional=yes@06:00-22:00", [(0, "06:00-22:00")]),
        ("access=yes foot:conditional=yes@06:00-22:00", [(0, "06:00-22:00")]),
        ("foot=yes foot:conditional=no@22:00-06:00", [(0, "06:00-22:00")]),
        ("foot=yes opening_hours=06:00-22:00", [(0, "06:00-22:00")]),
        ("foot:backward:conditional=yes@06:00-22:00", [(-1, "06:00-22:00")]),
    ],
)
def test_ways_that_are_closed_unless_foot_opens_them(way: str, foot: str, walked: list[tuple[int, str]]) -> None:
    every = tags(f"{way} {foot}".strip())
    assert (exclusion_reason(every) is None) == bool(walked)
    assert [(side, right.opening) for side, right in directions(every)] == walked
    assert meanings(WIDTHS)(every).walked == tuple(directions(every))


def test_a_restricted_way_is_so_at_the_hours_at_which_foot_opens_it() -> None:
    ((_, right),) = directions(tags("highway=trunk foot:conditional=destination@06:00-22:00"))
    assert (right.opening, right.restricted) == ("06:00-22:00", True)


def test_areas_are_closed_unless_foot_opens_them() -> None:
    square = meanings(WIDTHS)(tags("highway=cycleway area=yes foot:conditional=yes@06:00-22:00"))
    assert square.right.opening == "06:00-22:00"


@pytest.mark.parametrize(
    ("said", "way"),
    [
        ("highway=footway", 0),
        ("highway=residential oneway=yes", 0),
        ("highway=pedestrian oneway=yes", 0),
        ("highway=path oneway=yes", 0),
        ("highway=footway oneway=yes", 1),
        ("highway=footway oneway=yes bicycle=yes", 0),
        ("highway=footway oneway=yes oneway:foot=no", 0),
        ("highway=steps oneway=-1", -1),
        ("highway=residential oneway:foot=yes", 1),
        ("highway=path oneway:foot=-1", -1),
        ("highway=steps conveying=forward", 1),
        ("highway=steps conveying=backward", -1),
        ("highway=steps conveying=reversible", 0),
        ("highway=steps conveying=yes", 0),
    ],
)
def test_directions(said: str, way: int) -> None:
    assert [walked for walked, _ in directions(tags(said))] == [way]


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        ("highway=traffic_signals", CrossingKind.SIGNALS),
        ("highway=crossing crossing=traffic_signals", CrossingKind.SIGNALS),
        ("crossing=uncontrolled crossing:signals=yes", CrossingKind.SIGNALS),
        ("highway=crossing", CrossingKind.UNSIGNALISED),
        ("crossing=zebra", CrossingKind.UNSIGNALISED),
        ("highway=crossing crossing=unmarked", CrossingKind.UNSIGNALISED),
        ("crossing=no", CrossingKind.NONE),
        ("highway=bus_stop", CrossingKind.NONE),
        ("", CrossingKind.NONE),
    ],
)
def test_crossings_of_traffic(said: str, kind: CrossingKind) -> None:
    assert crossing_kind(tags(said)) is kind


def test_every_kind_has_a_sensible_width() -> None:
    assert set(KINDS) >= FULL_WIDTH
    assert exclusion_reason(tags("highway=area")) is not None
    assert all(1 <= width <= 10 for width in WIDTHS.values())
