"""Scenarios as a whole, and what walkers keep low."""

import pytest

from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec, objective_of, reward_of
from sidestep.scenarios.places import CrowdTable


@pytest.mark.parametrize(
    ("changes", "slots"),
    [
        (dict(horizon=1000.0), 4),  # three slots of 300 s and a third
        (dict(horizon=900.0), 3),
        (dict(horizon=10.0), 1),
        (dict(horizon=3600.0, departures=(0.0, 1800.0)), 18),  # an hour and a half
        (dict(horizon=3600.0, slot_seconds=60.0), 60),
    ],
)
def test_a_part_of_a_slot_is_a_slot(changes: dict, slots: int) -> None:
    assert scenario("paper-congested", **changes).slots == slots


def test_what_moves_the_crowds() -> None:
    tabled = scenario("helsinki", crowd_source=CrowdTable(file="crowds.npz"))
    for problem, moved in (
        (scenario("paper-congested"), "arima"),
        (scenario("rush-16"), "rush"),
        (scenario("helsinki"), "sensors"),
        (tabled, "table"),
    ):
        assert problem.crowd_model == moved
        assert problem.changed(flows="forecast").crowd_model == "forecast"


def test_time_alone_is_the_neutral_objective() -> None:
    assert all(one.objective == ObjectiveSpec() for one in BUILT_IN.values())
    assert ObjectiveSpec(time=1).is_time
    assert ObjectiveSpec().to_json() is None
    for weights in (dict(exposure=0.5), dict(time=2.0), dict(max_density=4.0), dict(measured=True)):
        objective = ObjectiveSpec(**weights)
        assert not objective.is_time
        weights.pop("measured", None)
        assert objective.to_json() == {"time": 1.0, "distance": 0.0, "exposure": 0.0, "max_density": None} | weights


def test_objectives_and_rewards_as_environments_have_them() -> None:
    found = objective_of(ObjectiveSpec(exposure=0.5, max_density=4.0))
    assert (found.time, found.distance, found.exposure, found.max_density) == (1, 0, 0.5, 4)
    reward = reward_of(RewardSpec(unit_seconds=30.0, progress=0.25, bonus=2.0))
    assert (reward.unit_seconds, reward.progress, reward.bonus) == (30, 0.25, 2)
