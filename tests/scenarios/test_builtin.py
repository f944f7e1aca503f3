"""Which scenarios there are, by name."""

import pytest

from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.places import Grid, RushHours, Traffic
from sidestep.scenarios.spec import ScenarioError


def test_the_papers_scenarios() -> None:
    unblocked, congested = BUILT_IN["paper-unblocked"], BUILT_IN["paper-congested"]
    for one in (unblocked, congested):
        assert (one.place.side, one.place.lengths, one.place.volumes) == (6, (100, 1000), (200, 1000))
        assert (one.law, one.rule, one.slot_seconds) == ("power", "integrated", 300)
        assert one.slots == one.horizon / 300
    assert (unblocked.place.crowded_nodes, congested.place.crowded_nodes) == (0, 4)
    assert congested.place.crowded_volume == (5000, pytest.approx(31.6227766))  # the root of 1000
    assert all(name == one.name for name, one in BUILT_IN.items())


def test_scenarios_of_rush_hours() -> None:
    rush, shifting, unseen = (BUILT_IN[name] for name in ("rush-16", "shifting-crowds", "unseen-maps"))
    assert rush.place == Grid(side=16, crowded_nodes=28, crowded_volume=(5000.0, 1000.0), rush=RushHours())
    assert rush.changed(side=32, crowded_nodes=114).place == BUILT_IN["rush-32"].place
    assert shifting.place == rush.place.changed(rush=RushHours(shifting=True))
    assert (unseen.place.sides, unseen.maps, unseen.place.training_maps) == ((10, 14, 18), 12, 32)
    assert [one.level for one in (rush, shifting, unseen)] == ["local", "local", "map"]
    assert [one.horizon / 3600 for one in (rush, BUILT_IN["rush-32"], shifting, unseen)] == [6, 12, 8, 6]
    for one in (rush, shifting, unseen):
        assert (one.law, one.reward.progress, one.reward.bonus) == ("power-capped", 0, 0)
        assert one.departures == (0, 3600)


def test_helsinki() -> None:
    helsinki, signals = BUILT_IN["helsinki"], BUILT_IN["helsinki-signals"]
    source = helsinki.place.crowd_source
    assert (helsinki.place.crowding, source.uneven, source.reach, source.streets_per_sensor) == (120, 0.5, 40, 10)
    assert len(source.sensors) == 16
    assert helsinki.changed(traffic=Traffic()).place == signals.place
    assert (helsinki.law, helsinki.level, helsinki.horizon) == ("weidmann", "map", 3 * 3600)


def test_fields_may_be_changed() -> None:
    changed = scenario("paper-unblocked", side=3, law="weidmann")
    assert (changed.place.side, changed.law) == (3, "weidmann")
    assert BUILT_IN["paper-unblocked"].place.side == 6
    assert scenario("helsinki", law="power-capped").law == "power-capped"


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("paper-congestd", "; did you mean paper-congested, or a file such as my-town/scenario.toml?"),
        ("unblocked", "; did you mean paper-unblocked, or a file"),
        ("zoo", "; choose from paper-unblocked, paper-congested"),
    ],
)
def test_unknown_names(name: str, hint: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(name)
    assert repr(name) in str(caught.value)
    assert hint in str(caught.value)
