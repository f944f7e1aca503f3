"""Tables of counts are read and repaired once."""

import os
from dataclasses import fields

import numpy as np
import pytest

from sidestep.crowds.counts import CountTable
from sidestep.crowds.kept_counts import kept_table
from sidestep.crowds.repairs import Repair

PLACES = np.array([[60.1, 24.9], [60.2, 24.8]])


def table(positions: np.ndarray | None = PLACES) -> CountTable:
    times = np.arange("2025-01-01T00", "2025-01-01T03", dtype="datetime64[h]")
    counts = np.array([[1.0, np.nan], [2.5, 3.0], [0.0, 7.0]])
    repairs = (Repair("spike", "b", 1, "far more"), Repair("operational day", None, 2, "moved"))
    return CountTable(times, ("a", "b"), counts, positions, repairs, "nobody", ("hours",))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr("sidestep.crowds.kept_counts.cache_folder", lambda: tmp_path)
    return tmp_path


def never() -> CountTable:
    raise AssertionError


@pytest.mark.parametrize("positions", [PLACES, None])
def test_it_is_the_same_the_second_time(folder, positions) -> None:
    first = kept_table(lambda: table(positions), "1.0")
    again = kept_table(never, "1.0")
    for field in fields(CountTable):
        one, other = (getattr(each, field.name) for each in (first, again))
        assert type(one) is type(other)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype
            assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
        else:
            assert one == other
    assert not again.counts.flags.writeable
    assert [file.suffix for file in folder.iterdir()] == [".npz"]


@pytest.mark.usefixtures("folder")
def test_another_version_is_read_anew() -> None:
    kept_table(table, "1.0")
    with pytest.raises(AssertionError):
        kept_table(never, "1.1")


@pytest.mark.parametrize("damaged", [b"", b"PK\x03\x04 and no more", b"text"])
def test_what_is_damaged_is_read_anew(folder, damaged: bytes) -> None:
    kept_table(table)
    (file,) = folder.iterdir()
    file.write_bytes(damaged)
    assert kept_table(table).sensors == ("a", "b")
    assert kept_table(never).sensors == ("a", "b")


def test_without_a_folder_all_is_read_each_time(monkeypatch) -> None:
    monkeypatch.setattr("sidestep.crowds.kept_counts.cache_folder", lambda: None)
    assert kept_table(table).sensors == ("a", "b")
    with pytest.raises(AssertionError):
        kept_table(never)


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root may write anywhere")
def test_a_folder_that_is_not_to_be_written_to_does_no_harm(folder) -> None:
    folder.chmod(0o500)
    assert kept_table(table).sensors == ("a", "b")
