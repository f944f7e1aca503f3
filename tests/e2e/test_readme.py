"""The README's example is the one that the tests can vouch for."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_readmes_example_is_the_example() -> None:
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    example = (ROOT / "examples" / "plan_a_walk.py").read_text(encoding="utf-8")
    assert example.endswith(block)


def test_the_example_runs() -> None:
    done = subprocess.run([sys.executable, ROOT / "examples" / "plan_a_walk.py"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"darp: \d+ min over 0 [\d ]*35\nclairvoyant: \d+ min over 0 [\d ]*35\n", done.stdout)
