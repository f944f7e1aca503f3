"""On which lines statements of a TOML document stand."""

import pytest

from sidestep.scenarios.toml_lines import line_of


@pytest.mark.parametrize(
    ("text", "keys", "line"),
    [
        ("x = 1\n[" + ".".join("a" * 300) + "]\ny = 1\n", ("a",), 2),
        ("x = 1\n[[a.b]]\nc = 1\n[[a.b]]\n", ("a", "b"), 2),
        ("a = [\n" + "[1, 2],\n" * 1900 + "]\nb = 1\n", ("b",), 1903),
        ("a = 1", ("b", "c"), 1),
        ("a = 1\n[b]\nc = 2", ("b", "d"), 2),  # the nearest that there is
        ("a = { b = 1, c = 2 }", ("a", "c"), 1),
        ("\n'a' . b = 1", ("a", "b"), 2),
        ('a = """\nb = 1"""\nb = 2', ("b",), 3),
    ],
)
def test_lines(text: str, keys: tuple[str, ...], line: int) -> None:
    assert line_of(text, keys) == line
