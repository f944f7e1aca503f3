"""Counts as they are posted: what each format gives, and what is refused in one sentence about a field and a row."""

import json
import math
from datetime import UTC, datetime
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from sidestep.crowds.live import LiveCount, LiveError
from sidestep.server.count_formats import MOST_COUNTS, read_posted

TOWN = "Europe/Helsinki"
NOON = datetime.fromisoformat("2025-05-24T09:00Z")  # 12:00 in Helsinki


def posted(content: Any, kind: str = "application/json", **options: Any) -> list[LiveCount]:
    body = content if isinstance(content, bytes) else content.encode() if isinstance(content, str) else None
    return read_posted(json.dumps(content).encode() if body is None else body, kind, TOWN, **options)


def refused(content: Any, kind: str = "application/json", **options: Any) -> LiveError:
    with pytest.raises(LiveError) as caught:
        posted(content, kind, **options)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
    return caught.value


# --- JSON -----------------------------------------------------------------------------------------------------------

PLAIN = {"sensor": "Bridge, east", "time": "2025-05-24T12:00", "count": 12}


def test_one_and_many() -> None:
    whole = LiveCount("Bridge, east", NOON, 3600.0, 12.0)
    apart = {"sensor": "quay", "time": "2025-05-24T09:00:00Z", "seconds": 60, "towards": 3, "away": 1.5}
    assert posted(PLAIN) == posted([PLAIN]) == [whole]
    assert posted([PLAIN, apart, PLAIN]) == [whole, LiveCount("quay", NOON, 60.0, 4.5, 3.0, 1.5), whole]
    assert posted(apart | {"count": 4.5}) == posted(apart)
    assert posted(PLAIN, "Application/JSON; charset=UTF-8") == [whole]
    assert posted(b"\xef\xbb\xbf" + json.dumps(PLAIN).encode()) == [whole]
    assert posted(PLAIN, seconds=300.0) == [LiveCount("Bridge, east", NOON, 300.0, 12.0)]


@pytest.mark.parametrize(
    "time",
    [
        "2025-05-24T12:00",
        "2025-05-24 12",
        "2025-05-24T12:00:00.000",
        "2025-05-24T09:00Z",
        "2025-05-24T09:00:00.000000000Z",
        "2025-05-24T14:30:00+05:30",
        "2025-05-24T05:00-0400",
    ],
)
def test_times(time: str) -> None:
    assert posted(PLAIN | {"time": time})[0].begins == NOON
    assert posted(PLAIN | {"time": time})[0].begins.tzinfo is UTC


def test_the_hour_that_clocks_show_twice() -> None:
    assert refused(PLAIN | {"time": "2025-10-26T03:30"}).field == "time"
    first, second = (posted(PLAIN | {"time": f"2025-10-26T03:30+0{offset}:00"})[0].begins for offset in (3, 2))
    assert (second - first).total_seconds() == 3600


@pytest.mark.parametrize(
    ("changed", "field"),
    [
        ({"count": "12"}, "count"),
        ({"count": True}, "count"),
        ({"count": None}, "count"),
        ({"count": [12]}, "count"),
        ({"count": 10**400}, "count"),
        ({"towards": 12}, "count"),
        ({"towards": "6", "away": 6}, "count"),
        ({"towards": 6, "away": 7}, "count"),
        ({"seconds": "900"}, "seconds"),
        ({"seconds": False}, "seconds"),
        ({"sensor": 7}, "sensor"),
        ({"sensor": " "}, "sensor"),
        ({"sensor": None}, "sensor"),
        ({"time": 1748077200}, "time"),
        ({"time": ""}, "time"),
        ({"time": "noon"}, "time"),
        ({"time": "2025-05-24"}, "time"),
        ({"time": "2025-W21-6T12:00"}, "time"),
        ({"time": "2025-02-30T12:00"}, "time"),
        ({"time": "2025-05-24T24:30"}, "time"),
        ({"time": "2025-03-30T03:30"}, "time"),
        ({"time": "0001-01-01T00:00"}, "time"),
        ({"time": "٢٠٢٥-05-24T12:00"}, "time"),
        ({"time": "2025-05-24T12:00" + " " * 100_000}, "time"),
        ({"secs": 900}, "secs"),
        ({"Sensor": "quay"}, "Sensor"),
    ],
)
def test_wrong_members(changed: dict[str, Any], field: str) -> None:
    error = refused(PLAIN | changed)
    assert (error.field, error.row) == (field, None)
    error = refused([PLAIN, PLAIN | changed, PLAIN | changed])
    assert (error.field, error.row) == (field, 2)
    assert str(error).startswith("row 2: ")


