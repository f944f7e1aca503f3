"""Any file of counts gives a sound table or one sentence; tables come back from every layout."""

import string
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sidestep.crowds.counts import CountsError, CountTable, read_counts
from sidestep.crowds.layouts import COLUMNS, Layout
from sidestep.errors import SidestepError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("counts")


def read_or_refused(path: Path, layout: Layout) -> CountTable | SidestepError:
    try:
        return read_counts(path, layout)
    except SidestepError as error:
        return error


def sound_or_refused(path: Path, content: bytes, layout: Layout) -> None:
    path.write_bytes(content)
    table = read_or_refused(path, layout)
    if not isinstance(table, CountTable):
        assert isinstance(table, CountsError)
        assert str(table).startswith(str(path))
        assert "\n" not in str(table)
        assert len(str(table)) < 1500
        assert table.line is None or 1 <= table.line <= content.count(b"\n") + content.count(b"\r") + 1
        return
    assert table.counts.shape == (len(table.times), len(table.sensors))
    assert len(table.sensors) == len(set(table.sensors)) > 0
    assert (np.diff(table.times).astype(int) == 1).all()
    assert not (table.counts < 0).any()
    assert not np.isinf(table.counts).any()


# --- Files that are none, and nearly ones ---------------------------------------------------------------------------

WORDS = """
time date hour sensor count direction a b in out 2024-01-01T00 2024-01-01T01:00 2024-01-01 2024-10-27T02:00
2024-01-01T00:15 2024-01-01T00Z 2024-01-01T00+13 01/02/2024 25/12/2024 12/25/2024 1.2.24 0 1 5 12,5 1.234 -1 1e9 NA
nan 24 24:00 6-7
"""
CELLS = st.one_of(
    st.sampled_from(WORDS.split()),
    st.sampled_from(["", " ", '"', '""', "March 4, 2024 1:00 PM", "25. Mai 2024 3:00", "2024-01-01 05:00 - 06:00"]),
    st.text(max_size=3),
)
NAMES = """
time date hour when sensor sensor_id count Hourly_Counts direction a b Quay_in Quay_out in out total id
"""
HEADS = st.lists(st.sampled_from([*NAMES.split(), "", "a b"]), min_size=1, max_size=5)
LAYOUTS = st.fixed_dictionaries(
    {name: st.sampled_from(["", "", "a", "when"]) for name in COLUMNS if name not in ("count", "ignore")}
    | dict(
        count=st.sampled_from([(), (), ("a",), ("a+b",), ("in", "out")]),
        ignore=st.sampled_from([(), ("b",)]),
        date_format=st.sampled_from(["", "", "day-first", "month-first", "%d/%m/%Y", "%H", "%", "%d/%m/%Y %z", "x"]),
        decimal=st.sampled_from(["", ".", ","]),
        timezone=st.sampled_from([None, "Europe/Helsinki", "Australia/Lord_Howe"]),
    )
)


@settings(max_examples=200, deadline=None)
@given(
    content=st.one_of(
        st.binary(max_size=200),
        st.text(alphabet=string.printable, max_size=200).map(str.encode),
        st.text(max_size=100).map(lambda text: text.encode("utf-16")),
    )
)
@example(content=b"time,a\n9999-12-31T23,1\n")
@example(content=b"time,a\n0001-01-01T00,1\n0001-01-01T01,1\n")
@example(content=b"time,a\n" + b"x" * 200_000)
@example(content=b'time,a\n"' + b"x" * 200_000 + b'",1\n')
@example(content=b"time,a\n2024-01-01T00," + b"9" * 5000)
def test_random_bytes(folder: Path, content: bytes) -> None:
    sound_or_refused(folder / "c.csv", content, Layout())


@settings(max_examples=250, deadline=None)
@given(
    head=HEADS,
    rows=st.lists(st.lists(CELLS, min_size=1, max_size=5), max_size=5),
    sep=st.sampled_from([",", ",", ";", "\t", "|"]),
    above=st.sampled_from(["", "", "City of X", ",,", "Counter;Quay"]),
    end=st.sampled_from(["\n", "\r\n", ",\n"]),
    layout=LAYOUTS,
)
def test_random_cells(folder: Path, head, rows, sep: str, above: str, end: str, layout: dict[str, Any]) -> None:
    text = end.join([above, *(sep.join(cells) for cells in [head, *(row[: len(head)] for row in rows)])])
    sound_or_refused(folder / "c.csv", text.encode("utf-8", "surrogatepass"), Layout(**layout))


