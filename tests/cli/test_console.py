"""Text and tables on terminals and in pipes."""

import re

import pytest

from sidestep.cli.console import print_table, print_text, progress

SOURCES = "Streets: © somebody [ODbL 1.0]. Crowds: counts of a city :walking: that says whose they are, and why."


@pytest.mark.parametrize("width", [40, 80])
def test_lines_are_wrapped_between_words_where_the_width_is_known(capsys, monkeypatch, width: int) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    print_text(f"   street  metres\n\n{SOURCES}\n")
    first, empty, *lines = capsys.readouterr().out.removesuffix("\n").split("\n")
    assert (first, empty) == ("   street  metres", "")
    assert max(map(len, lines)) <= width
    assert " ".join(line.strip() for line in lines) == SOURCES


def test_numbers_stay_with_their_units(capsys, monkeypatch) -> None:
    text = "median 18.7 min, 90 % within 24.9 min, 100.0 % arrive; demand 120 × counts, 1,001 person·s/m² met, 5 10 15"
    for width in range(20, 80):
        monkeypatch.setenv("COLUMNS", str(width))
        print_text(text)
        lines = capsys.readouterr().out.splitlines()
        assert " ".join(lines) == text
        assert max(map(len, lines)) <= width
        for line in lines[:-1]:
            assert not line[-1].isdecimal() or line.endswith(("5", "10")), line


def test_pipes_get_whole_lines(capsys, monkeypatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    print_text(f"{SOURCES}\n")
    print_text(SOURCES)
    assert capsys.readouterr().out == f"{SOURCES}\n" * 2


# --- Tables ---------------------------------------------------------------------------------------------------------

COLUMNS = ("planner", "knows", ">minutes", ">over the clairvoyant", "use")
ROWS = [("a-planner-with-a-long-name", "map", "1,234.5", "12.34 %", "[always] when there is a map, and time to look")]


def table(*expendable: str) -> None:
    print_table(["a title", ""], COLUMNS, ROWS, expendable)


@pytest.mark.parametrize(
    ("width", "left_out"),
    # 26 + 5 + 7 + 11 and at least 20 columns, with 3 between each and 4 at the edges: 85 in all.
    [
        (85, ""),
        (84, "minutes"),
        (75, "minutes"),
        (74, "knows, minutes"),
        (67, "knows, minutes"),
        (66, "knows, minutes, use"),
    ],
)
def test_the_least_important_columns_are_left_out_first(screen, width: int, left_out: str) -> None:
    lines = screen(width, lambda: table("minutes", "knows", "use"))
    assert lines[0] == "a title"
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    _, said, names = text.partition("Left out: ")
    assert names == (left_out and f"{left_out}. A wider terminal or --json shows them.")
    assert bool(said) == bool(left_out)
    assert any(line.startswith("  a-planner-with-a-long-name  ") for line in lines)
    for heading, cell in (("minutes", "1,234.5"), ("knows", " map "), ("use", "[always]"), ("gap", "12.34 %")):
        assert (cell in text) == (heading not in left_out)


@pytest.mark.parametrize("width", [10, 40])
def test_names_and_numbers_stay_whole_on_any_terminal(screen, width: int) -> None:
    text = "\n".join(screen(width, lambda: table("minutes", "knows", "use", "of no column")))
    assert "a-planner-with-a-long-name" in text
    assert "12.34 %" in text
    assert "minutes" not in text.partition("Left out")[0]


def test_columns_that_are_not_expendable_stay(screen) -> None:
    text = " ".join(" ".join(screen(40, table)).split())
    for word in ("a-planner-with-a-long-name", "map", "1,234.5", "12.34 %", "[always] when", "look"):
        assert word in text
    assert "Left out" not in text


@pytest.mark.parametrize("columns", [None, "40"])
def test_pipes_get_all_columns(capsys, monkeypatch, columns: str | None) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns:
        monkeypatch.setenv("COLUMNS", columns)
    table(*(column.removeprefix(">") for column in COLUMNS))
    out = capsys.readouterr().out
    assert "Left out" not in out
    assert all(cell in out for cell in ROWS[0][:4])
    assert (ROWS[0][4] in out) == (columns is None)  # wrapped, if COLUMNS says so


# --- Progress -------------------------------------------------------------------------------------------------------


def walk() -> None:
    with progress("comparing", 1_200, "walks") as advance:
        advance("map 0, darp", 0)
        advance("map 0, darp", 300)
        advance("map 0, shortest-path")


def test_a_bar_has_a_rate_and_a_remaining_time(screen) -> None:
    text = " ".join(" ".join(screen(80, walk)).split())
    assert "301/1,200 walks" in text
    assert re.search(r" [\d.,]+/s, \d+:\d\d:\d\d left ", text)
    assert "map 0, shortest-path" in text


def test_there_is_no_bar_in_pipes(capsys) -> None:
    walk()
    assert capsys.readouterr() == ("", "")