@pytest.mark.parametrize("missing", ["sensor", "time", "count"])
def test_missing_members(missing: str) -> None:
    assert refused({key: value for key, value in PLAIN.items() if key != missing}).field == missing


@pytest.mark.parametrize(
    ("body", "field"),
    [
        (b"", "body"),
        (b" \n", "body"),
        (b"\xef\xbb\xbf", "body"),
        (b"[]", "body"),
        (b"12", "body"),
        (b"null", "body"),
        (b"[null]", "body"),
        (b"[[]]", "body"),
        (b"{", "body"),
        (b'{"sensor": "a"} {"sensor": "b"}', "body"),
        (b'{"sensor": "a", "time": "2025-05-24T12:00", "count": NaN}', "body"),
        (b'{"sensor": "a", "time": "2025-05-24T12:00", "count": -Infinity}', "body"),
        (b'{"sensor": "a", "time": "2025-05-24T12:00", "count": 1e999}', "count"),
        (b'{"sensor": "a", "time": "2025-05-24T12:00", "count": 1, "count": 2}', "count"),
        (b'{"count": ' + b"9" * 5000 + b"}", "body"),
        (b"[" * 100_000, "body"),
        (b"[" * 100_000 + b"]" * 100_000, "body"),
        (b'{"type":' * 100_000, "body"),
        ('{"sensor": "länsi"}'.encode("latin-1"), "body"),
        ('{"sensor": "a"}'.encode("utf-16"), "body"),
        (json.dumps([PLAIN] * (MOST_COUNTS + 1)).encode(), "body"),
    ],
)
def test_bodies_that_are_no_counts(body: bytes, field: str) -> None:
    assert refused(body).field == field
    assert refused(body, "application/ld+json").field == field


def test_as_many_as_may_be() -> None:
    assert len(posted([PLAIN] * MOST_COUNTS)) == MOST_COUNTS


@pytest.mark.parametrize(
    "kind",
    ["", "text/plain", "application/x-www-form-urlencoded", "application/jsonp", "text/csv; charset=latin-1",
     'application/json; charset="utf-16"', "x" * 10_000],
)  # fmt: skip
def test_other_types(kind: str) -> None:
    assert refused(PLAIN, kind).field == "content_type"


# --- NGSI-LD --------------------------------------------------------------------------------------------------------

# As Smart Data Models publish their example, with an hour of our own.
ENTITY: dict[str, Any] = {
    "id": "urn:ngsi-ld:CrowdFlowObserved:Bridge%2C%20east",
    "type": "CrowdFlowObserved",
    "averageHeadwayTime": {"type": "Property", "value": 5},
    "congested": {"type": "Property", "value": False},
    "dateObserved": {
        "type": "Property",
        "value": {"@type": "DateTime", "@value": "2025-05-24T12:00:00/2025-05-24T12:05:00"},
    },
    "dateObservedFrom": {"type": "Property", "value": {"@type": "DateTime", "@value": "2025-05-24T09:00:00Z"}},
    "dateObservedTo": {"type": "Property", "value": {"@type": "DateTime", "@value": "2025-05-24T09:05:00Z"}},
    "direction": {"type": "Property", "value": "inbound"},
    "location": {"type": "GeoProperty", "value": {"type": "LineString", "coordinates": [[24.9, 60.1], [24.9, 60.2]]}},
    "peopleCount": {"type": "Property", "value": 100, "observedAt": "2025-05-24T09:05:00Z"},
    "@context": ["https://raw.githubusercontent.com/smart-data-models/dataModel.Transportation/master/context.jsonld"],
}
FIVE_MINUTES = LiveCount("Bridge, east", NOON, 300.0, 100.0)
KEY_VALUES = {
    "id": "urn:ngsi-ld:CrowdFlowObserved:Bridge%2C%20east",
    "type": "CrowdFlowObserved",
    "dateObservedFrom": "2025-05-24T09:00:00Z",
    "dateObservedTo": "2025-05-24T09:05:00Z",
    "peopleCount": 100,
}


def without(entity: dict[str, Any], *keys: str) -> dict[str, Any]:
    return {key: value for key, value in entity.items() if key not in keys}


