"""Specs: strict, frozen, hashable, checked again when changed, and refused with the field at fault."""

import copy
import json
import pickle

import pytest

from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec, Scenario
from sidestep.scenarios.places import Counters, CrowdTable, Grid, Light, RushHours, Sensor, Traffic, Venue
from sidestep.scenarios.spec import ScenarioError, faults

LIGHT = dict(name="gate", place=(60.0, 25.0), cycle=60.0, green=20.0, offset=0.0)
NAN, INFINITE = float("nan"), float("inf")


def refused(make, **values) -> list[str | None]:
    """The fields that are said to be wrong."""
    with pytest.raises(ScenarioError) as caught:
        make(**values)
    for error in (caught.value, *caught.value.others):
        assert "\n" not in str(error)
        assert error.field is None or str(error).startswith(error.field)
    return [caught.value.field, *(error.field for error in caught.value.others)]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        (dict(side=1), "side"),
        (dict(side=-6), "side"),
        (dict(side=6.0), "side"),
        (dict(side=True), "side"),
        (dict(crowded_nodes=-1), "crowded_nodes"),
        (dict(crowded_nodes=35), "crowded_nodes"),
        (dict(side=2, crowded_nodes=3), "crowded_nodes"),
        (dict(lengths=(100.0, INFINITE)), "lengths"),
        (dict(lengths=[100.0, 200.0]), "lengths"),
        (dict(lengths=(100.0, 200.0, 300.0)), "lengths"),
        (dict(volumes=(-5.0, 5.0)), "volumes"),
        (dict(volumes=(1000.0, 200.0)), "volumes"),
        (dict(crowded_volume=(NAN, 1.0)), "crowded_volume"),
        (dict(crowded_volume=(5000.0, -1.0)), "crowded_volume"),
        (dict(larger=(8,)), "larger"),
        (dict(larger=(1,), training_maps=2), "larger"),
        (dict(training_maps=-1), "training_maps"),
        (dict(rush="hours"), "rush"),
    ],
)
def test_grids_refuse(changes: dict, field: str) -> None:
    assert refused(Grid, **changes) == [field]
    assert refused(BUILT_IN["paper-congested"].changed, **changes) == [field]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        (dict(amplitude=(0.8, 0.2)), "amplitude"),
        (dict(period=0.0), "period"),
        (dict(phi=1.0), "phi"),
        (dict(phi=-0.1), "phi"),
        (dict(sigma=-0.1), "sigma"),
        (dict(shifting=1), "shifting"),
    ],
)
def test_rush_hours_refuse(changes: dict, field: str) -> None:
    assert refused(RushHours, **changes) == [field]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        (dict(crowding=0.0), "crowding"),
        (dict(crowding=NAN), "crowding"),
        (dict(days=()), "days"),
        (dict(days=(1, 7)), "days"),
        (dict(days=(1, 1)), "days"),
        (dict(hours=(20, 10)), "hours"),
        (dict(hours=(10, 10)), "hours"),
        (dict(hours=(10, 25)), "hours"),
        (dict(hours=(-1, 5)), "hours"),
        (dict(origins=(-1,)), "origins"),
        (dict(origins=(3, 3)), "origins"),
        (dict(origins=(True,)), "origins"),
        (dict(origins=("3",)), "origins"),
        (dict(origins=((60.0,),)), "origins"),
        (dict(destinations=((91.0, 25.0),)), "destinations"),
        (dict(streets=""), "streets"),
        (dict(streets="a\nb"), "streets"),
        (dict(traffic=90.0), "traffic"),
        (dict(crowd_source="auckland"), "crowd_source"),
    ],
)
def test_venues_refuse(changes: dict, field: str) -> None:
    assert refused(Venue, **changes) == [field]
    assert refused(BUILT_IN["helsinki"].changed, **changes) == [field]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        (dict(reach=-1.0), "reach"),
        (dict(reach=INFINITE), "reach"),
        (dict(uneven=-0.1), "uneven"),
        (dict(pairing=-1), "pairing"),
        (dict(pairing=2**63), "pairing"),
        (dict(streets_per_sensor=0), "streets_per_sensor"),
        (dict(streets_per_sensor=101), "streets_per_sensor"),
        (dict(streets_per_sensor=2, sensors=(Sensor(name="a", place=(60.0, 25.0)),)), "streets_per_sensor"),
        (dict(sensors=(Sensor(name="a"), Sensor(name="b"), Sensor(name="b"))), "sensors"),
        (dict(sensors=("a",)), "sensors"),
        (dict(fitted=("2024-01-01", "2025-03-10T01")), "tested"),
        (dict(tested=("2024-12-31T23", "2025-06-01")), "tested"),
        (dict(fitted=("2024-02-01", "2024-02-01")), "fitted"),
        (dict(fitted=("2024-02-01T00:30", "2024-03-01")), "fitted"),
        (dict(fitted=("2024-02-01T00+01:00", "2024-03-01")), "fitted"),
        (dict(file=" "), "file"),
    ],
)
def test_counters_refuse(changes: dict, field: str) -> None:
    assert refused(Counters, **changes) == [field]
    assert refused(BUILT_IN["helsinki"].changed, **{"streets_per_sensor": 1} | changes) == [field]


