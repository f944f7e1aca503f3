"""Both ends of requests on the streets, their departure, and the crowds then."""

from datetime import datetime

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.errors import SidestepError
from sidestep.network.snapping import Snapper, split_streets
from sidestep.planners.shortest_path import distances_to
from sidestep.routing.locate import SPARE_NODES, SPARE_SEGMENTS, Circumstances, connected, locator, padded
from sidestep.routing.located import FUTURES, Located
from sidestep.routing.places import AskedPlace
from sidestep.routing.request import read_departure
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import Traffic

NOON = datetime.fromisoformat("2025-05-24T12:30")  # a Saturday
QUAY_COUNT = 4824


def located(problem: Scenario, origin=0, destination=1, depart=NOON, **more) -> Located:
    ends = [AskedPlace("origin", origin), AskedPlace("destination", destination)]
    found = locator(problem, draw_map(problem, 0)).locate(ends, Circumstances(depart=depart, **more))
    return connected(found)


@pytest.mark.parametrize(
    ("origin", "destination", "metres"),
    [
        # the middle of a street is left by the nearer end, and entered by the nearer one
        ((50, 0), (0, 50), 100),
        ((150, 0), (250, 0), 100),
        # both on one street
        ((50, 0), (150, 0), 100),
        # and yet the way round may be shorter, or the only one: Side Lane leads up alone
        ((0, -10), (200, -10), 220),
        ((200, 20), (200, 80), 60),
        ((200, 80), (200, 20), 20 + 200 + 100 + 200 + 20),
        (4, (200, 50), 200 + 100 + 200 + 50),
    ],
)
def test_either_end_of_a_street(tiny, place, origin, destination, metres: float) -> None:
    ends = [end if isinstance(end, int) else place(*end) for end in (origin, destination)]
    found = located(tiny, *ends)
    network = found.scenario_map.network
    away = distances_to(network, np.asarray(network.length), found.ends[1].node)
    assert away[found.ends[0].node] == pytest.approx(metres, abs=0.1)


def test_ends_say_what_was_asked(tiny, place) -> None:
    origin, destination = located(tiny, place(50, 4), 2).ends
    assert (origin.asked, origin.node) == ("0.00004,0.00045", 8)
    assert (origin.latitude, origin.longitude) == pytest.approx(place(50, 0), abs=1e-7)
    assert origin.metres_away == pytest.approx(4, abs=0.01)
    assert (destination.asked, destination.node, destination.metres_away) == ("crossing 2", 2, 0)
    # by default from the first node to the last
    origin, destination = located(scenario("paper-congested"), None, None, None).ends
    assert (origin.asked, destination.asked, origin.latitude) == ("node 0", "node 35", None)


@pytest.mark.parametrize("points", [(), ((50, 0),), ((200, 20),), ((50, 0), (150, 0)), ((50, 0), (200, 20))])
def test_padding_changes_nothing(town, place, points) -> None:
    found = [Snapper(town).nearest(*place(*point)) for point in points]
    plain = split_streets(town, [5, *found])
    wide = padded(plain)
    nodes, segments = plain.network.nodes, plain.network.segments
    assert wide.network.nodes == town.nodes + SPARE_NODES
    assert wide.network.segments == len(town.street_of_segment()[0]) + SPARE_SEGMENTS
    assert len(wide.parent) == len(wide.street) == len(wide.fraction) == wide.network.segments
    for name in ("tail", "head", "length", "width"):
        np.testing.assert_array_equal(getattr(wide.network, name)[:segments], getattr(plain.network, name))
    for name in ("exit_node", "exit_segment"):
        exits = np.asarray(getattr(wide.network, name))
        np.testing.assert_array_equal(exits[:nodes], getattr(plain.network, name))
        assert (exits[nodes:] == -1).all()
    # nothing leads to what is spare
    assert np.asarray(wide.network.exit_node).max() < nodes
    assert np.asarray(wide.network.exit_segment).max() < segments
    for end in range(nodes):
        np.testing.assert_allclose(
            distances_to(wide.network, np.asarray(wide.network.length), end)[:nodes],
            distances_to(plain.network, np.asarray(plain.network.length), end),
        )


def test_current_counts_make_crowds(tiny, live) -> None:
    now = live(f"2025-05-24T11,{QUAY_COUNT}", f"2025-05-24T12,{3 * QUAY_COUNT}")
    found = located(tiny, live=now)
    assert (found.facts.sensors, found.facts.counted_sensors) == (2, 1)
    assert found.facts.expected_crowds.endswith("and go on from current counts of 1 of 2 sensors")
    # back road was not counted; the quay has three times as many as usual, at 12:30 since this very moment
    current = found.scenario_map.flow.current
    assert np.isnan(float(current.residual[0]))
    assert float(current.residual[1]) == pytest.approx(np.log(3), abs=1e-3)
    assert float(current.since) == 0
    later = located(tiny, depart=datetime.fromisoformat("2025-05-24T13:00"), live=now)
    assert float(later.scenario_map.flow.current.since) == 0.5
    before = located(tiny, live=live("2025-05-24T11,7"))
    assert float(before.scenario_map.flow.current.since) == 1