@pytest.mark.parametrize("kind", ["application/json", "application/ld+json"])
def test_entities_and_notifications(kind: str) -> None:
    for one in (ENTITY, KEY_VALUES):
        assert posted(one, kind) == posted([one], kind) == [FIVE_MINUTES]
        notification = {"id": "urn:ngsi-ld:Notification:1", "type": "Notification", "subscriptionId": "urn:s:1"}
        assert (
            posted(notification | {"notifiedAt": "2025-05-24T09:05:01Z", "data": [one, one]}, kind)
            == [FIVE_MINUTES] * 2
        )
        assert posted({"subscriptionId": "5f2a", "data": [one]}, kind) == [FIVE_MINUTES]  # version 2
    assert posted([ENTITY, PLAIN], kind)[1].sensor == "Bridge, east"


@pytest.mark.parametrize(
    ("changed", "seconds"),
    [
        ({"dateObserved": "2025-05-24T09:00:00Z/2025-05-24T09:05:00Z"}, 300),
        ({"dateObserved": {"type": "Property", "value": "2025-05-24T12:00/2025-05-24T12:30"}}, 1800),
        ({"dateObserved": {"type": "DateTime", "@value": "2025-05-24T09:00:00Z"}}, 3600),
        (
            {"dateObserved": {"type": "Property", "value": {"@type": "DateTime", "@value": "2025-05-24T09:00:00Z"}}},
            3600,
        ),
        ({"dateObserved": {"type": "DateTime", "value": "2025-05-24T09:00:00Z"}}, 3600),
        ({"dateObserved": "2025-05-24T09:00:00Z"}, 3600),
        ({"dateObservedFrom": "2025-05-24T09:00:00Z"}, 3600),
        ({"dateObserved": "2025-05-24T09:00:00Z", "dateObservedTo": "2025-05-24T09:10:00Z"}, 600),
        ({"dateObservedFrom": "2025-05-24T09:10:00Z", "dateObservedTo": "2025-05-24T09:00:00Z"}, -600),
    ],
)
def test_when(changed: dict[str, Any], seconds: float) -> None:
    bare = without(ENTITY, "dateObserved", "dateObservedFrom", "dateObservedTo")
    assert posted(bare | changed)[0].seconds == seconds
    if seconds == 3600:
        assert posted(bare | changed, seconds=60.0)[0].seconds == 60


@pytest.mark.parametrize(
    ("changed", "sensor"),
    [
        ({"id": "urn:ngsi-ld:CrowdFlowObserved:helsinki:bridge"}, "helsinki:bridge"),
        ({"id": "bridge"}, "bridge"),
        ({"name": "Bridge 2"}, "Bridge 2"),
        ({"name": {"type": "Property", "value": "Bridge 2"}}, "Bridge 2"),
        ({"name": "Bridge 2", "refDevice": {"type": "Relationship", "object": "urn:ngsi-ld:Device:cam-7"}}, "cam-7"),
        ({"refDevice": {"type": "Relationship", "object": ["urn:ngsi-ld:Device:cam-7"]}}, "cam-7"),
        ({"refDevice": ["cam-7"]}, "cam-7"),
        ({"refDevice": {"object": "urn:ngsi-ld:Device:cam%207"}}, "cam 7"),
        ({"name": "", "refDevice": None}, "Bridge, east"),
    ],
)
def test_which_sensor(changed: dict[str, Any], sensor: str) -> None:
    assert posted(ENTITY | changed)[0].sensor == sensor


def test_directions_of_entities() -> None:
    both = {"peopleCountTowards": {"type": "Property", "value": 60}, "peopleCountAway": {"value": 40}}
    expected = [LiveCount("Bridge, east", NOON, 300.0, 100.0, 60.0, 40.0)]
    assert posted(ENTITY | both) == posted(without(ENTITY, "peopleCount") | both) == expected
    assert refused(ENTITY | both | {"peopleCount": 99}).field == "count"
    assert refused(ENTITY | {"peopleCountAway": 100}).field == "count"


