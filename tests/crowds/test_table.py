"""Tables of crowds by hand: what the columns mean, what is filled, and every way in which a file is refused."""

from datetime import datetime
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from sidestep.crowds.base import FlowModel
from sidestep.crowds.crowd_table import CrowdTable, load_crowd_table, read_table, save_crowd_table, street_hash
from sidestep.crowds.profile import time_of_week
from sidestep.crowds.table import TableFlow
from sidestep.crowds.table_columns import TableError
from sidestep.network.town import Town
from sidestep.walking.speed_laws import DENSEST, Aoki, Weidmann, density_at_speed

KEY = jax.random.key(3)


def a_town(one_way=(False, True, False, False)) -> Town:
    """Crossings 10, 11, 12; streets 0: 10-11, 1: 11>12, 2 and 3: 10-12, side by side.

    Segments 0 to 3 lead forward, 4: 11>10, 5 and 6: 12>10.
    """
    place = np.array([[0, 0], [0.001, 0], [0.001, 0.001]])
    tail, head = np.array([0, 1, 0, 0], np.int32), np.array([1, 2, 2, 2], np.int32)
    return Town(
        place=place,
        ids=np.array([10, 11, 12]),
        tail=tail,
        head=head,
        one_way=np.array(one_way),
        length=np.array([100, 100, 150, 160], np.float32),
        width=np.array([2, 2, 4, 4], np.float32),
        kind=("footway",) * 4,
        name=("",) * 4,
        signals=np.zeros(4, np.int16),
        crossings=np.zeros(4, np.int16),
        points=place[np.stack([tail, head], axis=1).ravel()],
        first=np.arange(0, 10, 2),
        attribution="",
    )


TOWN = a_town()


def dense(table: CrowdTable) -> dict[int, list[float]]:
    return {int(segment): table.value[:, column].tolist() for column, segment in enumerate(table.segment)}


@pytest.fixture
def read(tmp_path: Path):
    def make(text: str, slot_seconds: float | None = None) -> CrowdTable:
        path = tmp_path / "t.csv"
        path.write_text(text, encoding="utf-8")
        return read_table(path, TOWN, slot_seconds)

    return make


@pytest.fixture
def read_parquet(tmp_path: Path):
    def make(columns: dict) -> CrowdTable:
        path = tmp_path / "t.parquet"
        parquet.write_table(pa.table(columns), path)
        return read_table(path, TOWN)

    return make


# --- What the columns mean ------------------------------------------------------------------------------------------


def test_streets_with_and_without_a_direction(read) -> None:
    table = read("street,direction,slot,volume\n0,forward,0,5\n0,backward,0,7\n1,,0,2\n2,,0,9.5\n")
    # street 1 is walked one way only; the volume of street 2 is met in both directions
    assert dense(table) == {0: [5], 1: [2], 2: [9.5], 4: [7], 5: [9.5]}
    assert (table.quantity, table.slot_seconds, table.begins, table.rows) == ("volume", 300, None, 4)
    assert [(repair.kind, repair.number) for repair in table.repairs] == [("not mentioned", 2)]


def test_segments_and_crossings(read) -> None:
    assert dense(read("segment,slot,speed\n6,0,1.25\n1,0,0\n")) == {1: [0], 6: [1.25]}
    assert dense(read("FROM, To ,slot,density\n11,10,0,1\n10,11,0,2\n11,12,0,3\n")) == {0: [2], 1: [3], 4: [1]}


def test_gaps_are_filled_linearly_and_held_at_the_ends(read) -> None:
    table = read("segment,slot,volume\n0,1,10\n0,4,40\n1,0,1\n1,5,1\n")
    assert dense(table) == {0: [10, 10, 20, 30, 40, 40], 1: [1] * 6}
    # segment 0 lacks slots 0, 2, 3 and 5, segment 1 slots 1 to 4
    assert [(repair.kind, repair.number) for repair in table.repairs] == [("gap", 8), ("not mentioned", 5)]


def test_times_become_slots(read) -> None:
    text = "segment,time,volume\n0,2025-05-24T12:00,1\n0,2025-05-24T12:15,2\n0,2025-05-24 12:30:00,3\n"
    table = read(text + "0,2025-05-24T13:00,5\n1,2025-05-24T12:15,8\n")
    assert dense(table) == {0: [1, 2, 3, 4, 5], 1: [8] * 5}
    assert (table.slot_seconds, table.begins) == (900, datetime.fromisoformat("2025-05-24T12:00"))


