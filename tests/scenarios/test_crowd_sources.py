"""Crowds of venues from counters: where they are counted, and in which weeks walks are tested."""

import numpy as np
import pytest

from sidestep.crowds.profile import hour_of_week
from sidestep.crowds.sensor_model import fit_sensors, recorded_weeks
from sidestep.network.snapping import Snapper
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.crowd_sources import counts_of
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.places import Grid
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import stations
from sidestep.scenarios.streets import attribution_of, town_of
from sidestep.walking.speed_laws import FREE_SPEED

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))
COUNTERS = HELSINKI.place.crowd_source
NAMES = [sensor.name for sensor in COUNTERS.sensors]


@pytest.fixture(scope="module")
def place():
    return draw_map(HELSINKI, 1)


def test_the_town_has_its_streets_and_crowds(place) -> None:
    town = town_of("helsinki")
    assert (place.network.nodes, place.parts) == (town.nodes, (town.nodes,))
    assert place.flow.model.expected.shape == (168, 160)  # 16 sensors, on ten streets each
    assert place.sensors == tuple(NAMES) * 10
    weight = np.asarray(place.flow.weights.weight)
    assert weight.shape == (place.network.segments, 4)
    assert weight.sum(axis=1).max() <= 1 + 1e-6
    # Of each person an hour 1 / (3,600 s * 1.34 m/s * width) are on a square metre, 120 times.
    segment = stations(Snapper(town), place.network, COUNTERS.sensors * 10, COUNTERS.pairing)
    width = np.asarray(place.network.width)[segment]
    np.testing.assert_allclose(place.flow.per_count, 120 / (3600 * FREE_SPEED * width), rtol=1e-6)
    assert attribution_of(HELSINKI.place) == town.attribution
    assert attribution_of(Grid()) == ""


def test_walks_are_tested_in_weeks_that_were_not_fitted(place) -> None:
    fitted, tested = (counts_of("auckland").between(*period) for period in (COUNTERS.fitted, COUNTERS.tested))
    assert {str(time)[:4] for time in fitted.times} == {"2024"}
    assert {str(time)[:4] for time in tested.times} == {"2025"}
    assert place.flow_for("learn").record is place.flow_for("explore").record is None
    record = np.asarray(place.flow_for("test").record)
    # On its first street each sensor has its own weeks; on the tenth those nine tenths of eleven weeks, nine, later.
    alone = recorded_weeks(fit_sensors(fitted, NAMES), tested, NAMES)
    assert alone.shape == (11, 168, 16)
    np.testing.assert_array_equal(record[..., :16], alone)
    np.testing.assert_array_equal(record[0, :, 144:], alone[9])
    # The second week's Wednesday noon: Monday, 10 March 2025 and 9 days.
    noon = np.datetime64("2025-03-19T12", "h")
    (row,) = np.flatnonzero(tested.times == noon)
    assert hour_of_week(tested.times)[row] == 60
    counts = np.expm1(record[1, 60] + np.asarray(place.flow.model.expected)[60])[:16]
    np.testing.assert_allclose(counts, [tested.series(name)[row] for name in NAMES], rtol=1e-3)


def test_more_streets_than_recorded_weeks() -> None:
    with pytest.raises(ScenarioError, match="at most 11, the recorded weeks") as caught:
        draw_map(HELSINKI.changed(streets_per_sensor=12), 0)
    assert caught.value.field == "place.crowd_source.streets_per_sensor"
