"""Files of places."""

import pytest

from sidestep.routing.places import read_places


@pytest.mark.parametrize(
    ("line", "place", "label"),
    [
        ("7", 7, ""),
        ("7,,corner", 7, "corner"),
        ("60.17,24.94", (60.17, 24.94), ""),
        ("60.17, 24.94, Market square", (60.17, 24.94), "Market square"),
        ("60.17,24.94,Market square,east", (60.17, 24.94), "Market square"),
        ('"60.17,24.94","Market square, east"', (60.17, 24.94), "Market square, east"),
        ('60.17,24.94,"Market square, east"', (60.17, 24.94), "Market square, east"),
        ("-33.86,151.21,,", (-33.86, 151.21), ""),
    ],
)
def test_a_line_is_a_place_and_its_name(tmp_path, line: str, place: object, label: str) -> None:
    file = tmp_path / "places.csv"
    file.write_text(f"latitude,longitude,name\n{line}\n\n# the end\n")
    (found,) = read_places("origins", file)
    assert (found.place, found.label, found.line) == (place, label, 2)
