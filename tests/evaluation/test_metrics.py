"""Means, savings, gaps and their intervals, by hand."""

import numpy as np
import pytest

from sidestep.evaluation.metrics import (
    HEADINGS,
    PAPER_COLUMNS,
    TEXT_COLUMNS,
    Record,
    cells,
    join_records,
    markdown_table,
    spread,
    summarise,
)
from sidestep.planners.registry import BASELINE, BOUND, REFERENCE


def record(minutes: list[list[float]], arrived: list[list[bool]] | None = None, level: str = "map") -> Record:
    times = np.array(minutes, float)
    return Record(level, times, np.ones(times.shape, bool) if arrived is None else np.array(arrived), times)


# Means by map: 110 and 90 by the shortest path, 60 and 40 in hindsight, 80 and 50 by what is expected.
SHORTEST = record([[100, 120], [80, 100]])
BEST = record([[50, 70], [40, 40]], level="hindsight")
EXPECTED = record([[70, 90], [50, 50]])


def rows(seed: int = 0, by: float | None = None, **records: Record) -> dict:
    return summarise({REFERENCE: SHORTEST, BOUND: BEST, BASELINE: EXPECTED} | records, seed, by)


def against(one: Record, **records: Record) -> dict:
    """Rows where all three references walk alike."""
    return summarise({REFERENCE: one, BOUND: one, BASELINE: one} | records)


def test_names_of_the_references() -> None:
    assert (REFERENCE, BOUND, BASELINE) == ("shortest-path", "clairvoyant", "expected")


def test_by_hand() -> None:
    # maps: 66 and 66
    row = rows(mine=record([[55, 77], [66, 66]], level="position"))["mine"]
    assert row["mean_minutes"] == pytest.approx(66)
    assert row["saving_vs_shortest_path"] == pytest.approx(1 - 66 / 100)
    assert row["best_saving"] == pytest.approx(1 - 66 / 110)  # on the other map it is 1 - 66/90
    assert row["gap"] == pytest.approx(66 / 50 - 1)
    assert row["regret_minutes"] == pytest.approx(66 - 50)
    assert (row["level"], row["maps"], row["arrival_rate"]) == ("position", 2, 1)
    assert "mean_cost_minutes" not in row  # time is all that counts
    # both maps alike: no matter which are drawn
    assert row["ci95"] == pytest.approx([66, 66])
    # two maps drawn again from 60 and 40: means of 40, 50, 50 or 60
    assert row["gap_ci95"] == pytest.approx([66 / 60 - 1, 66 / 40 - 1])


def test_references_are_rows_too() -> None:
    shortest, best = rows()[REFERENCE], rows()[BOUND]
    assert (shortest["saving_vs_shortest_path"], shortest["best_saving"]) == (0, 0)
    assert shortest["gap"] == pytest.approx(1)  # 100 against 50
    assert best["saving_vs_shortest_path"] == pytest.approx(0.5)
    assert best["best_saving"] == pytest.approx(1 - 40 / 90)
    assert best["level"] == "hindsight"


def test_identical_planners_have_no_gap_in_any_resample() -> None:
    row = rows(mine=record(BEST.minutes.tolist()))["mine"]
    assert row["gap"] == 0
    assert row["gap_ci95"] == [0, 0]
    assert row["ci95"][0] < row["ci95"][1]


def test_ratios_are_paired() -> None:
    # Maps differ a hundredfold, but on each the planner takes a tenth longer: paired, there is nothing to doubt.
    rng = np.random.default_rng(0)
    best = rng.uniform(1, 100, (30, 4))
    row = against(record(best.tolist()), mine=record(1.1 * best))["mine"]
    assert row["gap_ci95"] == pytest.approx([0.1, 0.1])
    assert row["ci95"][1] - row["ci95"][0] > 10


def test_the_interval_contains_the_mean_and_is_as_wide_as_it_should_be() -> None:
    minutes = np.random.default_rng(3).normal(80, 10, (100, 5))
    maps = minutes.mean(axis=1)
    row = against(record(minutes))[REFERENCE]
    low, high = row["ci95"]
    assert row["mean_minutes"] == pytest.approx(minutes.mean())
    assert low < minutes.mean() < high
    # 1.96 standard errors of a hundred maps' means each way; not of five hundred walks
    assert (high - low) / 2 == pytest.approx(1.96 * maps.std() / 10, rel=0.1)
    assert low == pytest.approx(minutes.mean() - 1.96 * maps.std() / 10, abs=0.15)


