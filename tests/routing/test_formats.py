"""Plain tables."""

from sidestep.routing.formats import table


def test_tables_are_aligned() -> None:
    rows = [("head east", "Long Street", "250"), ("arrive", "", "")]
    assert table(("", "street", ">metres"), rows) == [
        "           street       metres",
        "head east  Long Street     250",
        "arrive",
    ]
