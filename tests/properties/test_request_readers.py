"""Whatever people write or draw, readers of requests understand it or say in one sentence why not."""

from collections.abc import Callable
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from sidestep.errors import SidestepError
from sidestep.network.formats import load_helsinki
from sidestep.network.polygons import read_polygons
from sidestep.routing.clocks import TownClock
from sidestep.routing.places import read_places
from sidestep.routing.request import read_departure, read_place

NUMBER = st.floats() | st.integers() | st.sampled_from([24.94, 60.17, 0])
PLAIN = st.none() | st.booleans() | NUMBER | st.text(max_size=5)
KIND = st.sampled_from(
    ["Polygon", "MultiPolygon", "Feature", "FeatureCollection", "GeometryCollection", "Point", "LineString", ""]
)
RING = st.lists(st.lists(NUMBER, min_size=1, max_size=3), max_size=6).map(lambda ring: ring + ring[:1])


def objects(inner: st.SearchStrategy) -> st.SearchStrategy:
    content = inner | st.lists(inner, max_size=3) | st.lists(RING, max_size=3) | st.lists(st.lists(RING), max_size=2)
    members = dict.fromkeys(("coordinates", "geometry", "geometries", "features"), content)
    return st.fixed_dictionaries({"type": KIND | PLAIN}, optional=members)


def understood(read: Callable[[], Any], field: str | None = None) -> Any:
    """What a reader returns; None where it refuses, which it must do in one sentence about the field."""
    try:
        return read()
    except SidestepError as error:
        refusal = error
    assert str(refusal)
    assert "\n" not in str(refusal)
    assert refusal.field == field or field is None
    return None


@given(objects(st.recursive(PLAIN, objects, max_leaves=6)))
def test_areas(content: dict) -> None:
    understood(lambda: read_polygons(content, load_helsinki()))


@given(st.text(max_size=30) | st.from_regex(r"[A-Za-z]{0,9}\.? ?\d{1,2}:\d{2}(:\d{2})?|[-0-9T:+Z ]{0,25}"))
def test_times(text: str) -> None:
    asked = understood(lambda: read_departure(text, "until"), "until")
    ahead = understood(lambda: TownClock(100.0, 0).clock(asked, "until"), "until")
    assert ahead is None or 0 <= ahead < 168 * 3600


@given(st.text(max_size=60) | st.from_regex(r"([-+]?\d{1,3}(\.\d{1,5})?[,; ]){1,3}"))
def test_places(text: str) -> None:
    understood(lambda: read_place("origin", text), "origin")


@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_files_of_places(tmp_path_factory, content: bytes) -> None:
    file = tmp_path_factory.getbasetemp() / "places.csv"
    file.write_bytes(content)
    found = understood(lambda: read_places("origins", file), "origins")
    assert found is None or len(found) > 0