def test_constant_times_leave_no_doubt() -> None:
    row = rows(mine=record([[70, 70], [70, 70]]))["mine"]
    assert row["ci95"] == [70, 70]


def test_with_several_maps_whole_maps_are_resampled() -> None:
    # Walks differ, maps do not.
    row = rows(mine=record([[10, 90], [90, 10]]))["mine"]
    assert row["ci95"] == pytest.approx([50, 50])


def test_with_one_map_its_walks_are_resampled() -> None:
    shortest, best = record([[100, 100, 100, 100]]), record([[50, 50, 50, 50]])
    mine = record([[60, 80, 60, 80]])
    row = summarise({REFERENCE: shortest, BOUND: best, BASELINE: shortest, "mine": mine})["mine"]
    assert row["mean_minutes"] == 70
    assert row["best_saving"] == pytest.approx(0.4)  # the best walk
    # Four draws of 60 or 80: all alike with probability 1/8, so 2.5 % lie at 60 and 2.5 % at 80.
    assert row["ci95"] == [60, 80]
    assert row["gap_ci95"] == pytest.approx([0.2, 0.6])
    assert row["maps"] == 1


def test_a_row_with_fewer_maps_is_compared_on_those() -> None:
    # On map 0 alone: 110 by the shortest path, 60 in hindsight.
    row = rows(mine=record([[66, 66]]))["mine"]
    assert row["maps"] == 1
    assert row["saving_vs_shortest_path"] == pytest.approx(1 - 66 / 110)
    assert row["gap"] == pytest.approx(0.1)
    assert rows(mine=record([[66, 66]]))[REFERENCE]["maps"] == 2
    # one map: its walks, 50 and 70 in hindsight
    assert row["gap_ci95"] == pytest.approx([66 / 70 - 1, 66 / 50 - 1])


def test_walks_that_did_not_arrive_count_as_the_horizon() -> None:
    # minutes hold the horizon of 1440 already; nothing is dropped
    row = rows(mine=record([[60, 1440], [60, 60]], [[True, False], [True, True]]))["mine"]
    assert row["mean_minutes"] == pytest.approx((750 + 60) / 2)
    assert row["arrival_rate"] == 0.75
    assert row["gap"] == pytest.approx(405 / 50 - 1)
    assert row["saving_vs_shortest_path"] == pytest.approx(1 - 405 / 100)


def test_nothing_is_saved_against_a_shortest_path_that_did_not_arrive() -> None:
    # On map 1 one walk of the shortest path did not arrive: there is no time to save, neither in the mean nor at best.
    lost = record(SHORTEST.minutes.tolist(), [[True, True], [False, True]])
    found = summarise({REFERENCE: lost, BOUND: BEST, BASELINE: EXPECTED, "first": record([[66, 66]])})
    for name in (REFERENCE, BOUND, BASELINE):
        assert (found[name]["saving_vs_shortest_path"], found[name]["best_saving"]) == (None, None)
        assert list(cells(name, found[name], 2, ("saved", "best map")).values()) == ["–", "–"]
    # A row of map 0 alone is set against that map, on which all arrived.
    assert found["first"]["saving_vs_shortest_path"] == pytest.approx(1 - 66 / 110)
    assert found["first"]["best_saving"] == pytest.approx(1 - 66 / 120)
    # Who else did not arrive does not matter.
    late = record([[66, 66], [66, 66]], [[True, False], [True, True]])
    assert rows(mine=late)["mine"]["saving_vs_shortest_path"] == pytest.approx(0.34)


def test_the_seed_decides_the_resamples() -> None:
    minutes = np.random.default_rng(3).normal(80, 10, (20, 5))
    wide = {name: record(minutes) for name in (REFERENCE, BOUND, BASELINE)}
    assert summarise(wide, 7) == summarise(wide, 7)
    assert summarise(wide, 7)[BOUND]["ci95"] != summarise(wide, 8)[BOUND]["ci95"]


