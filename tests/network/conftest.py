"""Small OpenStreetMap files, laid out in metres."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from sidestep.network.osm import ImportReport, import_osm
from sidestep.network.town import Town

DEGREE = 111_195.08  # m, on the equator in both directions: where these towns stand


def osm_text(nodes, ways) -> str:
    """Nodes: number -> (x, y) or (x, y, tags), in metres; ways: number -> (nodes, tags)."""

    def tags(of):
        return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in of.items())

    lines = ["<?xml version='1.0' encoding='UTF-8'?>", '<osm version="0.6">']
    for number, (x, y, *more) in nodes.items():
        place = f'lon="{x / DEGREE:.7f}" lat="{y / DEGREE:.7f}"'
        lines.append(f'<node id="{number}" {place}>{tags(more[0] if more else {})}</node>')
    for number, (refs, of) in ways.items():
        through = "".join(f'<nd ref="{ref}"/>' for ref in refs)
        lines.append(f'<way id="{number}">{through}{tags(of)}</way>')
    return "\n".join([*lines, "</osm>\n"])


@pytest.fixture(scope="session")
def osm():
    return osm_text


@pytest.fixture
def build(tmp_path: Path):
    """The town, and the report, of nodes and ways."""

    def make(nodes, ways, *, merge=0.0, **options) -> tuple[Town, ImportReport]:
        path = tmp_path / "town.osm"
        path.write_text(osm_text(nodes, ways), encoding="utf-8")
        return import_osm(path, merge=merge, **options)

    return make


@pytest.fixture(scope="session")
def listed():
    """Streets as (number of tail, of head, rounded length), the two numbers in order where both ways are walked."""

    def make(town: Town) -> list[tuple[int, int, int]]:
        rows = []
        for tail, head, one_way, length in zip(town.tail, town.head, town.one_way, town.length, strict=True):
            ends = (int(town.ids[tail]), int(town.ids[head]))
            rows.append((*(ends if one_way else sorted(ends)), round(float(length))))
        return sorted(rows)

    return make
