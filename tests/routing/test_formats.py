"""Plain tables, and lines on the globe."""

from xml.etree import ElementTree as ET

from sidestep.routing.formats import GpxRoute, Waypoint, feature, gpx, table


def test_tables_are_aligned() -> None:
    rows = [("head east", "Long Street", "250"), ("arrive", "", "")]
    assert table(("", "street", ">metres"), rows) == [
        "           street       metres",
        "head east  Long Street     250",
        "arrive",
    ]


def test_lines_across_the_antimeridian_are_split() -> None:
    whole = feature("LineString", [[179.9, 0.0], [-179.9, 0.2]], part="route")
    assert whole["geometry"] == {
        "type": "MultiLineString",
        "coordinates": [[[179.9, 0.0], [180.0, 0.1]], [[-180.0, 0.1], [-179.9, 0.2]]],
    }
    track = [Waypoint(place, 0.0) for place in ([179.9, 0.0], [-179.9, 0.2])]
    bounds = ET.fromstring(gpx("", "", "", None, [GpxRoute("", "", track, track)])).find(".//{*}bounds")  # noqa: S314 - our own
    assert bounds is not None
    assert [round(float(bounds.get(side, "")), 4) for side in ("minlon", "maxlon")] == [179.9, -179.9]
