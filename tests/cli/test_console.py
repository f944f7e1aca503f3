"""Text on terminals and in pipes."""

import pytest

from sidestep.cli.console import print_text

SOURCES = "Streets: © somebody [ODbL 1.0]. Crowds: counts of a city :walking: that says whose they are, and why."


@pytest.mark.parametrize("width", [40, 80])
def test_lines_are_wrapped_between_words_where_the_width_is_known(capsys, monkeypatch, width: int) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    print_text(f"   street  metres\n\n{SOURCES}\n")
    first, empty, *lines = capsys.readouterr().out.removesuffix("\n").split("\n")
    assert (first, empty) == ("   street  metres", "")
    assert max(map(len, lines)) <= width
    assert " ".join(line.strip() for line in lines) == SOURCES


def test_pipes_get_whole_lines(capsys, monkeypatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    print_text(f"{SOURCES}\n")
    print_text(SOURCES)
    assert capsys.readouterr().out == f"{SOURCES}\n" * 2