def test_the_length_of_a_slot_may_be_told(read) -> None:
    assert read("segment,slot,volume\n0,0,1\n", 60.0).slot_seconds == 60
    assert read("segment,time,volume\n0,2025-05-24T12:00,1\n", 60.0).slot_seconds == 60
    two = "segment,time,volume\n0,2025-05-24T12:00,1\n0,2025-05-24T12:05,1\n"
    assert read(two, 300.0).slot_seconds == 300
    with pytest.raises(TableError, match="300 s apart, not 60"):
        read(two, 60.0)


def test_parquet_says_the_same_as_csv(read, read_parquet) -> None:
    csv = read("street,direction,time,volume\n0,forward,2025-05-24T12:00,5\n2,,2025-05-24T12:05,0.1\n")
    times = [datetime.fromisoformat("2025-05-24T12:00"), datetime.fromisoformat("2025-05-24T12:05")]
    others = {"street": [0, 2], "direction": ["forward", None], "volume": [5, 0.1]}
    for column in (
        ["2025-05-24T12:00", "2025-05-24T12:05"],
        *(pa.array(times, pa.timestamp(unit)) for unit in ("s", "ms", "us", "ns")),
    ):
        found = read_parquet({**others, "time": column})
        assert (dense(found), found.begins, found.repairs) == (dense(csv), csv.begins, csv.repairs)
    whole = {
        "street": pa.array([0.0, 2.0]),
        "volume": pa.array([5, 1], pa.uint8()),
        "slot": pa.array([0, 0], pa.int16()),
    }
    assert dense(read_parquet(whole)) == {0: [5], 2: [1], 4: [5], 5: [1]}


def test_columns_that_mean_nothing_are_named(read) -> None:
    assert read("segment,slot,volume,directon\n0,0,1,back\n").unused == ("directon",)


# --- What is refused ------------------------------------------------------------------------------------------------

