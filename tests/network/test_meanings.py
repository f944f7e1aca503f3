from sidestep.network.meanings import meanings, way_name
from sidestep.network.tags import WIDTHS


def test_ways_that_differ_in_their_names_alone_are_looked_at_once() -> None:
    meaning = meanings(WIDTHS)
    footway = {"highway": "footway", "width": "2.5"}
    said = meaning({**footway, "name": "Aleksanterinkatu"})
    assert said is meaning({"width": "2.5", "highway": "footway", "is_sidepath:of:name": "Esplanadi"})
    assert (said.kind, said.width, said.excluded) == ("footway", 2.5, None)
    assert meaning({**footway, "width": "2"}).width == 2


def test_widths_of_the_table_are_those_of_one_import() -> None:
    path = {"highway": "path"}
    assert meanings({**WIDTHS, "path": 7.0})(path).width == 7
    assert meanings(WIDTHS)(path).width == WIDTHS["path"]


def test_measures_that_cannot_be_read_are_noted() -> None:
    said = meanings(WIDTHS)({"highway": "footway", "width": "wide", "incline": "up", "kerb": "?"})
    assert [note.split()[2] for note in said.notes] == ["width", "without", "kerb"]
    assert meanings(WIDTHS)({"highway": "bus_guideway", "width": "wide"}).excluded == "way: not a walkable kind"


def test_ways_have_their_own_name_or_that_of_their_street() -> None:
    assert way_name({"name": " Main\u200b Street\n", "is_sidepath:of:name": "Side Street"}) == "Main Street"
    assert way_name({"name": "", "is_sidepath:of:name": "Side Street"}) == "Side Street"
    assert len(way_name({"name": "x" * 300})) == 255
    assert way_name({}) == ""
