"""Pavements are called after the street along which they run."""

import pytest

FOOT = {"highway": "footway"}
HIGH, SIDE = {"highway": "residential", "name": "High Street"}, {"highway": "residential", "name": "Side Street"}


def names(town) -> dict[int, str]:
    """Names by rounded length."""
    return {round(float(length)): name for length, name in zip(town.length, town.name, strict=True)}


def beside(pavement: dict[str, str], street: dict[str, str], away: float) -> tuple:
    """A street of 300 m, and 200 m of pavement beside it; tracks, which get no names, join all ends."""
    nodes = {1: (0, 0), 2: (300, 0), 4: (60, away), 5: (260, away), 6: (60, -90), 7: (260, -90)}
    track = {"highway": "track"}
    ways = {
        1: ((1, 2), street),
        2: ((4, 5), pavement),
        3: ((1, 4, 6), track),
        4: ((2, 5, 7), track),
        5: ((6, 7), track),
    }
    return nodes, ways


@pytest.mark.parametrize(
    ("pavement", "street", "away", "name"),
    [
        (FOOT, HIGH, 8, "High Street"),
        ({"highway": "cycleway", "foot": "yes"}, HIGH, 8, "High Street"),
        (FOOT, {**HIGH, "sidewalk": "separate"}, 8, "High Street"),  # which is not walked itself
        (FOOT, {**HIGH, "highway": "pedestrian"}, 8, "High Street"),
        (FOOT, HIGH, 30, ""),
        ({**FOOT, "name": "Promenade"}, HIGH, 8, "Promenade"),
        ({**FOOT, "is_sidepath:of:name": "Long Street"}, HIGH, 8, "Long Street"),
        ({"highway": "steps"}, HIGH, 8, ""),
        (FOOT, {"highway": "residential"}, 8, ""),
        (FOOT, {"highway": "path", "name": "Old Path"}, 8, ""),
    ],
)
def test_names_of_pavements(build, pavement, street, away, name: str) -> None:
    town, report = build(*beside(pavement, street, away))
    assert names(town)[200] == name
    called = report.repaired.get("street: called after the street along which it runs", 0)
    assert called == (name == "High Street")


def test_a_way_that_leads_away_from_a_street_keeps_no_name(build) -> None:
    nodes = {1: (0, 0), 2: (100, 0), 3: (200, 0), 4: (100, 18), 5: (100, 100)}
    town, _ = build(nodes, {1: ((1, 2, 3), HIGH), 2: ((2, 4, 5), FOOT)})
    assert sorted(town.name) == ["", "High Street", "High Street"]


def test_a_pavement_round_a_corner_has_the_name_of_its_greater_part(build) -> None:
    # 60 m along High Street, then 120 m along Side Street.
    nodes = {1: (0, 0), 2: (90, 0), 3: (0, 200), 4: (68, 8), 5: (8, 8), 6: (8, 128), 7: (-90, 128)}
    ways = {1: ((2, 1), HIGH), 2: ((1, 3), SIDE), 3: ((4, 5, 6), FOOT), 4: ((4, 2), FOOT), 5: ((6, 7, 3), FOOT)}
    town, _ = build(nodes, ways)
    assert [name for name in town.name if name].count("Side Street") == 2
