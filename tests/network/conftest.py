"""Small OpenStreetMap files, laid out in metres."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from sidestep.network.osm import ImportReport, import_osm
from sidestep.network.town import Town

DEGREE = 111_195.08  # m, on the equator in both directions: where these towns stand


def osm_text(nodes, ways, relations=()) -> str:
    """Nodes: number -> (x, y) or (x, y, tags), in metres; ways: number -> (nodes, tags).

    Relations: (ways with their roles, tags), numbered from 1.
    """

    def tags(of):
        return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in of.items())

    lines = ["<?xml version='1.0' encoding='UTF-8'?>", '<osm version="0.6">']
    for number, (x, y, *more) in nodes.items():
        place = f'lon="{x / DEGREE:.7f}" lat="{y / DEGREE:.7f}"'
        lines.append(f'<node id="{number}" {place}>{tags(more[0] if more else {})}</node>')
    for number, (refs, of) in ways.items():
        through = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        lines.append(f'<way id="{number}">{through}{tags(of)}</way>')
    for number, (members, of) in enumerate(relations, 1):
        named = "".join(f'<member type="way" ref="{ref}" role="{role}"/>' for ref, role in members)
        lines.append(f'<relation id="{number}">{named}{tags({"type": "multipolygon", **of})}</relation>')
    return "\n".join([*lines, "</osm>\n"])


@pytest.fixture(scope="session")
def osm():
    return osm_text


@pytest.fixture(scope="session")
def tee():
    """A T: 1 --100-- 2 --150-- 3, and 4 is 80 above 2."""
    nodes = {1: (0, 0), 2: (100, 0), 3: (250, 0), 4: (100, 80)}
    ways = {
        10: ((1, 2, 3), {"highway": "residential", "name": "High Street", "width": "9"}),
        11: ((2, 4), {"highway": "path", "width": "1.8 m"}),
    }
    return nodes, ways


@pytest.fixture
def build(tmp_path: Path):
    """Import nodes and ways."""

    def make(nodes, ways, relations=(), *, merge=0.0, **options) -> tuple[Town, ImportReport]:
        path = tmp_path / "town.osm"
        path.write_text(osm_text(nodes, ways, relations), encoding="utf-8")
        return import_osm(path, merge=merge, **options)

    return make


@pytest.fixture(scope="session")
def listed():
    """List streets as (number of tail, of head, rounded length), the numbers in order where both ways are walked."""

    def make(town: Town) -> list[tuple[int, int, int]]:
        rows = []
        for tail, head, one_way, length in zip(town.tail, town.head, town.one_way, town.length, strict=True):
            ends = (int(town.ids[tail]), int(town.ids[head]))
            rows.append((*(ends if one_way else sorted(ends)), round(float(length))))
        return sorted(rows)

    return make


@pytest.fixture
def town(build) -> Town:
    """Four streets, one of them one-way, with bends, a crossing and names that are hard to quote."""
    foot = {"highway": "footway"}
    nodes = {1: (0, 0), 2: (100, 0), 3: (250, 10), 4: (100, 80), 5: (40, 90, {"highway": "crossing"}), 6: (250, 90)}
    ways = {
        1: ((1, 2, 3), {"highway": "residential", "name": 'Ann\'s <"Way"> & ☕'}),
        2: ((2, 4), {**foot, "oneway": "yes", "width": "12'"}),
        3: ((4, 5, 1), foot),
        4: ((4, 6, 3), {**foot, "name": "Long Walk"}),
    }
    return build(nodes, ways)[0]
