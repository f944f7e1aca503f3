"""The examples with learners of one's own."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("name", ["own_q_learning", "own_jax_learner"])
def test_learners_of_ones_own_come_near_the_best_walk(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / f"{name}.py"))
    minutes, _, arrived = capsys.readouterr().out.split(maxsplit=2)
    assert arrived.strip() == "arrived"
    assert int(minutes) <= 90  # the best walk takes 69 minutes, the shortest one 166
