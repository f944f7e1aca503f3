"""Any file gives a sound table of crowds or one sentence; what was written comes back."""

import math
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pyarrow import parquet

from sidestep.crowds.crowd_table import MOST_CELLS, TableError, load_crowd_table, save_crowd_table
from sidestep.crowds.table_flow import TableFlow
from sidestep.crowds.table_reader import read_table
from sidestep.network.town import Town

SUFFIXES = [".csv", ".parquet", ".npz"]
SEGMENTS = 5


@pytest.fixture(scope="module")
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@pytest.fixture(scope="module")
def town() -> Town:
    place = np.array([[0, 0], [0.001, 0], [0.001, 0.001]])
    tail, head = np.array([0, 1, 2], np.int32), np.array([1, 2, 0], np.int32)
    return Town(
        place=place,
        ids=np.array([10, 11, 12]),
        tail=tail,
        head=head,
        one_way=np.array([False, True, False]),
        length=np.full(3, 100, np.float32),
        width=np.full(3, 2, np.float32),
        kind=("footway",) * 3,
        name=("",) * 3,
        signals=np.zeros(3, np.int16),
        crossings=np.zeros(3, np.int16),
        opening=("",) * 3,
        restricted=np.zeros(3, bool),
        incline=np.full(3, np.nan, np.float32),
        kerb=np.zeros(3, np.float32),
        points=place[np.stack([tail, head], axis=1).ravel()],
        first=np.arange(0, 8, 2),
        attribution="",
    )


ENTRIES = st.dictionaries(
    st.tuples(st.integers(0, SEGMENTS - 1), st.integers(0, 6)), st.floats(0, 1e6, allow_subnormal=False), min_size=1
)


@settings(max_examples=60)
@given(entries=ENTRIES, timed=st.booleans())
def test_csv_and_parquet_bring_back_what_was_written(folder, town: Town, entries, timed: bool) -> None:
    if timed:
        entries |= {(0, 0): 1.0, (0, 1): 2.0, (0, 2): 3.0}  # so that most steps are of one slot
        entries = dict(sorted(entries.items()))
    segment, slot = (list(part) for part in zip(*entries, strict=True))
    clock = [str(np.datetime64("2025-05-24T12:00") + 15 * number) for number in slot] if timed else slot
    value = list(entries.values())
    head = f"segment,{'time' if timed else 'slot'},volume"
    rows = [f"{a},{b},{c!r}" for a, b, c in zip(segment, clock, value, strict=True)]
    (folder / "t.csv").write_text("\n".join([head, *rows]))
    parquet.write_table(
        pa.table(dict(zip(head.split(","), (segment, clock, value), strict=True))), folder / "t.parquet"
    )
    found = read_table(folder / "t.csv", town)
    assert (found.slots, found.slot_seconds) == (max(slot) + 1, 900 if timed else 300)
    assert found.segment.tolist() == sorted(set(segment))
    column = {number: place for place, number in enumerate(found.segment.tolist())}
    for (where, when), persons in entries.items():
        assert found.value[when, column[where]] == np.float32(persons)
    filled = found.slots * len(column) - len(entries)
    assert sum(repair.number for repair in found.repairs if repair.kind == "gap") == filled
    for number, place in column.items():
        known = [persons for (where, _), persons in entries.items() if where == number]
        assert np.float32(min(known)) <= found.value[:, place].min()
        assert found.value[:, place].max() <= np.float32(max(known))
    save_crowd_table(found, folder / "t.npz")
    for again in (read_table(folder / "t.parquet", town), load_crowd_table(folder / "t.npz")):
        np.testing.assert_array_equal(again.value, found.value)
        np.testing.assert_array_equal(again.segment, found.segment)
        assert (again.begins, again.slot_seconds) == (found.begins, found.slot_seconds)


AHEAD = jax.jit(TableFlow.ahead, static_argnums=4)


