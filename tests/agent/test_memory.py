"""Trainings that do not fit into memory are refused before they begin."""

from pathlib import Path

import jax
import numpy as np
import pytest

from sidestep.agent import memory
from sidestep.agent.config import TrainConfigError
from sidestep.agent.memory import _left_by_groups, bytes_available, bytes_needed
from sidestep.agent.presets import preset
from sidestep.agent.runs import train
from sidestep.agent.train import prepare
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import DRAWS
from sidestep.scenarios.maps import draw_training_map

PROBLEM = scenario("rush-16", side=3, crowded_nodes=1, horizon=3600.0)
CONFIG = preset("default", "live").changed(
    rounds=2, round_steps=64, walkers=16, batch=16, capacity=64, hidden=(8,), n_step=3, futures=5, fresh_futures=2,
    test_walks=2, destinations=2,
)  # fmt: skip


def test_the_estimate_is_what_is_kept() -> None:
    here = draw_training_map(PROBLEM, 0, 0)
    problem, _, state = prepare(CONFIG, PROBLEM, here, np.zeros((CONFIG.walkers, DRAWS), np.float32))

    def nbytes(tree: object) -> int:
        return sum(leaf.nbytes for leaf in jax.tree.leaves(tree))

    futures = problem.params.futures
    kept = [2 * nbytes(futures.cost_to_go), 2 * nbytes(futures.speeds), nbytes(problem.params.cost_to_go)]
    needed = bytes_needed(CONFIG, PROBLEM, here)
    assert [*needed.values()] == [*kept, nbytes(state.replay)]
    nodes, segments, slots = here.network.nodes, here.network.segments, PROBLEM.slots
    assert needed["level"] == 2 * 4 * (5 + 2) * slots * (nodes + 2 * segments)
    assert needed["destinations"] == 4 * (2 * slots * nodes + nodes)
    assert bytes_needed(CONFIG.changed(level="map", fresh_futures=0), PROBLEM, here)["level"] == 0


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("level", {"level": "live"}),
        ("futures", {"level": "local"}),
        ("capacity", {"level": "local", "capacity": 2**16}),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_written(
    field: str, changes: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "bytes_available", lambda: 1000)
    with pytest.raises(TrainConfigError) as refused:
        train(PROBLEM, CONFIG.changed(**{"destinations": 1, **changes}), out=tmp_path / "out")
    assert refused.value.field == field
    assert not (tmp_path / "out").exists()


def test_what_is_free_is_less_than_there_is() -> None:
    free, words = bytes_available(), Path("/proc/meminfo").read_text("ascii").split()
    assert free is not None
    assert 0 < free <= 1024 * int(words[words.index("MemTotal:") + 1])


@pytest.mark.parametrize(
    ("told", "folder", "most", "used", "total"),
    [
        ("0::/slurm/job/step", "", "memory.max", "memory.current", ""),
        ("4:cpu:/\n3:memory:/slurm/job/step", "memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_"),
    ],
)
def test_limits_of_all_groups_around_count(
    told: str, folder: str, most: str, used: str, total: str, tmp_path: Path
) -> None:
    top = tmp_path / folder
    for group, limit, taken, of_files in (("slurm/job", "1000", "700", "200"), ("", "900", "800", "5")):
        (top / group).mkdir(parents=True, exist_ok=True)
        (top / group / most).write_text(f"{limit}\n")
        (top / group / used).write_text(f"{taken}\n")
        (top / group / "memory.stat").write_text(f"{total}active_file {of_files}\n{total}inactive_file 0\n")
    (top / "slurm" / most).write_text("max\n")
    assert [*_left_by_groups(told, tmp_path)] == [500, 105]
