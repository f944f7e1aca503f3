"""Whether a training fits into memory, by the shapes of all that it keeps: known before any of it is worked out."""

from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np

from sidestep.agent.config import TrainConfig, TrainConfigError
from sidestep.agent.train import prepare
from sidestep.programs import bytes_of
from sidestep.scenarios.episodes import DRAWS
from sidestep.scenarios.maps import ScenarioMap
from sidestep.scenarios.model import Scenario

GB = 1e9
REMEDIES = {
    "level": "choose level map, or fewer futures, longer slots or a shorter horizon",
    "futures": "choose fewer futures, longer slots or a shorter horizon",
    "destinations": "choose fewer destinations, longer slots or a shorter horizon",
    "capacity": "choose a replay of less capacity",
}
"""What to change, by the setting that most of the memory is needed for."""


def bytes_needed(config: TrainConfig, scenario: Scenario, scenario_map: ScenarioMap) -> dict[str, int]:
    """How much memory the largest things take that a training keeps.

    Parameters
    ----------
    config, scenario, scenario_map
        How, what and where to learn.

    Returns
    -------
    dict of int
        Bytes of the costs to go of level live, of the futures' speeds, of the expected costs to go and of the replay,
        by the setting that decides on them. Futures take twice their size where they are renewed, since those of the
        next round are drawn during the one before.
    """
    draws = np.zeros((config.walkers, DRAWS), np.float32)
    problem, _, state = prepare.shapes(config, scenario, scenario_map, draws)
    futures, times = problem.params.futures, 2 if config.fresh_futures else 1
    return {
        "level": times * bytes_of(futures.cost_to_go),
        "futures": times * bytes_of(futures.speeds),
        "destinations": bytes_of(problem.params.cost_to_go),
        "capacity": bytes_of(state.replay),
    }


def check_memory(config: TrainConfig, scenario: Scenario, scenario_map: ScenarioMap) -> None:
    """Refuse a training that does not fit into memory; else it would end in the middle of its work.

    Raises
    ------
    TrainConfigError
        Its field is the setting that most of the memory is needed for.
    """
    parts, available = bytes_needed(config, scenario, scenario_map), bytes_available()
    if available is None or (needed := sum(parts.values())) <= available:
        return
    field = max(parts, key=lambda name: parts[name])
    said = f"training at level {config.level} on {scenario_map.network.nodes:,} crossings needs at least"
    said = f"{said} {needed / GB:.1f} GB, but {available / GB:.1f} GB of memory are free"
    raise TrainConfigError(f"{said}; {REMEDIES[field]}", field=field)


def bytes_available() -> int | None:
    """Memory in bytes that arrays may take, on the device or else as Linux and the limits of containers have it."""
    stats = jax.devices()[0].memory_stats()
    if stats is not None and "bytes_limit" in stats:
        return int(stats["bytes_limit"] - stats.get("bytes_in_use", 0))
    try:
        free = _numbers(Path("/proc/meminfo"))["MemAvailable:"] * 1024
        groups = Path("/proc/self/cgroup").read_text("utf-8")
    except (OSError, KeyError, ValueError):  # of other systems it is not known
        return None
    return min([free, *_left_by_groups(groups)])


def _left_by_groups(groups: str, mounted: Path = Path("/sys/fs/cgroup")) -> Iterator[int]:
    """What the control groups of a process leave it, and those around them: a job of Slurm's, a container."""
    for line in groups.splitlines():
        _, kinds, group = line.split(":", 2)
        if "memory" in kinds.split(","):  # of version 1
            top, most, used = mounted / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
        elif not kinds:
            top, most, used = mounted, "memory.max", "memory.current"
        else:
            continue
        inner = top / group.lstrip("/")
        for folder in (inner, *inner.parents):
            try:
                limit, taken = (int((folder / name).read_text("ascii")) for name in (most, used))
                of_files = _numbers(folder / "memory.stat")
            except (OSError, ValueError):  # "max"; the group's folder is not to be seen from within a container
                continue
            # What files take in memory goes when others need it; "total_" counts the groups within.
            total = "total_" if "total_inactive_file" in of_files else ""
            yield limit - taken + sum(of_files.get(f"{total}{name}_file", 0) for name in ("active", "inactive"))


def _numbers(file: Path) -> dict[str, int]:
    """The numbers of a file with a name and a number in each line."""
    lines = (line.split() for line in file.read_text("ascii").splitlines())
    return {name: int(number) for name, number, *_ in lines}