def test_periods_have_one_spelling() -> None:
    assert Counters(tested=("2025-03-10T00:00:00", "2025-06-01T06:00")).tested == ("2025-03-10", "2025-06-01T06")
    assert refused(Counters, tested=("soon", "later")) == ["tested", "tested"]


@pytest.mark.parametrize(
    ("make", "values", "field"),
    [
        (CrowdTable, dict(file="x.npz", noise=(1.0, 0.1)), "noise"),
        (CrowdTable, dict(file="x.npz", noise=(0.5, -0.1)), "noise"),
        (CrowdTable, dict(file="x.npz", reach=40.0), "reach"),
        (CrowdTable, dict(), "file"),
        (Counters, dict(noise=(0.5, 0.1)), "noise"),
        (Sensor, dict(name="a", place=(60.0, 181.0)), "place"),
        (Traffic, dict(cycle=0.0), "cycle"),
        (Traffic, dict(cycle=601.0), "cycle"),
        (Traffic, dict(cycle=20.0), "green"),
        (Traffic, dict(green=91.0), "green"),
        (Traffic, dict(seed=-1), "seed"),
        (Traffic, dict(critical_gap=21.0), "critical_gap"),
        (Traffic, dict(vehicles=1801.0), "vehicles"),  # of 4 in each gap of 8 s
        (Traffic, dict(vehicles=-1.0), "vehicles"),
        (Light, LIGHT | dict(offset=60.0), "offset"),
        (Light, LIGHT | dict(green=61.0), "green"),
        (ObjectiveSpec, dict(exposure=-1.0), "exposure"),
        (ObjectiveSpec, dict(exposure=101.0), "exposure"),
        (ObjectiveSpec, dict(time=NAN), "time"),
        (ObjectiveSpec, dict(max_density=0.0), "max_density"),
        (ObjectiveSpec, dict(time=0.0), None),
        (RewardSpec, dict(unit_seconds=0.0), "unit_seconds"),
        (RewardSpec, dict(bonus=INFINITE), "bonus"),
    ],
)
def test_others_refuse(make, values: dict, field: str | None) -> None:
    assert refused(make, **values) == [field]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        (dict(horizon=0.0), "horizon"),
        (dict(horizon=NAN), "horizon"),
        (dict(slot_seconds=-300.0), "slot_seconds"),
        (dict(slot_seconds=1.0), "slot_seconds"),  # 86,400 slots
        (dict(departures=(600.0, 300.0)), "departures"),
        (dict(departures=(-1.0, 300.0)), "departures"),
        (dict(maps=0), "maps"),
        (dict(walks=0), "walks"),
        (dict(name=""), "name"),
        (dict(summary="a\nb"), "summary"),
        (dict(flows="real"), "flows"),
        (dict(law="aoki"), "law"),
        (dict(law="power", place=Venue()), "law"),  # without people it has no speed
        (dict(rule="exit"), "rule"),
        (dict(level="hindsight"), "level"),
        (dict(objective=None), "objective"),
        (dict(place=None), "place"),
    ],
)
def test_scenarios_refuse(changes: dict, field: str) -> None:
    assert refused(Scenario, **{"name": "here"} | changes) == [field]
    assert refused(BUILT_IN["paper-congested"].changed, **changes) == [field]


