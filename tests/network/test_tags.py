"""Tags: what is walked, in which direction, and how wide it is."""

import pytest

from sidestep.network.tags import (
    FULL_WIDTH,
    WIDTHS,
    CrossingKind,
    WidthError,
    crossing_kind,
    direction,
    exclusion_reason,
    parse_width,
    walkable_width,
    width_table,
)


def tags(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split())


@pytest.mark.parametrize("kind", sorted(set(WIDTHS) - {"cycleway", "bridleway", "trunk", "trunk_link"}))
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
        ("highway=platform", "not a walkable kind"),
        ("highway=elevator", "not a walkable kind"),
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
    ],
)
def test_ways_that_are_not_walked(said: str, why: str) -> None:
    assert why in (exclusion_reason(tags(said)) or "")


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
    assert direction(tags(said)) == way


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("3", 3),
        ("3.5 m", 3.5),
        ("3,5", 3.5),
        (" 2.50 ", 2.5),
        ("4 metres", 4),
        ("12'", 3.6576),
        ("10 ft", 3.048),
        ("6'6\"", 1.9812),
        ("100", 100),
        ("0.3", 0.3),
    ],
)
def test_widths_that_make_sense(text: str, metres: float) -> None:
    assert parse_width(text) == pytest.approx(metres)


@pytest.mark.parametrize(
    "text", ["", "wide", "-2", "0", "0.1", "101", "1e9", "3;4", "3-4", "nan", "inf", "2 km", '3 m 6"', "9" * 500, "٣"]
)
def test_widths_that_make_none(text: str) -> None:
    assert parse_width(text) is None


@pytest.mark.parametrize(
    ("said", "metres", "ignored"),
    [
        ("highway=footway", 2, False),
        ("highway=footway width=3.5", 3.5, False),
        ("highway=footway est_width=4", 4, False),
        ("highway=footway width=3 est_width=4", 3, False),
        ("highway=footway width=wide", 2, True),
        ("highway=footway width=wide est_width=4", 4, True),
        ("highway=residential", 4, False),
        ("highway=residential width=8", 4, False),  # the carriageway's
        ("highway=residential sidewalk=left", 2, False),
        ("highway=residential sidewalk=no", 2, False),  # along one side of the road itself
        ("highway=residential sidewalk:width=1.5", 3, False),
        ("highway=residential sidewalk=right sidewalk:width=1.5", 1.5, False),
        ("highway=residential sidewalk:both:width=2.5", 5, False),
        ("highway=residential sidewalk:left:width=1 sidewalk:right:width=2.5", 3.5, False),
        ("highway=residential sidewalk:left:width=1", 3, False),  # the right from the table: 4 / 2
        ("highway=residential sidewalk:width=broad", 4, True),
        ("highway=secondary sidewalk:left=separate sidewalk:right=yes", 2.5, False),
    ],
)
def test_walkable_widths(said: str, metres: float, *, ignored: bool) -> None:
    assert walkable_width(tags(said)) == (pytest.approx(metres), ignored)


def test_widths_may_be_chosen() -> None:
    table = width_table({"footway": 2.5})
    assert walkable_width({"highway": "footway"}, table) == (2.5, False)
    assert walkable_width({"highway": "path"}, table) == (WIDTHS["path"], False)
    assert width_table(None) == dict(WIDTHS)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"alley": 2}, "widths"),
        ({"path": 0}, "widths.path"),
        ({"path": float("nan")}, "widths.path"),
        ({"steps": 1e3}, "widths.steps"),
    ],
)
def test_invalid_widths(changes, field: str) -> None:
    with pytest.raises(WidthError) as caught:
        width_table(changes)
    assert caught.value.field == field


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
    assert set(WIDTHS) >= FULL_WIDTH
    assert all(1 <= width <= 10 for width in WIDTHS.values())