@pytest.mark.parametrize(
    ("changed", "field"),
    [
        ({"type": "TrafficFlowObserved"}, "body"),
        ({"type": None}, "body"),
        ({"type": ["Thing", 7]}, "body"),
        ({"peopleCount": {"type": "Property", "value": "100"}}, "count"),
        ({"peopleCount": {"type": "Property", "value": True}}, "count"),
        ({"peopleCount": {"type": "Property"}}, "count"),
        ({"peopleCount": [{"value": 1}, {"value": 2}]}, "count"),
        ({"peopleCount": None}, "count"),
        ({"refDevice": ["a", "b"]}, "sensor"),
        ({"id": 7}, "sensor"),
        ({"id": None}, "sensor"),
        ({"dateObservedFrom": 5}, "time"),
        ({"dateObservedTo": "later"}, "time"),
        ({"dateObservedFrom": {"value": {"@value": ["2025-05-24T09:00:00Z"] * 2}}}, "time"),
        ({"dateObservedFrom": None, "dateObserved": None}, "time"),
        ({"dateObservedFrom": None, "dateObserved": "2025-05-24T09:00:00Z/PT5M"}, "time"),
    ],
)
def test_wrong_entities(changed: dict[str, Any], field: str) -> None:
    assert refused(ENTITY | changed).field == field
    error = refused({"type": "Notification", "data": [ENTITY, ENTITY | changed]})
    assert (error.field, error.row) == (field, 2)


def test_types_may_be_written_out() -> None:
    for kind in (
        "https://smartdatamodels.org/dataModel.Transportation/CrowdFlowObserved",
        ["Thing", "CrowdFlowObserved"],
    ):
        assert posted(ENTITY | {"type": kind}) == [FIVE_MINUTES]


def test_notifications_without_entities() -> None:
    for data in ({}, None, "data", []):
        assert refused({"type": "Notification", "data": data}).field == "body"
    assert refused({"type": "Notification"}).field == "body"


# --- CSV ------------------------------------------------------------------------------------------------------------


def rows(*lines: str) -> str:
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        rows("time,sensor,count", '2025-05-24T12:00,"Bridge, east",12'),
        rows("\ufeffTime;Sensor name;Count", "2025-05-24 12:00;Bridge, east;12"),
        rows("", 'count,"sensor",seconds,time', "", '12,"Bridge, east",3600,2025-05-24T09:00Z', ""),
        rows("time\tsensor\tpedestrians\tlatitude", "2025-05-24T12:00\tBridge, east\t12.0\t60.17").replace(
            "\n", "\r\n"
        ),
        'sensing_datetime,location_id,total_of_directions\r2025-05-24T12:00:00+03:00,"Bridge, east",12\r',
    ],
)
def test_flat_rows(text: str) -> None:
    assert posted(text, "text/csv") == [LiveCount("Bridge, east", NOON, 3600.0, 12.0)]


def test_as_melbourne_publishes() -> None:
    text = rows(
        "location_id,sensing_datetime,sensing_date,sensing_time,direction_1,direction_2,total_of_directions",
        "77,2025-05-24T12:00:00+03:00,2025-05-24,12:00,3,4,7",
        "8,2025-05-24T12:01:00+03:00,2025-05-24,12:01,0,1,1",
    )
    expected = [LiveCount("77", NOON, 60.0, 7.0, 3.0, 4.0), LiveCount("8", NOON.replace(minute=1), 60.0, 1.0, 0.0, 1.0)]
    assert posted(text, "text/csv; charset=utf-8; header=present", seconds=60.0) == expected


@pytest.mark.parametrize(("written", "persons"), [("1.000", None), ("123.456", None), ("1.00", 1.0), ("0.125", 0.125)])
def test_marks_between_thousands(written: str, persons: float | None) -> None:
    text = rows("time,sensor,seconds,towards,away", f"2025-05-24T12:00,quay,900.000,{written},0")
    if persons is None:
        assert (refused(text, "text/csv").field, refused(text, "text/csv").line) == ("count", 2)
    else:
        assert posted(text, "text/csv")[0].towards == persons


def test_directions_and_seconds() -> None:
    text = rows("time,sensor,seconds,towards,away", "2025-05-24T12:00,quay,900,3,4.5")
    assert posted(text, "text/csv") == [LiveCount("quay", NOON, 900.0, 7.5, 3.0, 4.5)]


HEAD = "time,sensor,count"