HEAD = "segment,slot,volume\n0,0,1\n"
TIMES = "segment,time,volume\n0,2025-05-24T12:00,1\n0,2025-05-24T12:05,1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("segment,slot,volume\n", "no rows below the header"),
        ("segment,slot,volume\n0,0\n", "line 2 has 2 cells, the header has 3"),
        ('segment,slot,volume\n0,0,"1\n', "line 2: not comma-separated"),
        ("segment,slot,volume,\n0,0,1,2\n", "column 4 of the header has no name"),
        ("segment,slot,slot,volume\n0,0,0,1\n", "column 'slot' appears twice"),
        ("slot,volume\n0,1\n", "needs one of the columns street, segment, or from and to, and has none"),
        ("street,segment,slot,volume\n0,0,0,1\n", "has street and segment"),
        ("from,slot,volume\n10,0,1\n", "the columns from and to go together"),
        ("segment,direction,slot,volume\n0,forward,0,1\n", "direction goes with the column street only"),
        ("segment,volume\n0,1\n", "needs one of the columns slot and time, and has none"),
        ("segment,slot,time,volume\n0,0,2025-01-01,1\n", "has slot and time"),
        ("segment,slot\n0,1\n", "needs one of the columns volume, speed, density, and has none"),
        ("segment,slot,volume,speed\n0,0,1,1\n", "has volume and speed"),
        (HEAD + "\n0,1,-0.5\n", "line 4, column volume: '-0.5' is negative"),
        (HEAD + "0,1,nan\n", "line 3, column volume: 'nan' is not a finite number"),
        (HEAD + "0,1,inf\n", "line 3, column volume: 'inf' is not a finite number"),
        (HEAD + "0,1,1_0\n", "line 3, column volume: '1_0' is not a finite number"),
        (HEAD + "0,1,many\n", "line 3, column volume: 'many' is not a finite number"),
        (HEAD + "0,1,\n", "line 3, column volume: is empty"),
        (HEAD + "0,1,2e6\n", "line 3, column volume: '2e6' is more than 1e+06 persons"),
        ("segment,slot,speed\n0,0,14\n", "line 2, column speed: '14' is more than 13 m/s"),
        ("segment,slot,density\n0,0,21\n", "line 2, column density: '21' is more than 20 persons/m²"),
        (HEAD + "7,1,1\n", "line 3, column segment: 7 is none of 0 to 6"),
        (HEAD + "-1,1,1\n", "line 3, column segment: -1 is none of 0 to 6"),
        (HEAD + "1.5,1,1\n", "line 3, column segment: '1.5' is not a whole number"),
        (HEAD + ",1,1\n", "line 3, column segment: is empty"),
        (HEAD + "9999999999999999999,1,1\n", "line 3, column segment: '9999999999999999999' has more than 18 digits"),
        (HEAD + "0,-1,1\n", "line 3, column slot: -1 is negative"),
        (HEAD + "0,200000,1\n", "line 3, column slot: 200000 is more than the largest number, 105407"),
        (HEAD + "1,0,1\n0,0,1\n", "line 4: segment 0 in slot 0 stands in line 2 already"),
        ("street,slot,volume\n4,0,1\n", "line 2, column street: 4 is none of 0 to 3"),
        ("street,direction,slot,volume\n0,,0,1\n0,up,0,1\n", "line 3, column direction: must be forward or backward"),
        ("street,direction,slot,volume\n1,backward,0,1\n", "line 2, column direction: street 1 is not walked backward"),
        ("street,direction,slot,volume\n0,,0,1\n0,backward,0,1\n", "line 3: segment 4 in slot 0 stands in line 2"),
        ("from,to,slot,volume\n10,11,0,1\n10,13,0,1\n", "line 3, column to: 13 is no crossing of this town"),
        ("from,to,slot,volume\n9,11,0,1\n", "line 2, column from: 9 is no crossing of this town"),
        ("from,to,slot,volume\n12,11,0,1\n", "line 2, column to: no street leads from crossing 12 to 11"),
        ("from,to,slot,volume\n10,12,0,1\n", "line 2, column to: several streets lead from crossing 10 to 12; give"),
        (TIMES + "0,2025-05-24T12:10+03:00,1\n", "line 4, column time: '2025-05-24T12:10+03:00' has an offset"),
        (TIMES + "0,2025-05-24T12:10Z,1\n", "line 4, column time: '2025-05-24T12:10Z' has an offset"),
        (TIMES + "0,noon,1\n", "line 4, column time: 'noon' is not an ISO 8601 time"),
        (TIMES + "0,,1\n", "line 4, column time: is empty"),
        (TIMES + "0,2025-05-24T12:10:00.5,1\n", "has parts of a second"),
        (
            TIMES + "0,2025-05-24T12:12,1\n",
            "line 4, column time: 2025-05-24T12:12 is not a whole number of",
        ),
        (TIMES + "0,2025-05-24T11:55,1\n", "line 4, column time: 2025-05-24T11:55 comes before the time in line 3"),
        (TIMES + "0,2025-05-24T12:05,1\n", "line 4: segment 0 in slot 1 stands in line 3 already"),
        (TIMES + "0,2035-05-24T12:05,1\n", "line 4, column time: 2035-05-24T12:05 is more than 105408 steps"),
    ],
)
def test_bad_files_name_line_and_column(read, tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(TableError) as caught:
        read(text)
    assert str(caught.value).startswith(f"{tmp_path / 't.csv'}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"volume": [1.0, -2.0]}, "row 2, column volume: -2.0 is negative"),
        ({"volume": [1.0, None]}, "row 2, column volume: is empty"),
        ({"volume": [1.0, float("nan")]}, "row 2, column volume: nan is not a finite number"),
        ({"volume": [True, False]}, "row 1, column volume: True is not a finite number"),
        ({"slot": [0, None]}, "row 2, column slot: is empty"),
        ({"slot": [0.0, 0.5]}, "row 2, column slot: 0.5 is not a whole number"),
        ({"segment": [0, 9]}, "row 2, column segment: 9 is none of 0 to 6"),
        ({"slot": [0, 0], "segment": [3, 3]}, "row 2: segment 3 in slot 0 stands in row 1 already"),
    ],
)
def test_bad_parquet_names_row_and_column(read_parquet, columns: dict, said: str) -> None:
    with pytest.raises(TableError) as caught:
        read_parquet({"segment": [0, 1], "slot": [0, 0], "volume": [1.0, 1.0], **columns})
    assert said in str(caught.value)


