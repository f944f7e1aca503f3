"""Means over trainings, with intervals over trainings and over walks."""

import json

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from sidestep.evaluation.compare import Comparison
from sidestep.evaluation.metrics import Record
from sidestep.evaluation.trainings import mean_rows, over_trainings, student_interval
from sidestep.scenarios.builtin import BUILT_IN

PLANNERS = ("shortest-path", "expected", "clairvoyant", "darp")


def test_intervals_are_those_of_a_t_test() -> None:
    values = [3.0, 4.5, 5.0, 9.0]
    assert student_interval(values) == pytest.approx(list(ttest_1samp(values, 0.0).confidence_interval(0.95)))


def test_one_value_has_no_interval() -> None:
    assert student_interval([3.0]) is None


def compared(seed: int, planners: tuple[str, ...] = PLANNERS) -> Comparison:
    """A training with ten walks."""
    rng = np.random.default_rng(seed)
    minutes = {name: seed + 60.0 + 10 * rng.random((1, 10)) for name in planners}
    records = {name: Record("map", found, np.ones((1, 10), bool), 2 * found) for name, found in minutes.items()}
    return Comparison(BUILT_IN["rush-16"], (0,), 10, seed, records)


def test_intervals_over_trainings_and_over_walks() -> None:
    trainings = [compared(seed) for seed in range(3)]
    row = over_trainings(trainings)["darp"]
    minutes, cost, other = (
        np.array([getattr(each.records[who], what) for each in trainings])
        for who, what in (("darp", "minutes"), ("darp", "cost"), ("expected", "cost"))
    )
    assert row["trainings"] == 3
    assert row["mean_minutes"] == pytest.approx(minutes.mean())
    assert row["ci95"] == pytest.approx(student_interval(minutes.mean(axis=(1, 2))))
    assert row["ci95_walks"] == pytest.approx(student_interval(minutes))
    assert row["difference_ci95"] == pytest.approx(student_interval((cost - other).mean(axis=(1, 2))))
    assert row["difference_ci95_walks"] == pytest.approx(student_interval(cost - other))


def test_an_agent_that_is_missing_in_a_training_is_set_against_the_others_there() -> None:
    rows = over_trainings([compared(0), compared(1, PLANNERS[:3]), compared(2)])
    alone = over_trainings([compared(0), compared(2)])
    assert rows["darp"] == alone["darp"]
    assert rows["expected"]["trainings"] == 3


def test_a_number_that_one_training_lacks_is_none() -> None:
    results = [compared(seed).to_json() for seed in range(2)]
    results[1]["planners"]["darp"]["saving_vs_shortest_path"] = None
    rows = mean_rows(results)
    assert rows["darp"]["saving_vs_shortest_path"] is None
    assert rows["expected"]["saving_vs_shortest_path"] is not None


def test_records_are_the_same_read_back() -> None:
    record = compared(0).records["darp"]
    record = Record("live", record.minutes, record.arrived, record.cost, {"metres": 3 * record.cost})
    again = Record.of_json(json.loads(json.dumps(record.to_json())))
    assert again.level == record.level
    for name in ("minutes", "arrived", "cost"):
        np.testing.assert_array_equal(getattr(again, name), getattr(record, name), strict=True)
    np.testing.assert_array_equal(again.totals["metres"], record.totals["metres"], strict=True)
