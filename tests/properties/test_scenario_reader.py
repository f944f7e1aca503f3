"""Whatever the file, there is a scenario or one sentence; the lines that it names are there."""

import re
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.errors import SidestepError
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.reader import _FIELDS, _TOP, load_scenario
from sidestep.scenarios.template import template

TEMPLATE = template("town")


@pytest.fixture(scope="module")
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def read_or_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        found = load_scenario(path)
    except SidestepError as error:
        said = str(error)
        assert said.startswith(f"{path}: ")
        assert "\n" not in said
        assert len(said) < 1500
        named = re.match(r": line (\d+): ", said.removeprefix(str(path)))
        if named:
            assert 1 <= int(named[1]) <= content.count(b"\n") + 1
        else:
            assert re.search("the file is empty|no scenario|nested too deeply|not TOML: Exceeds", said)
    else:
        assert isinstance(found, Scenario)
        hash(found)


@settings(max_examples=100)
@given(content=st.binary(max_size=200))
def test_random_bytes(folder, content: bytes) -> None:
    read_or_refused(folder / "scenario.toml", content)


@settings(max_examples=100)
@given(text=st.text(alphabet="abn=[]{}\"'.,#\\\n\r\t 12-+eé\0", max_size=80))
def test_random_text(folder, text: str) -> None:
    read_or_refused(folder / "scenario.toml", text.encode())


NAMES = sorted({*_TOP, *_FIELDS, *(key for fields in _FIELDS.values() for key in fields), "45 Queen Street", "zoo", ""})
SIMPLE = """
0 1 -1 3.5 nan inf -0.0 1e300 999999999999999999999999999999 true 60.17 24.94 2024-01-01 2024-05-01T06:00:00 07:00:00
2024-05-01T06:00:00+01:00 "helsinki" "auckland" "." "" "paired" "Mon-Fri" "Mon" "map" "entry" "x" "\\u0000" "2025-01-01"
"""
VALUES = st.recursive(
    st.sampled_from(SIMPLE.split()),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]")
        | st.tuples(st.sampled_from(NAMES), inner).map(lambda pair: f'{{"{pair[0]}" = {pair[1]}}}')
    ),
    max_leaves=4,
)
STATEMENTS = st.one_of(
    st.sampled_from(NAMES).map(lambda name: f'["{name}"]'),
    st.sampled_from(sorted(_FIELDS)).map(lambda name: f"[{name}]"),
    st.tuples(st.lists(st.sampled_from(NAMES), min_size=1, max_size=2), VALUES).map(
        lambda pair: ".".join(f'"{name}"' for name in pair[0]) + " = " + pair[1]
    ),
    st.sampled_from(["", "# [", "[network]\nfile = 'helsinki'"]),
)


@settings(max_examples=200)
@given(statements=st.lists(STATEMENTS, max_size=5), sound=st.booleans())
def test_random_documents(folder, statements: list[str], sound: bool) -> None:
    begin = ["network.file = 'helsinki'"] if sound else []
    read_or_refused(folder / "scenario.toml", "\n".join(begin + statements).encode())


FIELDS = [(table, key) for table, fields in _FIELDS.items() for key in fields]


@settings(max_examples=200)
@given(field=st.sampled_from(FIELDS), value=VALUES)
def test_every_field_with_other_values(folder, field: tuple[str, str], value: str) -> None:
    text = f"network.file = 'helsinki'\n{field[0]}.{field[1]} = {value}\n"
    read_or_refused(folder / "scenario.toml", text.encode())


@settings(max_examples=150)
@given(
    changes=st.lists(st.tuples(st.integers(0, 9999), st.integers(0, 255)), max_size=3),
    cut=st.none() | st.integers(0, 9999),
)
def test_mutated_template(folder, changes: list[tuple[int, int]], cut: int | None) -> None:
    content = bytearray(TEMPLATE.encode())
    for where, value in changes:
        content[where * len(content) // 10000] = value
    read_or_refused(folder / "scenario.toml", bytes(content if cut is None else content[: cut * len(content) // 10000]))