def test_parquet_with_a_time_zone_is_refused(read_parquet) -> None:
    time = pa.array([datetime.fromisoformat("2025-05-24")], pa.timestamp("s", "Europe/Helsinki"))
    with pytest.raises(TableError, match="has the time zone Europe/Helsinki"):
        read_parquet({"segment": [0], "time": time, "volume": [1.0]})


def test_files_that_are_none(tmp_path: Path, monkeypatch) -> None:
    with pytest.raises(TableError, match=r"must end in \.csv or \.parquet"):
        read_table(tmp_path / "t.xlsx", TOWN)
    with pytest.raises(TableError, match="cannot be read: no such file"):
        read_table(tmp_path / "t.csv", TOWN)
    (tmp_path / "t.parquet").write_bytes(b"PAR1 not really PAR1")
    with pytest.raises(TableError, match="damaged, or not a Parquet file"):
        read_table(tmp_path / "t.parquet", TOWN)
    (tmp_path / "t.csv").write_bytes(b"segment,slot,volume\n\xff")
    with pytest.raises(TableError, match="byte 20 cannot be read"):
        read_table(tmp_path / "t.csv", TOWN)
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(TableError, match=r"Parquet takes pyarrow: pip install 'sidestep\[parquet\]'"):
        read_table(tmp_path / "t.parquet", TOWN)


# --- Our own files --------------------------------------------------------------------------------------------------


