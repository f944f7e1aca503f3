"""The names in ``sidestep.__all__``: there, documented with examples that run, and typed."""

import ast
import doctest
import subprocess
import sys
from pathlib import Path

import pytest

import sidestep

ROOT = Path(__file__).parents[1]
DATA = {"PRESETS", "SidestepError"}  # a dictionary has no docstring of its own, an error no example


@pytest.mark.parametrize("name", sorted(set(sidestep.__all__) - DATA))
def test_examples_run(name: str) -> None:
    found = [test for test in doctest.DocTestFinder(recurse=False).find(getattr(sidestep, name), name) if test.examples]
    assert len(found) == 1
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(found[0]).failed == 0


def test_all_names_resolve() -> None:
    for name in sidestep.__all__:
        assert getattr(sidestep, name) is not None
    assert set(sidestep.__all__) <= set(dir(sidestep))
    with pytest.raises(AttributeError):
        sidestep.no_such_name  # noqa: B018


def test_import_loads_nothing_heavy() -> None:
    code = "import sys, sidestep; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"jax", "numpy", "pandas", "pydantic", "shapely", "matplotlib", "cyclopts"} & set(loaded)


def test_type_checkers_see_the_public_names() -> None:
    # `make check` runs mypy on the file; here only that it uses every name.
    tree = ast.parse((ROOT / "tests" / "typing" / "user.py").read_text(encoding="utf-8"))
    used = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert set(sidestep.__all__) <= used