@pytest.mark.parametrize(
    ("text", "field", "line"),
    [
        ("", "body", None),
        (HEAD, "body", None),
        (rows("2025-05-24T12:00,quay,12"), "time", 1),  # no header
        (rows("time,count", "2025-05-24T12:00,12"), "sensor", 1),
        (rows("time,sensor", "2025-05-24T12:00,quay"), "count", 1),
        (rows("time,sensor,towards", "2025-05-24T12:00,quay,1"), "count", 1),
        (rows("time,timestamp,sensor,count", "2025-05-24T12:00,2025-05-24T12:00,quay,1"), "time", 1),
        (rows("time,sensor,count,Count", "2025-05-24T12:00,quay,1,2"), "body", 1),
        (rows("time,sensor,direction,count", "2025-05-24T12:00,quay,N,1"), "count", 1),
        (rows(HEAD, "2025-05-24T12:00,quay"), "body", 2),
        (rows(HEAD, "2025-05-24T12:00,quay,1,2"), "body", 2),
        (rows(HEAD, "", "24.5.2025 12:00,quay,1"), "time", 3),
        (rows(HEAD, "1748077200,quay,1"), "time", 2),
        (rows(HEAD, ",quay,1"), "time", 2),
        (rows(HEAD, "2025-05-24T12:00,,1"), "sensor", 2),
        (rows(HEAD, "2025-05-24T12:00,quay,"), "count", 2),
        (rows(HEAD, "2025-05-24T12:00,quay,-1"), "count", 2),
        (rows(HEAD, "2025-05-24T12:00,quay,nan"), "count", 2),
        (rows(HEAD, "2025-05-24T12:00,quay,1e3"), "count", 2),
        (rows(HEAD, '2025-05-24T12:00,quay,"1,200"'), "count", 2),
        (rows(HEAD, "2025-05-24T12:00,quay,١٢"), "count", 2),
        (rows(HEAD + ",seconds", "2025-05-24T12:00,quay,1,"), "seconds", 2),
        (rows(HEAD, '2025-05-24T12:00,"quay,1'), "body", None),
        (rows(HEAD, '2025-05-24T12:00,"quay"x,1'), "body", None),
        (rows(HEAD, "2025-05-24T12:00," + "q" * 200_000 + ",1"), "body", None),
        (rows(HEAD, *["2025-05-24T12:00,quay,1"] * (MOST_COUNTS + 1)), "body", None),
    ],
)
def test_wrong_rows(text: str, field: str, line: int | None) -> None:
    error = refused(text, "text/csv")
    assert (error.field, error.line) == (field, line)


def test_rows_are_told() -> None:
    error = refused(rows(HEAD, "2025-05-24T12:00,quay,1", "", "2025-05-24T13:00,quay,x"), "text/csv")
    assert (error.row, error.line, error.field) == (2, 4, "count")
    with pytest.raises(LiveError) as caught:
        read_posted(rows(HEAD, "2025-05-24T12:00,länsi,1").encode("latin-1"), "text/csv", TOWN)
    assert caught.value.field == "body"


# --- Whatever is posted ---------------------------------------------------------------------------------------------

SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
WORDS = st.sampled_from(
    ["2025-05-24T12:00", "2025-05-24T09:00Z/2025-05-24T10:00Z", "quay", "CrowdFlowObserved", "Notification"]
)
NAMES = st.sampled_from([
    "sensor", "time", "seconds", "count", "towards", "away", "type", "value", "@value", "object", "data", "id", "name",
    "refDevice", "dateObserved", "dateObservedFrom", "dateObservedTo", "peopleCount", "peopleCountAway", "x",
])  # fmt: skip
CONTENT = st.recursive(
    SCALARS | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=6),
    max_leaves=12,
)


def understood(body: bytes, kind: str) -> None:
    try:
        found = read_posted(body, kind, TOWN)
    except LiveError as error:
        found, refusal = [], error
    else:
        refusal = LiveError("none", field="")
    assert str(refusal)
    assert "\n" not in str(refusal)
    assert refusal.field is not None
    assert all(math.isfinite(count.persons) and count.begins.tzinfo is UTC for count in found)


@given(CONTENT, st.sampled_from(["application/json", "application/ld+json"]))
@example([PLAIN], "application/json")
@example(ENTITY, "application/json")
def test_any_json(content: Any, kind: str) -> None:
    understood(json.dumps(content).encode(), kind)


@given(st.binary(max_size=80), st.sampled_from(["application/json", "text/csv"]))
def test_any_bytes(body: bytes, kind: str) -> None:
    understood(body, kind)


CELLS = st.sampled_from(
    ["time", "sensor", "count", "towards", "away", "2025-05-24T12:00", "quay", "12", '"', ""]
) | st.text(max_size=4)


@given(st.lists(st.lists(CELLS, min_size=1, max_size=5), max_size=5), st.sampled_from(",;\t"))
def test_any_rows(table: list[list[str]], between: str) -> None:
    understood("\n".join(between.join(cells) for cells in table).encode("utf-8", "surrogatepass"), "text/csv")