def test_all_mistakes_are_said_at_once() -> None:
    assert refused(Grid, side=1, lengths=(2.0, 1.0), colour="red") == ["side", "lengths", "colour"]
    # No rule is asked that depends on a field that is wrong itself.
    assert refused(Grid, side=1, crowded_nodes=10**6) == ["side"]


def test_fields_of_specs_in_specs_are_dotted() -> None:
    tags = dict(kind="venue", crowd_source=dict(kind="counters", reach=-1.0, sensors=(dict(name=3),)), traffic=3)
    found = refused(Scenario, name="x", law="weidmann", place=tags, reward=dict(bonus="x"))
    assert found == ["place.crowd_source.sensors.name", "place.crowd_source.reach", "place.traffic", "reward.bonus"]
    assert refused(Scenario, name="x", place=dict(kind="zoo")) == ["place.kind"]
    assert refused(Scenario, name="x", place=dict(side=3)) == ["place.kind"]


def test_changes_reach_the_place_and_its_crowd_source() -> None:
    helsinki = BUILT_IN["helsinki"]
    changed = helsinki.changed(walks=3, crowding=2.0, reach=50.0)
    assert (changed.walks, changed.place.crowding, changed.place.crowd_source.reach) == (3, 2.0, 50.0)
    assert changed.place.crowd_source.sensors == helsinki.place.crowd_source.sensors
    assert (helsinki.walks, helsinki.place.crowding) == (500, 120.0)
    assert changed.changed(walks=500, crowding=120.0, reach=40.0) == helsinki
    assert helsinki.changed() == helsinki
    tabled = helsinki.changed(crowd_source=CrowdTable(file="x.npz"))
    assert tabled.changed(noise=(0.5, 0.1)).place.crowd_source == CrowdTable(file="x.npz", noise=(0.5, 0.1))
    both = BUILT_IN["rush-16"].changed(place=Grid(side=5), crowded_nodes=2)
    assert both.place == Grid(side=5, crowded_nodes=2)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("rush-16", dict(crowding=2.0)),
        ("rush-16", dict(streets="helsinki")),
        ("helsinki", dict(side=3)),
        ("helsinki", dict(noise=(0.5, 0.1))),
        ("helsinki", dict(colour="red")),
    ],
)
def test_unknown_fields_are_refused(name: str, changes: dict) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(name, **changes)
    assert caught.value.field == next(iter(changes))
    assert str(caught.value).startswith(f"{name}, ")


def test_hints() -> None:
    for field, close in (("crowded_nods", "crowded_nodes"), ("Side", "side"), ("horizont", "horizon")):
        with pytest.raises(ScenarioError, match=f"did you mean {close}"):
            BUILT_IN["rush-16"].changed(**{field: 3})
    with pytest.raises(ScenarioError, match="did you mean reach"):
        Counters(reahc=3.0)


@pytest.mark.parametrize("name", BUILT_IN)
def test_specs_come_back_from_json_and_pickle(name: str) -> None:
    one = BUILT_IN[name]
    if one.place.anywhere:
        sensors = (Sensor(name="a", place=(1.0, 2.0)), Sensor(name="b"))
        one = one.changed(sensors=sensors, streets_per_sensor=1, origins=(3, (60.0, 25.0)))
    text = json.dumps(one.model_dump())
    for back in (Scenario.model_validate_json(text), pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):  # noqa: S301
        assert back == one
        assert hash(back) == hash(one)
        assert back != one.changed(walks=one.walks + 1)


def test_specs_are_frozen() -> None:
    for one, field in ((BUILT_IN["helsinki"], "walks"), (BUILT_IN["helsinki"].place, "crowding")):
        with pytest.raises(ValueError, match="frozen"):
            setattr(one, field, 3)


def test_damaged_json_is_not_a_scenario() -> None:
    fields = BUILT_IN["helsinki"].model_dump()
    for damage, path in (
        ({"colour": "red"}, ("colour",)),
        ({"departures": [1.0]}, ("departures",)),
        ({"name": {"x": 1}}, ("name",)),
        ({"horizon": [1]}, ("horizon",)),
        ({"horizon": "60"}, ("horizon",)),
        ({"place": {"kind": "grid", "crowding": 2.0}}, ("place", "crowding")),
    ):
        with pytest.raises(ValueError, match="validation error") as caught:
            Scenario.model_validate_json(json.dumps(fields | damage))
        assert [fault.path for fault in faults(caught.value, Scenario)][-1] == path