def test_a_row_as_people_read_it() -> None:
    some = rows(mine=record([[55, 77]], level="position"))["mine"] | {
        "ci95": [60.04, 70.0], "gap": 0.01234, "gap_ci95": [0.0, 0.0256],
    }  # fmt: skip
    assert list(cells("mine", some, maps=2).items()) == [
        ("planner", "mine (1 map)"),
        ("knows", "position"),
        ("minutes", "66.0"),
        ("minutes 95 %", "60.0 to 70.0"),
        ("saved", "40.0 %"),
        ("best map", "45.0 %"),
        ("gap", "1.23 %"),
        ("gap 95 %", "0.00 to 2.56"),
        ("arrive", "100.0 %"),
    ]
    assert cells("mine", some, maps=1)["planner"] == "mine"


def test_other_tables_have_other_columns() -> None:
    some = rows(mine=record([[55, 77]]), by=60.0)["mine"] | {"difference_ci95": [-13.456, 0.5]}
    # on map 0 66 against 80 by what is expected; one of two walks within the hour; 55 + .9 * 22 = 74.8
    columns = ("planner", "median", "90 %", "in time", "difference", "difference 95 %")
    assert list(cells("mine", some, 2, columns).values()) == [
        "mine (1 map)", "66.0", "74.8", "50.0 %", "-14.00", "-13.46 to +0.50",
    ]  # fmt: skip
    assert cells("mine", some | {"arrive_by": None}, 2, ["in time"]) == {"in time": ""}


def test_every_column_has_a_heading() -> None:
    some = rows(mine=record([[55, 77]]))["mine"]
    assert list(cells("mine", some, 1, HEADINGS)) == list(HEADINGS)
    assert set(PAPER_COLUMNS) < HEADINGS.keys() > set(TEXT_COLUMNS)


def test_tables_in_markdown() -> None:
    some = {"mine": rows(mine=record([[55, 77]]))["mine"]}
    assert markdown_table(some, 1, ("planner", "minutes", "gap")) == (
        "| planner | minutes | over the clairvoyant |\n| --- | --: | --: |\n| mine | 66.0 | 10.00 % |\n"
    )


# --- Under an objective ---------------------------------------------------------------------------------------------


def test_under_an_objective_planners_are_judged_by_cost() -> None:
    def costly(minutes: float, cost: float) -> Record:
        shape = (1, 4)
        totals = {"exposure": np.full(shape, 90.0), "metres": np.full(shape, 800.0), "too_dense": np.eye(4)[:1]}
        return Record("map", np.full(shape, minutes), np.ones(shape, bool), np.full(shape, cost), totals)

    found = summarise({REFERENCE: costly(20.0, 50.0), BOUND: costly(30.0, 40.0), BASELINE: costly(25.0, 44.0)})
    row = found[BASELINE]
    assert (row["mean_minutes"], row["mean_cost_minutes"]) == (25, 44)
    assert (row["mean_exposure"], row["mean_metres"], row["mean_too_dense"]) == (90, 800, 0.25)
    assert row["gap"] == pytest.approx(0.1)
    assert row["regret_minutes"] == pytest.approx(4)
    assert row["saving_vs_shortest_path"] == pytest.approx(0.12)
    assert found[BOUND]["difference_minutes"] == pytest.approx(-4)
    columns = ("cost", "exposure", "metres", "too dense")
    assert list(cells("mine", row, 1, columns).values()) == ["44.0", "90", "800", "0.25"]


def test_records_of_parts_are_joined_walk_by_walk() -> None:
    one, other = (
        Record("map", np.full(2, n), np.array([True, n > 1]), np.full(2, 2 * n), {"metres": np.full(2, 3 * n)})
        for n in (1.0, 2.0)
    )
    both = join_records([one, other], lambda arrays: np.concatenate(arrays)[:3])
    assert both.minutes.tolist() == [1, 1, 2]
    assert both.arrived.tolist() == [True, False, True]
    assert both.cost.tolist() == [2, 2, 4]
    assert both.totals["metres"].tolist() == [3, 3, 6]


# --- How single walks spread ----------------------------------------------------------------------------------------


def test_spread() -> None:
    # Eleven walks of 10, 20, ... 110 minutes: the sixth is in the middle, the tenth is at 90 %.
    minutes, arrived = np.arange(10.0, 111, 10), np.ones(11, bool)
    assert spread(minutes, arrived, 45.0) == {
        "median_minutes": 60.0,
        "p90_minutes": 100.0,
        "arrive_by": pytest.approx(4 / 11),
    }
    # Two walks: half way between, and nine tenths of the way.
    assert spread(np.array([10.0, 20.0]), np.ones(2, bool), None) == {
        "median_minutes": 15.0,
        "p90_minutes": pytest.approx(19.0),
        "arrive_by": None,
    }