VALID = b"""City of X

Time;Quay in;Quay out;Hall
25.03.2024 00:00;1,5;2;
25.03.2024 01:00;1;2;3
25.03.2024 03:00;0;2;9
"""


@settings(max_examples=200, deadline=None)
@given(
    changes=st.lists(st.tuples(st.integers(0, 9999), st.integers(0, 255)), max_size=4),
    cut=st.none() | st.integers(0, 9999),
)
def test_truncated_and_mutated(folder: Path, changes: list[tuple[int, int]], cut: int | None) -> None:
    content = bytearray(VALID)
    for where, value in changes:
        content[where * len(content) // 10000] = value
    sound_or_refused(
        folder / "c.csv", bytes(content if cut is None else content[: cut * len(content) // 10000]), Layout()
    )


@settings(max_examples=60, deadline=None)
@given(
    form=st.sampled_from(["%", "%d/%m", "%Q", "(", "\\", "%d(%m", "%z"]) | st.text(max_size=6),
    zone=st.text(max_size=8) | st.sampled_from(["..", "/etc/passwd", "Europe", "\0"]),
)
def test_what_is_said_may_be_nonsense(folder: Path, form: str, zone: str) -> None:
    (folder / "c.csv").write_text("time,a\n25/03/2024 00:00,1\n25/03/2024 01:00,1\n")
    found = read_or_refused(folder / "c.csv", Layout(date_format=form, timezone=zone or None))
    assert isinstance(found, CountTable) or "\n" not in str(found)


# --- Tables that are written and read -------------------------------------------------------------------------------

TABLES = st.lists(
    st.lists(st.none() | st.integers(0, 99_999).map(lambda count: count / 10), min_size=2, max_size=2), min_size=3
)


@settings(max_examples=25, deadline=None)
@given(counts=TABLES, order=st.randoms(use_true_random=False))
def test_a_table_comes_back_from_every_layout(folder: Path, counts: list[list[float | None]], order) -> None:
    times = np.datetime64("2024-05-24T22:00") + np.arange(len(counts)) * np.timedelta64(60, "m")
    found: list[CountTable] = []

    def read(lines: list[str], **layout) -> None:
        (folder / "t.csv").write_text("\n".join(lines) + "\n")
        found.append(read_counts(folder / "t.csv", Layout(**layout)))

    def cell(count: float | None, mark: str = ".") -> str:
        return "" if count is None else f"{count:.1f}".replace(".", mark)

    stamped = list(zip(times.tolist(), counts, strict=True))
    read(["time,a,b", *(f"{time:%Y-%m-%dT%H:%M},{cell(a)},{cell(b)}" for time, (a, b) in stamped)])
    read(
        ["Datum;Zeit;a;b;", *(f"{time:%d.%m.%Y;%H:%M};{cell(a, ',')};{cell(b, ',')};" for time, (a, b) in stamped)],
        decimal=",",
    )
    read(["time\ta\tb", *(f"{time:%m/%d/%Y %I:%M %p}\t{cell(a)}\t{cell(b)}" for time, (a, b) in reversed(stamped))])
    long = [
        f"{time:%B %d, %Y %H:%M},{name},{cell(count)}"
        for time, both in stamped
        for name, count in zip("ab", both, strict=True)
    ]
    order.shuffle(long)
    read(["time,sensor,count", *long])
    halves = [
        f"{time:%Y-%m-%dT%H}:{minute},{cell(a)},0,{cell(b)}" for time, (a, b) in stamped for minute in ("00", "30")
    ]
    read(["time,a in,a out,b", *halves])
    first, *others = found
    assert first.sensors == ("a", "b")
    np.testing.assert_array_equal(first.times, times.astype("datetime64[h]"))
    expected = np.array([[np.nan if count is None else count for count in both] for both in counts])
    np.testing.assert_array_equal(first.counts, expected)
    for number, table in enumerate(others):
        factor = 2 if number == 3 else 1
        kept = np.isin(first.times, table.times)
        assert np.isnan(first.counts[~kept]).all()
        columns = [table.sensors.index(name) for name in "ab"]
        np.testing.assert_allclose(table.counts[:, columns], factor * first.counts[kept])