def test_saved_and_loaded(read, tmp_path: Path) -> None:
    table = read(TIMES)
    for name in ("a.npz", "b.npz"):
        save_crowd_table(table, tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = load_crowd_table(tmp_path / "a.npz")
    assert dense(again) == dense(table)
    for name in ("quantity", "slot_seconds", "begins", "segments", "streets"):
        assert getattr(again, name) == getattr(table, name)
    again.check_town(TOWN)
    with pytest.raises(TableError, match="a town of 7 segments, but this one has 8"):
        again.check_town(a_town(one_way=(False,) * 4))
    with pytest.raises(TableError, match="made for other streets"):
        again.check_town(a_town(one_way=(True, False, False, False)))
    assert street_hash(TOWN) == street_hash(a_town())


def test_files_of_another_kind_are_refused(read, tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"\.npz"):
        save_crowd_table(read(HEAD), tmp_path / "t.csv")
    with pytest.raises(TableError, match="cannot read"):
        load_crowd_table(tmp_path / "none.npz")
    path = tmp_path / "t.npz"
    path.write_bytes(b"no zip")
    with pytest.raises(TableError, match="holds no crowds"):
        load_crowd_table(path)
    np.savez(path, place=np.zeros(2))
    with pytest.raises(TableError, match="sidestep counts import makes them"):
        load_crowd_table(path)
    save_crowd_table(read(HEAD), path)
    with np.load(path) as stored:
        good = dict(stored)
    for wrong, said in (
        ({"format": np.array(9)}, "format 9, and this version reads 1"),
        ({"value": np.array([[np.nan]], np.float32)}, "values that are no volume"),
        ({"value": np.array([[-1]], np.float32)}, "values that are no volume"),
        ({"value": np.array([[1]])}, "its values int64"),
        ({"segment": np.array([7], np.int32)}, "not some of 0 to 6"),
        ({"segment": np.array([0, 1], np.int32)}, "shape"),
        ({"slot_seconds": np.array(0.0)}, "0.0 s"),
        ({"quantity": np.array("people")}, "none of volume, speed, density"),
        ({"begins": np.array("2025-05-24T12:00+00:00")}, "offset"),
    ):
        np.savez(path, **{**good, **wrong})
        with pytest.raises(TableError, match=said):
            load_crowd_table(path)


# --- Crowds ---------------------------------------------------------------------------------------------------------

USUAL = jnp.array([[1.0, 0.0], [2.0, 0.0], [3.0, 10.0]])


def test_without_noise_or_times_crowds_are_the_table() -> None:
    flow = TableFlow(USUAL, 300.0, 0.9, 0.0, 300.0)
    assert isinstance(flow, FlowModel)
    # the last slot holds
    expected = [[1, 0], [2, 0], [3, 10], [3, 10]]
    assert flow.expected(4).volume.tolist() == expected
    assert flow.draw(KEY, 2, 4).volume.tolist() == [expected, expected]
    assert flow.ahead(USUAL[0], jnp.int32(0), 4).tolist() == expected
    assert flow.covers(100)


def test_longer_rows_hold_for_several_slots() -> None:
    flow = TableFlow(USUAL, 600.0, 0.9, 0.0, 300.0)
    assert flow.expected(6).volume[:, 0].tolist() == [1, 1, 2, 2, 3, 3]


def test_the_noise_is_lasting() -> None:
    flow = TableFlow(jnp.array([[100.0, 0.0]]), 300.0, 0.5, 0.4, 300.0)
    drawn = np.asarray(flow.draw(KEY, 20_000, 2).volume)
    assert (drawn[..., 1] == 0).all()
    logs = np.log(drawn[..., 0] / 100)
    assert logs.std(axis=0) == pytest.approx([0.4, 0.4], rel=0.03)
    assert np.corrcoef(logs.T)[0, 1] == pytest.approx(0.5, abs=0.03)
    # exp(.4^2 / 2) = 1.083287
    assert flow.expected(2).volume.tolist() == [pytest.approx([108.3287, 0])] * 2
    # twice as many now: 2^.5 exp(.08 (1 - .25)) = 1.501652 in the next slot; nobody stays nobody
    ahead = flow.ahead(jnp.array([200.0, 0.0]), jnp.int32(0), 2)
    assert ahead.tolist() == [[200, 0], pytest.approx([150.1652, 0], rel=1e-5)]


def test_whole_days_repeat_and_begin_by_the_clock() -> None:
    # 24 hours from Saturday noon on: row number is hours since noon
    flow = TableFlow(jnp.arange(24.0)[:, None], 3600.0, 0.9, 0.0, 3600.0, 132.0, jnp.array([132.0, 10.0, 35.5]))
    assert flow.repeats
    # Saturday 12:00; Monday 10:00, 22 hours after noon; Tuesday 11:30, whose first slot has its middle at 12:00
    expected = [[0, 1, 2], [22, 23, 0], [0, 1, 2]]
    assert flow.expected(3).volume[..., 0].tolist() == expected
    assert flow.draw(KEY, 4, 3).volume[..., 0].tolist() == [*expected, expected[0]]
    assert flow.ahead(jnp.array([22.0]), jnp.int32(0), 3, 4).tolist() == [[22], [23], [0]]
    assert flow.ahead(jnp.array([23.0]), jnp.int32(1), 2, 1).tolist() == [[23], [0]]
    assert flow.covers(0.0)


def test_other_spans_hold_their_ends() -> None:
    # Saturday 12:00 to 15:00
    flow = TableFlow(USUAL, 3600.0, 0.9, 0.0, 3600.0, 132.0, jnp.array([132.0, 131.0, 134.0, 20.0]))
    found = flow.expected(3).volume[..., 0].tolist()
    assert found[:3] == [[1, 2, 3], [1, 1, 2], [3, 3, 3]]
    assert [flow.covers(hour) for hour in (131.9, 132.0, 134.9, 135.0)] == [False, True, True, False]
    assert time_of_week(datetime.fromisoformat("2025-05-24T12:30")) == 132.5


# --- Speeds ---------------------------------------------------------------------------------------------------------


def test_speeds_become_the_densities_that_make_them() -> None:
    for law in (Weidmann(), Aoki(), Aoki(capped=False)):
        density = np.linspace(1.05, 4.5, 20).astype(np.float32).reshape(4, 5)
        found = density_at_speed(law, np.asarray(law.speed(jnp.asarray(density))))
        np.testing.assert_allclose(found, density, rtol=1e-5)
    assert density_at_speed(Weidmann(), np.array([1.34, 1.5, 13.0])).tolist() == [0, 0, 0]
    # 1.34 (1 - exp(-1.913 (1/p - 1/5.4))) = .05: 1/p = 1/5.4 - ln(1 - .05/1.34) / 1.913 = .205066
    assert density_at_speed(Weidmann(), np.array([0.05, 0.01, 0.0])).tolist() == pytest.approx([4.87648] * 3, rel=1e-4)
    # 1.34 p^-.8 = .67: p = 2^1.25
    assert density_at_speed(Aoki(), np.array([0.67, 0.1])).tolist() == pytest.approx([2.378414, DENSEST])