def test_departures_in_towns(tiny) -> None:
    def hour(text: str | None) -> float | None:
        return located(tiny, depart=read_departure(text)).facts.hour_of_week

    assert hour("2025-05-26T00:00") == 0
    assert hour("2025-06-01 23:59:30") == pytest.approx(168 - 30 / 3600)
    assert hour(None) == 10
    assert located(tiny, depart=None).facts.departs == "Monday 10:00"
    facts = located(tiny).facts
    assert (facts.departs, facts.departure) == ("Saturday 2025-05-24 12:30", "2025-05-24T12:30:00")


def test_departures_on_grids() -> None:
    found = located(scenario("rush-16"), depart=2.5)
    assert (found.clock, found.facts.departure_minutes, found.facts.departs) == (150, 2.5, "2.5 min after the start")
    assert located(scenario("rush-16"), depart=None).clock == 0


def test_chance_or_lights_make_futures_differ(tiny, hours) -> None:
    assert located(hours()).futures == 1
    assert located(hours(noise=(0.5, 0.3))).futures == FUTURES
    assert located(hours(traffic=Traffic())).futures == FUTURES
    assert located(tiny).futures == FUTURES


def test_what_is_synthetic_is_said(tiny) -> None:
    assert located(tiny).facts.synthetic == ""
    assert located(tiny.changed(crowding=120.0)).facts.synthetic == "demand 120 × the counts (an invented event day)"
    assert "seed" in located(scenario("rush-16"), depart=0).facts.synthetic


def refused(problem: Scenario, **asked: object) -> str:
    """The field at fault."""
    with pytest.raises(SidestepError) as caught:
        located(problem, **asked)
    assert "\n" not in str(caught.value)
    return caught.value.field


@pytest.mark.parametrize(
    ("origin", "destination", "field"),
    [
        ((50, 0), (50.3, 0), "destination"),  # the same place
        (3, (0, 100), "destination"),
        ((50, 300), (0, 0), "destination"),  # an island
        (9, 0, "origin"),
        (0, -1, "destination"),
        ((5000, 0), 0, "origin"),  # far from all streets
    ],
)
def test_ends_that_cannot_be(tiny, place, origin, destination, field: str) -> None:
    ends = [end if isinstance(end, int) else place(*end) for end in (origin, destination)]
    assert refused(tiny, origin=ends[0], destination=ends[1]) == field


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("time,the quay", "2025-05-24T10,5"),  # too early
        ("time,the quay", "2025-05-24T13,5"),  # too late
        ("time,the quey", "2025-05-24T12,5"),  # unknown sensors
        ("time,zoo", "2025-05-24T12,5"),
        ("time,the quay", "2025-05-24T12,"),  # nothing counted
        ("when,the quay", "2025-05-24T12,5"),  # no counts
    ],
)
def test_counts_of_another_place_or_time(tiny, live, header: str, row: str) -> None:
    assert refused(tiny, live=live(row, header=header)) == "live"


def test_what_cannot_be_answered(tiny, hours, slots, live) -> None:
    now = live("2025-05-24T12,5")
    grid = scenario("paper-congested")
    assert refused(tiny, destination=(91.0, 0.0)) == "destination"
    assert refused(tiny, live=now, depart=None) == "depart"  # current counts need a day
    assert refused(tiny, live=now, depart=None, field="at") == "at"
    assert refused(tiny, live="none.csv") == "live"
    for text in ("30", "nan", "9999-12-31T23:59", "2025-05-24T12:30Z", "2025-05-24T12:30+03:00"):
        assert refused(tiny, depart=read_departure(text)) == "depart"
    # tables
    for time in (datetime.fromisoformat("2025-05-24T14:00"), datetime.fromisoformat("2025-05-25T12:30"), 30.0):
        assert refused(hours(), depart=time) == "depart"
    assert refused(hours(), live=now) == "live"
    assert refused(hours(), depart=None, live=now) == "live"
    for time in (NOON, 30.0):
        assert refused(slots, depart=time) == "depart"
    # grids
    assert refused(grid, origin=(1.5, 2.5), depart=None) == "origin"
    assert refused(grid, depart=None, live=now) == "live"
    for minutes in (-1.0, 1440.0, float("nan"), float("inf"), NOON):
        assert refused(grid, depart=minutes) == "depart"
    for node in (-1, 36):
        assert refused(grid, origin=node, depart=None) == "origin"
        assert refused(grid, destination=node, depart=None) == "destination"


def test_pieces_are_as_dense_as_their_street(town, place, hours) -> None:
    whole = draw_map(hours(), 0)
    streets = split_streets(town, [Snapper(town).nearest(*place(x, 0)) for x in (50, 120)])
    pieces = whole.on_pieces(streets)
    long = np.flatnonzero(streets.parent == 0)
    assert np.asarray(pieces.network.length)[long] == pytest.approx([50, 70, 80], abs=0.01)
    assert streets.fraction[long] == pytest.approx([0.25, 0.35, 0.4], abs=1e-4)
    assert (streets.fraction[: town.streets][1:] == 1).all()
    for hour in (132.0, 133.0):
        before, after = (
            np.asarray(there.flow.expected(jnp.array([hour]), 3).density(there.network)[0]) for there in (whole, pieces)
        )
        np.testing.assert_allclose(after, before[:, streets.parent], rtol=1e-5)
    # as many persons in all
    assert float(pieces.flow.volume.sum()) == pytest.approx(float(whole.flow.volume.sum()))
