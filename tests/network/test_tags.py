"""Tags: what is walked, in which direction, and how wide it is."""

import pytest

from sidestep.network import tags as walkable
from sidestep.network.tags import WIDTHS, WidthError, direction, parse_width, refusal, room, standing, width_table


def tags(text: str) -> dict[str, str]:
    return dict(pair.split("=", 1) for pair in text.split())


@pytest.mark.parametrize("kind", sorted(set(WIDTHS) - {"cycleway", "bridleway", "trunk", "trunk_link"}))
def test_kinds_that_are_walked(kind: str) -> None:
    assert refusal({"highway": kind}) is None


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
    assert refusal(tags(said)) is None


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ("highway=motorway", "not a kind"),
        ("highway=construction", "not a kind"),
        ("highway=proposed", "not a kind"),
        ("highway=platform", "not a kind"),
        ("highway=elevator", "not a kind"),
        ("highway=motorway foot=yes", "not a kind"),
        ("highway=cycleway", "only where a tag says so"),
        ("highway=cycleway foot=no", "no access"),
        ("highway=bridleway", "only where a tag says so"),
        ("highway=trunk", "only where a tag says so"),
        ("highway=trunk sidewalk=no", "only where a tag says so"),
        ("highway=footway access=no", "no access"),
        ("highway=footway access=private", "no access"),
        ("highway=service foot=private", "no access"),
        ("highway=residential foot=no access=yes", "no access"),
        ("highway=residential foot=use_sidepath", "ways of their own"),
        ("highway=residential sidewalk=separate", "ways of their own"),
        ("highway=residential sidewalk=separate foot=yes", "ways of their own"),
        ("highway=residential sidewalk:both=separate", "ways of their own"),
        ("highway=primary sidewalk:left=separate sidewalk:right=no", "ways of their own"),
        ("highway=primary sidewalk=no", "no pavement"),
        ("highway=secondary_link sidewalk=none", "no pavement"),
        ("highway=secondary sidewalk:both=no", "no pavement"),
    ],
)
def test_ways_that_are_not_walked(said: str, why: str) -> None:
    assert why in (refusal(tags(said)) or "")


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
    ("said", "metres", "nonsense"),
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
def test_room(said: str, metres: float, *, nonsense: bool) -> None:
    assert room(tags(said)) == (pytest.approx(metres), nonsense)


def test_widths_may_be_chosen() -> None:
    table = width_table({"footway": 2.5})
    assert room({"highway": "footway"}, table) == (2.5, False)
    assert room({"highway": "path"}, table) == (WIDTHS["path"], False)
    assert width_table(None) == dict(WIDTHS)


@pytest.mark.parametrize(
    ("changes", "says"),
    [({"alley": 2}, "alley"), ({"path": 0}, "path"), ({"path": float("nan")}, "nan"), ({"path": 1e3}, "1000")],
)
def test_widths_that_cannot_be(changes, says) -> None:
    with pytest.raises(WidthError, match=says):
        width_table(changes)


@pytest.mark.parametrize(
    ("said", "what"),
    [
        ("highway=traffic_signals", 2),
        ("highway=crossing crossing=traffic_signals", 2),
        ("crossing=uncontrolled crossing:signals=yes", 2),
        ("highway=crossing", 1),
        ("crossing=zebra", 1),
        ("highway=crossing crossing=unmarked", 1),
        ("crossing=no", 0),
        ("highway=bus_stop", 0),
        ("", 0),
    ],
)
def test_crossings_of_traffic(said: str, what: int) -> None:
    assert standing(tags(said)) == what


def test_every_kind_has_a_sensible_width() -> None:
    assert set(WIDTHS) >= walkable.WHOLE
    assert all(1 <= width <= 10 for width in WIDTHS.values())
