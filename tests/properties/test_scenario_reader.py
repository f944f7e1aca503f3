"""Whatever the file, there is a scenario or one sentence; the lines that it names exist."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.errors import SidestepError
from sidestep.scenarios.model import ObjectiveSpec, RewardSpec, Scenario
from sidestep.scenarios.places import Light
from sidestep.scenarios.reader import CountersFile, CrowdTableFile, ScenarioFile, TrafficFile, VenueFile, load_scenario
from sidestep.scenarios.template import template

TEMPLATE = template("town")
TABLES = {
    "": ScenarioFile,
    "place.": VenueFile,
    "place.crowd_source.": CountersFile,
    "place.traffic.": TrafficFile,
    "objective.": ObjectiveSpec,
    "reward.": RewardSpec,
}
FIELDS = [table + (field.alias or name) for table, kind in TABLES.items() for name, field in kind.model_fields.items()]


@pytest.fixture(scope="module")
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def read_or_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        found = load_scenario(path)
    except SidestepError as error:
        for one in (error, *error.others):
            assert str(one).startswith(f"{path}: ")
            assert "\n" not in str(one)
            assert len(str(one)) < 1500
            if one.line is not None:
                assert 1 <= one.line <= content.count(b"\n") + 1
                assert f": line {one.line}: " in str(one)
            assert one.field is None or one.line is not None
    else:
        assert type(found) is Scenario
        hash(found)
        assert Scenario.model_validate_json(found.model_dump_json()) == found


@settings(max_examples=100)
@given(content=st.binary(max_size=200))
def test_random_bytes(folder, content: bytes) -> None:
    read_or_refused(folder / "scenario.toml", content)


@settings(max_examples=100)
@given(text=st.text(alphabet="abn=[]{}\"'.,#\\\n\r\t 12-+eé\0", max_size=80))
def test_random_text(folder, text: str) -> None:
    read_or_refused(folder / "scenario.toml", text.encode())


NAMES = sorted(
    {name for field in FIELDS for name in field.split(".")}
    | {name for kind in (CrowdTableFile, Light) for name in kind.model_fields}
    | {"45 Queen Street", "zoo", "grid", "counters", ""}
)
SIMPLE = """
0 1 -1 3.5 nan inf -0.0 1e300 999999999999999999999999999999 true 60.17 24.94 2024-01-01 2024-05-01T06:00:00 07:00:00
2024-05-01T06:00:00+01:00 "helsinki" "auckland" "." "" "paired" "Mon-Fri" "Mon" "map" "entry" "x" "\\u0000" "2025-01-01"
"counters" "crowd_table" "grid" "venue"
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
    st.sampled_from(["place", "place.crowd_source", "place.traffic.lights", "objective"]).map(lambda name: f"[{name}]"),
    st.tuples(st.lists(st.sampled_from(NAMES), min_size=1, max_size=2), VALUES).map(
        lambda pair: ".".join(f'"{name}"' for name in pair[0]) + " = " + pair[1]
    ),
    st.sampled_from(["", "# [", "[place]\nstreets = 'helsinki'"]),
)


@settings(max_examples=200)
@given(statements=st.lists(STATEMENTS, max_size=5), sound=st.booleans())
def test_random_documents(folder, statements: list[str], sound: bool) -> None:
    begin = ["place.streets = 'helsinki'"] if sound else []
    read_or_refused(folder / "scenario.toml", "\n".join(begin + statements).encode())


@settings(max_examples=200)
@given(field=st.sampled_from(FIELDS), value=VALUES)
def test_every_field_with_other_values(folder, field: str, value: str) -> None:
    text = f"place.streets = 'helsinki'\n{field} = {value}\n"
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
