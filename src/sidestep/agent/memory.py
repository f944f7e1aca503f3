"""Whether a training fits into memory, by the shapes of all that it keeps: known before any of it is worked out."""

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
    """Memory in bytes that arrays may take, on the device or else as Linux and the container's limit have it."""
    stats = jax.devices()[0].memory_stats()
    if stats is not None and "bytes_limit" in stats:
        return int(stats["bytes_limit"] - stats.get("bytes_in_use", 0))
    try:
        text = Path("/proc/meminfo").read_text("ascii")
    except OSError:  # of other systems it is not known
        return None
    free = [1024 * int(text.partition("MemAvailable:")[2].split()[0])]
    for limit in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        path = Path(limit)
        if path.exists() and (number := path.read_text("ascii").strip()).isdecimal():  # or "max"
            free.append(int(number))
    return min(free)