def test_to_arrive_in_time_one_has_to_arrive() -> None:
    # Walks that do not arrive count as the horizon of 60: to be asked about 60 does not make them arrive.
    minutes, arrived = np.array([[30.0, 60.0], [60.0, 60.0]]), np.array([[True, True], [False, False]])
    assert spread(minutes, arrived, 60.0)["arrive_by"] == 0.5  # exactly at the limit is in time
    assert spread(minutes, arrived, 60.0, 60.0)["arrive_by"] == 0.25  # who arrives later counts as the horizon
    assert spread(minutes, arrived, 59.9)["arrive_by"] == 0.25
    assert spread(minutes, arrived, 10.0)["arrive_by"] == 0.0


def test_a_row_spreads_over_all_walks_of_all_maps() -> None:
    # single walks: 10, 20, 30, 100; median 25; .9 * 3 = 2.7: 30 + .7 * 70 = 79
    row = rows(mine=record([[100, 20], [10, 30]]), by=20.0)["mine"]
    assert (row["median_minutes"], row["p90_minutes"], row["arrive_by"]) == (25, pytest.approx(79), 0.5)
    assert rows()[BASELINE]["arrive_by"] is None


# --- Against the expected -------------------------------------------------------------------------------------------


def test_the_difference_by_hand() -> None:
    # 66 and 66 against 80 and 50: -14 and +16, so +1; two maps drawn again: -14, 1 or 16, the ends with 1/4 each
    row = rows(mine=record([[55, 77], [66, 66]]))["mine"]
    assert row["difference_minutes"] == pytest.approx(1)
    assert row["difference_ci95"] == pytest.approx([-14, 16])
    assert rows()[BASELINE]["difference_minutes"] == 0
    assert rows()[BASELINE]["difference_ci95"] == [0, 0]


def test_the_difference_is_paired() -> None:
    # Maps differ a hundredfold, but on each one is three minutes faster: there is nothing to doubt.
    baseline = np.random.default_rng(0).uniform(10, 1000, (30, 4))
    row = against(record(baseline), mine=record(baseline - 3))["mine"]
    assert row["difference_minutes"] == pytest.approx(-3)
    assert row["difference_ci95"] == pytest.approx([-3, -3])


def test_the_difference_on_one_map_is_that_of_its_walks() -> None:
    # walk by walk: -10, +10, -10, +10; as with the means above, 2.5 % of the draws of four lie at either end
    row = against(record([[60, 80, 70, 90]]), mine=record([[50, 90, 60, 100]]))["mine"]
    assert row["difference_minutes"] == 0
    assert row["difference_ci95"] == [-10, 10]


def test_the_interval_of_the_difference_is_as_wide_as_it_should_be() -> None:
    rng = np.random.default_rng(5)
    baseline = rng.normal(80, 10, (1, 400))
    mine = baseline - 2 + rng.normal(0, 4, (1, 400))
    low, high = against(record(baseline), mine=record(mine))["mine"]["difference_ci95"]
    # 1.96 standard errors of 400 differences each way
    assert (high - low) / 2 == pytest.approx(1.96 * (mine - baseline).std() / 20, rel=0.1)


def test_the_difference_may_be_taken_to_another() -> None:
    records = {REFERENCE: SHORTEST, BOUND: BEST, BASELINE: EXPECTED}
    # means: 100 by the shortest path, 50 in hindsight, 65 by what is expected; maps 80 and 50 less 110 and 90
    found = summarise(records, baseline=REFERENCE)
    assert {name: row["difference_minutes"] for name, row in found.items()} == {REFERENCE: 0, BOUND: -50, BASELINE: -35}
    assert found[BASELINE]["difference_ci95"] == [-40, -30]
    # and nothing else changes
    usual = summarise(records)[BASELINE]
    assert {name for name in usual if usual[name] != found[BASELINE][name]} == {"difference_minutes", "difference_ci95"}


def test_fewer_maps_are_set_against_the_expected_on_those() -> None:
    # map 0 alone: 66 against 80
    assert rows(mine=record([[66, 66]]))["mine"]["difference_minutes"] == pytest.approx(-14)
