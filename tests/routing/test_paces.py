"""What is expected is worked out once for each hour, and holds on pieces of streets."""

import numpy as np

from sidestep.network.snapping import StreetPoint, split_streets
from sidestep.routing.paces import Paces
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.expectation import expected_pace
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.streets import town_of

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))


def test_each_hour_is_worked_out_once() -> None:
    small = scenario("paper-congested", side=3, crowded_nodes=1, horizon=1800.0)
    paces = Paces(draw_map(small, 0))
    first = paces.at(small, 0.0)
    assert first.shape == (24, 6)
    assert paces.at(small, 0.0) is first
    assert paces.at(small, 1.0) is not first
    assert paces.at(small.changed(flows="forecast"), 0.0) is None


def test_pieces_are_as_slow_as_their_streets() -> None:
    whole = draw_map(HELSINKI, 0)
    split = split_streets(town_of(HELSINKI.place.streets), [StreetPoint(40, 0.3, 0.0, (0.0, 0.0))])
    paces = [np.asarray(expected_pace(HELSINKI, each, 17.0)) for each in (whole, whole.on_pieces(split))]
    np.testing.assert_allclose(paces[1], paces[0][np.asarray(split.parent)], rtol=1e-3)
