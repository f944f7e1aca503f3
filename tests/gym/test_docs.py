"""The page about learners of one's own: its code runs, and its tables are those of the code."""

import doctest
import re
from pathlib import Path

import pytest

from sidestep.gym import IDS, EnvOptions, Task, VectorOptions, WalkEnv, WalkVectorEnv, make_task
from sidestep.gym.features import EXIT, STATE
from sidestep.gym.gymnax import GymnaxEnv

STAR = r" \*"
PAGE = (Path(__file__).parents[2] / "docs" / "gymnasium.md").read_text(encoding="utf-8")


def test_the_code_runs() -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    ours = [block for block in blocks if "sb3" not in block]
    assert len(ours) == len(blocks) - 1
    exec("".join(ours), {})  # noqa: S102


@pytest.mark.parametrize("features", [STATE, EXIT])
def test_the_tables_list_all_features_in_order(features: tuple) -> None:
    rows = [
        f"| `{one.name}` | {one.level}{STAR * one.interpolated} | {one.low:g} to {one.high:g} | {one.meaning} |"
        for one in features
    ]
    assert "\n".join(rows) in PAGE


@pytest.mark.parametrize("documented", [WalkEnv, WalkVectorEnv, Task, make_task, GymnaxEnv])
def test_examples_run(documented: object) -> None:
    name = documented.__name__
    (found,) = (one for one in doctest.DocTestFinder(recurse=False).find(documented, name) if one.examples)
    assert doctest.DocTestRunner().run(found).failed == 0


def test_all_ids_and_arguments_are_listed() -> None:
    named = set(re.findall(r"`([\w/-]+)`", PAGE))
    assert set(IDS) | set(IDS.values()) <= named
    assert set(EnvOptions.model_fields) | set(VectorOptions.model_fields) - {"num_envs"} <= named
