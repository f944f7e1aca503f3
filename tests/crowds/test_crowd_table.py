"""Tables of crowds in their own files, and files that are something else."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from sidestep.crowds.crowd_table import CrowdTable, TableError, load_crowd_table, save_crowd_table, street_hash
from sidestep.network.town import Town


@pytest.fixture
def table(town: Town) -> CrowdTable:
    """Two slots of one segment."""
    return CrowdTable(
        "t.csv",
        "volume",
        np.array([3], np.int32),
        np.array([[1], [2]], np.float32),
        300.0,
        datetime.fromisoformat("2025-05-24T12:00"),
        7,
        street_hash(town),
    )


def test_saved_and_loaded(table: CrowdTable, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        save_crowd_table(table, tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = load_crowd_table(tmp_path / "a.npz")
    np.testing.assert_array_equal(again.segment, table.segment)
    np.testing.assert_array_equal(again.value, table.value)
    for name in ("quantity", "slot_seconds", "begins", "segments", "streets"):
        assert getattr(again, name) == getattr(table, name)
    save_crowd_table(replace(table, begins=None), tmp_path / "a.npz")
    assert load_crowd_table(tmp_path / "a.npz").begins is None


def test_a_table_belongs_to_its_streets(table: CrowdTable, town: Town, make_town) -> None:
    table.check_town(town)
    for one_way, field in (((False,) * 4, "segments"), ((True, False, False, False), "streets")):
        with pytest.raises(TableError) as caught:
            table.check_town(make_town(one_way))
        assert caught.value.field == field
    assert street_hash(town) == street_hash(make_town())


def test_tables_are_read_only(table: CrowdTable) -> None:
    with pytest.raises(ValueError, match="read-only"):
        table.value[0, 0] = 1.0


def test_files_of_another_kind(table: CrowdTable, tmp_path: Path) -> None:
    with pytest.raises(TableError) as caught:
        save_crowd_table(table, tmp_path / "t.csv")
    assert caught.value.field == "out"
    with pytest.raises(TableError, match="cannot read"):
        load_crowd_table(tmp_path / "none.npz")
    path = tmp_path / "t.npz"
    path.write_bytes(b"no zip")
    with pytest.raises(TableError, match="holds no crowds"):
        load_crowd_table(path)
    np.savez(path, place=np.zeros(2))
    with pytest.raises(TableError) as caught:
        load_crowd_table(path)
    assert caught.value.field == "format"


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("format", np.array(9)),
        ("value", np.array([[np.nan], [1]], np.float32)),
        ("value", np.array([[-1], [1]], np.float32)),
        ("value", np.array([[2e6], [1]], np.float32)),
        ("value", np.array([[1], [1]])),
        ("value", np.array([[1, 1], [1, 1]], np.float32)),
        ("segment", np.array([7], np.int32)),
        ("segment", np.array([-1], np.int32)),
        ("slot_seconds", np.array(0.0)),
        ("quantity", np.array("people")),
        ("begins", np.array("2025-05-24T12:00+00:00")),
    ],
)
def test_entries_that_make_no_sense(table: CrowdTable, tmp_path: Path, entry: str, value: np.ndarray) -> None:
    path = tmp_path / "t.npz"
    save_crowd_table(table, path)
    with np.load(path) as stored:
        good = dict(stored)
    np.savez(path, **{**good, entry: value})
    with pytest.raises(TableError) as caught:
        load_crowd_table(path)
    assert caught.value.field == entry
    assert str(path) in str(caught.value)
