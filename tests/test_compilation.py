"""What is compiled is kept from process to process, for the Python API as for the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

USE = """
import json, jax
{before}
import sidestep
names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
imported = [jax.config.values[name] for name in names]
problem = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
sidestep.draw_map(problem, seed=0)
jax.jit(lambda number: 2 * number + 3)(1.0)
print(json.dumps([imported, [jax.config.values[name] for name in names]]))
"""


def used(home: Path, before: str = "", **more: str) -> list:
    """Settings after the import, and after a map was drawn, in a process of its own."""
    told = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    done = subprocess.run(
        [sys.executable, "-c", USE.format(before=before)],
        env={**told, "XDG_CACHE_HOME": str(home), **more},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return json.loads(done.stdout)


def test_programs_are_kept_where_only_their_owner_may_write(tmp_path) -> None:
    imported, drawn = used(tmp_path)
    folder = tmp_path / "sidestep" / "jax"
    assert imported == [None, 1.0]  # importing changes nothing
    assert drawn == [str(folder), 0.0]
    assert folder.stat().st_mode & 0o777 == 0o700
    assert any(folder.iterdir())


@pytest.mark.parametrize(
    ("before", "more"),
    [
        ("jax.config.update('jax_compilation_cache_dir', 'OWN')", {}),
        ("", {"JAX_COMPILATION_CACHE_DIR": "OWN"}),
    ],
)
def test_who_names_another_folder_gets_it(tmp_path, before: str, more: dict[str, str]) -> None:
    own = str(tmp_path / "own")
    found = used(tmp_path, before.replace("OWN", own), **dict.fromkeys(more, own))
    assert found == [[own, 1.0]] * 2
    assert not (tmp_path / "sidestep").exists()


def test_who_wants_no_cache_gets_none(tmp_path) -> None:
    assert used(tmp_path, "jax.config.update('jax_enable_compilation_cache', False)") == [[None, 1.0]] * 2


def test_without_a_folder_to_write_to_programs_are_compiled_all_the_same(tmp_path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    assert used(blocked) == [[None, 1.0]] * 2
