"""Where sensors, origins and destinations are on the streets of a town, and which towns can be walked."""

import numpy as np
import pytest

from sidestep.network.formats import load_helsinki
from sidestep.network.graph import road_network
from sidestep.network.snapping import Snapper
from sidestep.scenarios.builtin import AUCKLAND_SENSORS
from sidestep.scenarios.places import Sensor
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.stations import APART, check_ways, crossings, stations

TOWN = load_helsinki()
NETWORK, SNAPPER = TOWN.network(), Snapper(TOWN)


def test_sensors_without_a_place_are_drawn() -> None:
    first = stations(SNAPPER, NETWORK, AUCKLAND_SENSORS, 0)
    np.testing.assert_array_equal(first, stations(SNAPPER, NETWORK, AUCKLAND_SENSORS, 0))
    other = stations(SNAPPER, NETWORK, AUCKLAND_SENSORS, 1)
    assert len(set(first.tolist()) & set(other.tolist())) < len(first) / 2
    position = np.asarray(NETWORK.position)
    for found in (first, other):
        assert len(set(found.tolist())) == len(AUCKLAND_SENSORS)
        assert not {TOWN.kind[street] for street in found} & {"steps"}
        middle = (position[TOWN.tail[found]] + position[TOWN.head[found]]) / 2
        apart = np.hypot(*(middle[:, None] - middle).transpose(2, 0, 1))
        assert apart[~np.eye(len(found), dtype=bool)].min() >= APART


def test_more_sensors_than_room_stand_closer() -> None:
    many = tuple(Sensor(name=str(number)) for number in range(400))
    assert len(set(stations(SNAPPER, NETWORK, many, 0).tolist())) == 400
    too_many = tuple(Sensor(name=str(number)) for number in range(TOWN.streets + 1))
    with pytest.raises(ScenarioError, match=f"there are {TOWN.streets + 1} sensors, but {TOWN.streets} streets"):
        stations(SNAPPER, NETWORK, too_many, 0)
    with pytest.raises(ScenarioError, match=f"there are 400 sensors on 2800 streets, but {TOWN.streets} streets"):
        stations(SNAPPER, NETWORK, many * 7, 0)


def test_sensors_with_a_place_stand_there() -> None:
    longitude, latitude = TOWN.course(321).mean(axis=0).tolist()
    here = (latitude + 1e-5, longitude)
    three = (Sensor(name="a"), Sensor(name="b", place=here), Sensor(name="c"))
    found = stations(SNAPPER, NETWORK, three, 5)
    assert found[1] == SNAPPER.nearest(*here).street
    assert len(set(found.tolist())) == 3
    with pytest.raises(ScenarioError, match="'far'") as caught:
        stations(SNAPPER, NETWORK, (Sensor(name="far", place=(60.5, 25.0)),), 5)
    assert caught.value.field == "sensors"


def test_places_are_taken_to_the_nearest_crossing() -> None:
    longitude, latitude = TOWN.place[321].tolist()
    assert crossings(SNAPPER, "origins", (4, (latitude, longitude))) == (4, 321)
    for waypoints in ((321, (latitude, longitude)), (TOWN.nodes,), ((48.2, 16.4),)):
        with pytest.raises(ScenarioError) as caught:
            crossings(SNAPPER, "origins", waypoints)
        assert caught.value.field == "origins"


def one_way(*ways: tuple[int, int]):
    nodes = 1 + max(max(way) for way in ways)
    place = np.stack([np.arange(nodes), np.zeros(nodes)], axis=1)
    return road_network(place, [a for a, _ in ways], [b for _, b in ways], [1.0] * len(ways))


def test_paths_that_are_missing() -> None:
    ring, sink = one_way((0, 1), (1, 2), (2, 0)), one_way((0, 1), (1, 0), (1, 2))
    check_ways(ring, (), ())
    check_ways(ring, (0,), (2, 1))
    with pytest.raises(ScenarioError, match="crossing 1 is the only origin") as caught:
        check_ways(ring, (1,), (2, 1))
    assert caught.value.field == "destinations"
    check_ways(sink, (0,), (2,))
    # Who walks from 0 to 1 may stray to 2, from where nothing leads on.
    for origins, destinations, message in (
        ((0,), (1,), "from crossing 2 to crossing 1"),
        ((), (0,), "from crossing 2 to crossing 0"),
        ((), (), "from crossing 2 to crossing 0"),
        ((0,), (), "from crossing 2 to crossing 0"),
    ):
        with pytest.raises(ScenarioError, match=message):
            check_ways(sink, origins, destinations)
    islands = one_way((0, 1), (1, 0), (2, 3), (3, 2))
    check_ways(islands, (0,), (1,))
    with pytest.raises(ScenarioError, match="from crossing 0 to crossing 3"):
        check_ways(islands, (0,), (3,))
    with pytest.raises(ScenarioError, match="from crossing 0 to crossing 2"):
        check_ways(islands, (0, 1), ())


def test_restricted_areas_are_no_place_to_stray(make_town, block) -> None:
    check_ways(block(restricted=True).network(), (), ())
    # 0 and 1; from 0 a restricted one-way street to 2, from where nothing leads on.
    ends, restricted = [(0, 1), (0, 2)], np.array([False, True])
    town = make_town([(0, 0), (100, 0), (0, 50)], ends, restricted=restricted, one_way=restricted)
    network = town.network()
    check_ways(network, (0,), (1,))
    check_ways(network, (0, 1), (2,))
    for origins, destinations, message in (((), (1,), "from crossing 2 to crossing 1"), ((0,), (), "from crossing 2")):
        with pytest.raises(ScenarioError, match=message):
            check_ways(network, origins, destinations)
    # Nor are streets that are never open a way.
    shut = make_town([(0, 0), (100, 0), (0, 50)], ends, opening=("", "off")).network()
    with pytest.raises(ScenarioError, match="crossing 2"):
        check_ways(shut, (0,), (2,))
    check_ways(shut, (0,), (1,))