@settings(max_examples=20)
@given(
    volume=arrays(np.float32, (3, 2), elements=st.floats(0, 1e6, width=32, allow_subnormal=False)),
    seed=st.integers(0, 9),
)
def test_crowds_without_noise_are_the_table(volume: np.ndarray, seed: int) -> None:
    flow, slots = TableFlow(0.9, 0.0, 300.0, jnp.asarray(volume), 300.0), len(volume)
    drawn = np.asarray(flow.draw(jax.random.key(seed), jnp.zeros(2), slots).counted)
    np.testing.assert_array_equal(drawn, np.stack([volume, volume]))
    np.testing.assert_array_equal(flow.expected(jnp.zeros(1), slots).counted[0], volume)
    ahead = AHEAD(flow, jnp.asarray(volume[0]), jnp.float32(0), jnp.int32(0), slots)
    np.testing.assert_allclose(ahead, volume, rtol=1e-5)


# --- Damaged files --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def valid(folder, town: Town) -> dict[str, Path]:
    rows = [
        (street, way, f"2025-05-24T12:{minute:02}", 3.5 * street + minute)
        for minute in (0, 5, 10)
        for street, way in ((0, "forward"), (0, "backward"), (1, ""), (2, ""))
    ]
    head = ("street", "direction", "time", "volume")
    path = folder / "valid.csv"
    path.write_text("\n".join([",".join(head), *(",".join(map(str, row)) for row in rows)]))
    columns = [list(column) for column in zip(*rows, strict=True)]
    parquet.write_table(pa.table(dict(zip(head, columns, strict=True))), folder / "valid.parquet")
    save_crowd_table(read_table(path, town), folder / "valid.npz")
    return {suffix: folder / f"valid{suffix}" for suffix in SUFFIXES}


def check_sentence(error: Exception, path: Path) -> None:
    assert str(path) in str(error)
    assert "\n" not in str(error)


def sound_or_refused(path: Path, town: Town, content: bytes) -> None:
    path.write_bytes(content)
    try:
        table = load_crowd_table(path) if path.suffix == ".npz" else read_table(path, town)
    except TableError as error:
        check_sentence(error, path)
        return
    assert np.isfinite(table.value).all()
    assert (table.value >= 0).all()
    assert 0 < table.value.size <= MOST_CELLS
    assert table.segment.min() >= 0
    assert table.segment.max() < table.segments
    assert math.isfinite(table.slot_seconds)
    assert table.slot_seconds > 0


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=40)
@given(content=st.binary(max_size=200))
def test_random_bytes(folder, town: Town, suffix: str, content: bytes) -> None:
    sound_or_refused(folder / f"random{suffix}", town, content)


CELLS = st.one_of(
    st.sampled_from(
        ["", "0", "1", "-1", "1e9", "1e999", "nan", "1_0", "2025-05-24T12:00", "2025-05-24T12:05Z", "forward"]
    ),
    st.text(max_size=4),
)
HEADS = st.lists(
    st.sampled_from(
        ["street", "segment", "from", "to", "direction", "slot", "time", "volume", "speed", "density", "note", ""]
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=150)
@given(head=HEADS, rows=st.lists(st.lists(CELLS, min_size=1, max_size=5), max_size=4))
def test_random_cells(folder, town: Town, head, rows) -> None:
    text = "\n".join(",".join(cells) for cells in [head, *(row[: len(head)] for row in rows)])
    sound_or_refused(folder / "cells.csv", town, text.encode("utf-8", "surrogatepass"))


CHANGES = st.lists(st.tuples(st.integers(0, 9999), st.integers(0, 255)), max_size=4)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=100)
@given(changes=CHANGES, cut=st.none() | st.integers(0, 9999))
def test_truncated_and_mutated(folder, town: Town, valid, suffix: str, changes, cut: int | None) -> None:
    content = bytearray(valid[suffix].read_bytes())
    for where, value in changes:
        content[where * len(content) // 10000] = value
    whole = bytes(content)
    sound_or_refused(folder / f"mutated{suffix}", town, whole if cut is None else whole[: cut * len(whole) // 10000])
