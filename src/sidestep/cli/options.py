"""Options that several commands share, and the checks of their values."""

import math
import os
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cyclopts import Token

    from sidestep.scenarios.model import Scenario


def whole_number(_type: object, tokens: "Sequence[Token]") -> int:
    """Read a whole number; the library itself would silently round 1.5 to 2."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a whole number") from error


Whole = partial(Parameter, converter=whole_number)

Hyphened = partial(Parameter, allow_leading_hyphen=True)
"""For values such as southern latitudes."""

ScenarioOption = Annotated[
    str, Parameter(help="Name of a scenario, such as rush-16 (see sidestep scenarios), or a scenario file.")
]
Seed = Annotated[int, Whole(help="Seed of maps, crowds and training.")]
Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print JSON instead of tables.")]
Out = Annotated[Path, Parameter(help="Folder to write to; it is made if missing.")]
Workers = Annotated[int | None, Whole(help="Maps to walk at a time; by default one for each processor.")]
By = Annotated[float | None, Parameter(name="--by", help="Minutes: say how likely it is to arrive within them.")]
Models = Annotated[
    list[Path] | None, Parameter(name="--model", negative=(), help="Folder of a trained model; repeat it for several.")
]
LevelOption = Annotated[
    Literal["position", "local", "map", "live"] | None,
    Parameter(name="--level", help="Level of the agent's knowledge; by default the scenario's."),
]
PresetOption = Annotated[
    Literal["default", "paper", "dqn", "tabular-q"],
    Parameter(
        name="--preset",
        help="Settings of the learner: ours, the paper's as printed, or those of a baseline (plain DQN; a table).",
    ),
]


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """Changes to a scenario; None leaves a field as it is."""

    flows: Annotated[
        Literal["arima", "forecast"] | None,
        Parameter(name="--flows", help="Draw crowds with the model's noise, or take its forecast."),
    ] = None
    rule: Annotated[
        Literal["integrated", "entry"] | None,
        Parameter(
            name="--rule", help="Integrate crossing times over all slots, or keep the density at entry (the paper)."
        ),
    ] = None
    law: Annotated[
        Literal["power", "power-capped", "weidmann"] | None, Parameter(name="--law", help="Walking speed by density.")
    ] = None
    side: Annotated[int | None, Whole(name="--side", help="Nodes along a side of the grid.")] = None
    crowded_nodes: Annotated[
        int | None, Whole(name="--crowded-nodes", help="Nodes whose streets begin crowded; on grids.")
    ] = None
    crowding: Annotated[
        float | None, Parameter(name="--crowding", help="Demand as a multiple of the counts; in real places.")
    ] = None
    objective: Annotated[
        str | None,
        Parameter(
            name="--objective",
            help="Keep time, distance, exposure or a weighted sum low, such as exposure=0.5,max_density=4.",
        ),
    ] = None


UNCHANGED = Changes()


def read_scenario(name: str, changes: Changes) -> "Scenario":
    """Find a scenario by its name or file, with the options applied."""
    from sidestep.scenarios.reader import find_scenario

    return find_scenario(name, **{field: value for field, value in asdict(changes).items() if value is not None})


def at_least(name: str, value: int, least: int) -> int:
    """Refuse an option below its least value."""
    if value < least:
        raise SidestepError(f"--{name} must be at least {least}, not {value}", field=name)
    return value


def check_minutes(by: float | None, option: str = "by") -> None:
    """Refuse minutes that are not positive."""
    if by is not None and not (math.isfinite(by) and by > 0):
        raise SidestepError(f"--{option} must be a positive number of minutes, not {by}", field=option)


def names_in(text: str | None) -> list[str] | None:
    """Split names with commas between them; None stays None."""
    return None if text is None else [name.strip() for name in text.split(",")]


def thread_count(workers: int | None) -> int:
    """Count the threads to walk maps on: by default one for each processor."""
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    at_least("workers", workers, 1)
    return workers


def start_jax() -> None:
    """Let JAX keep compiled programs between runs: compiling takes longer than training."""
    import jax

    settings: dict[str, object] = {
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        settings["jax_compilation_cache_dir"] = str(Path(home) / "sidestep" / "jax")
    for name, value in settings.items():
        jax.config.update(name, value)  # type: ignore[no-untyped-call]
