"""Places: when people set out, what is invented, and what grids and venues answer alike."""

import numpy as np
import pytest

from sidestep.scenarios.builtin import BUILT_IN
from sidestep.scenarios.places import Counters, CrowdTable, Grid, RushHours, Sensor, Traffic, Venue
from sidestep.walking.waits import GOLDEN

PLACED, UNPLACED = Sensor(name="a", place=(60.17, 24.94)), Sensor(name="b")
TABLE = CrowdTable(file="there/crowds.npz")


def test_hours_are_those_of_the_days() -> None:
    # Tuesday and Sunday from 9 to 11: hours 33, 34, 153 and 154. Multiples of 1.732051 less their whole part are
    # 0, .732, .464, .196, .928, .660: of four hours number 0, 2, 1, 0, 3, 2.
    venue = Venue(days=(6, 1), hours=(9, 11))
    assert venue.departure_hours(6) == [33, 153, 34, 33, 154, 153]
    assert venue.departure_hours(3, first=2) == [34, 33, 154]
    assert Grid().departure_hours(3, first=2) == [0, 0, 0]


def test_hours_are_spread_evenly() -> None:
    # Seventy hours from 10 to 20 of every day
    hours, counts = np.unique(Venue().departure_hours(700), return_counts=True)
    assert hours.tolist() == [24 * day + hour for day in range(7) for hour in range(10, 20)]
    assert set(counts.tolist()) <= {8, 9, 10, 11, 12}


def test_minutes_have_nothing_to_do_with_hours() -> None:
    # 840 walks: in every sixth of an hour of every weekday about 20, and of every hour of the day 14.
    walks = 840
    starts = np.array(Venue().departure_hours(walks)).astype(int)
    sixth = (6 * (np.arange(walks) * GOLDEN % 1)).astype(int)  # of the departures
    for hour, each in ((starts // 24, 20), (starts % 24 - 10, 14)):
        counts = np.zeros((walks // 6 // each, 6))
        np.add.at(counts, (hour, sixth), 1)
        assert (abs(counts - each) <= 3).all()


@pytest.mark.parametrize(
    ("place", "words", "others"),
    [
        (Grid(), ["drawn from a seed"], ["demand"]),
        (BUILT_IN["helsinki"].place, ["paired with streets", "demand 120 × the counts (an invented event day)"], []),
        (BUILT_IN["helsinki-signals"].place, ["demand 120 ×", "traffic lights"], []),
        (Venue(), ["paired with streets"], ["demand", "lights"]),
        (Venue(crowd_source=Counters(sensors=(PLACED, UNPLACED))), ["paired with streets"], ["demand"]),
        (Venue(crowd_source=Counters(sensors=(PLACED,)), crowding=2.5), ["demand 2.5 × the counts"], ["paired"]),
        (Venue(crowd_source=TABLE, crowding=2.0), ["demand 2 × the table"], ["paired"]),
    ],
)
def test_what_is_invented_is_said(place: Grid | Venue, words: list[str], others: list[str]) -> None:
    assert all(word in place.synthetic for word in words)
    assert not any(word in place.synthetic for word in others)


def test_nothing_is_invented_at_a_place_of_ones_own() -> None:
    assert Venue(crowd_source=Counters(sensors=(PLACED,))).synthetic == ""
    assert Venue(crowd_source=TABLE).synthetic == ""


def test_where_crowds_come_from() -> None:
    assert "CC BY 4.0" in Venue().attribution
    assert Venue(crowd_source=Counters(file="/there/my.csv")).attribution == "counts of my.csv"
    assert Venue(crowd_source=TABLE).attribution == "table crowds.npz"
    assert Grid().attribution == ""
    assert Venue(streets="a.npz", crowd_source=TABLE).files == ("a.npz", "there/crowds.npz")
    counted = Venue(streets="a.npz", crowd_source=Counters(file="c.csv"))
    assert counted.files == ("a.npz", "c.csv", "c.positions.csv")
    assert Venue().files == Grid().files == ()


def test_what_moves_the_crowds_and_how_they_are_known() -> None:
    noisy = CrowdTable(file="x.npz", noise=(0.9, 0.1))
    for place, moved, interpolated, certain in (
        (Grid(), "arima", False, False),
        (Grid(rush=RushHours()), "rush", False, False),
        (Venue(), "sensors", True, False),
        (Venue(crowd_source=TABLE), "table", False, True),
        (Venue(crowd_source=TABLE, traffic=Traffic()), "table", False, False),
        (Venue(crowd_source=noisy), "table", False, False),
    ):
        assert (place.crowd_model, place.interpolated, place.certain) == (moved, interpolated, certain)


def test_sides_of_grids() -> None:
    grid = Grid(side=10, larger=(14, 18), training_maps=32)
    assert (grid.sides, grid.nodes) == ((10, 14, 18), 100)
    assert (Venue().training_maps, Venue().nodes) == (0, 0)
    assert Grid(side=2, crowded_nodes=2).crowded_nodes == 2
