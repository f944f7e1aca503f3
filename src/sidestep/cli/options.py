"""Options that several commands share, and how their values are checked."""

import math
import os
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cyclopts import Token

    from sidestep.scenarios.model import Scenario


def whole_number(_type: object, tokens: "Sequence[Token]") -> int:
    """A whole number; left alone, the library would round 1.5 to 2 without a word."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a whole number") from error


Whole = partial(Parameter, converter=whole_number)


Hyphened = partial(Parameter, allow_leading_hyphen=True)  # southern latitudes


Seed = Annotated[int, Whole(help="Seed of maps, crowds and training.")]


Json = Annotated[bool, Parameter(name="--json", negative=(), help="Print JSON instead of tables.")]


Out = Annotated[Path, Parameter(help="Folder for what is written; made if it is not there.")]


Workers = Annotated[int | None, Whole(help="Maps at a time; by default one for each processor.")]


PresetOption = Annotated[
    Literal["default", "paper", "dqn", "tabular-q"],
    Parameter(
        name="--preset",
        help="How the agent learns: our way, the paper's settings as printed, or as a baseline (no dueling, double or "
        "priorities; a table).",
    ),
]


LevelOption = Annotated[
    Literal["position", "local", "map", "live"] | None,
    Parameter(name="--level", help="What the agent sees; by default what the scenario says."),
]


Models = Annotated[
    list[Path] | None,
    Parameter(name="--model", negative=(), help="Folder of a trained model; may be given several times."),
]


By = Annotated[float | None, Parameter(name="--by", help="Minutes: how likely is it to arrive within them?")]


ScenarioOption = Annotated[str, Parameter(help="Name of a scenario, such as rush-16, or a scenario file.")]


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """What may be changed of a scenario; None leaves it as it is."""

    flows: Annotated[
        Literal["arima", "forecast"] | None,
        Parameter(name="--flows", help="Crowds with the model's noise, or its forecast."),
    ] = None
    rule: Annotated[
        Literal["integrated", "entry"] | None,
        Parameter(name="--rule", help="Crossing times through all slots, or by the density at entry (the paper)."),
    ] = None
    law: Annotated[
        Literal["power", "power-capped", "weidmann"] | None, Parameter(name="--law", help="Walking speed by density.")
    ] = None
    side: Annotated[int | None, Whole(name="--side", help="Nodes along one side of the grid.")] = None
    crowded_nodes: Annotated[
        int | None, Whole(name="--crowded-nodes", help="Nodes whose streets begin crowded, on grids.")
    ] = None
    crowding: Annotated[
        float | None,
        Parameter(
            name="--crowding", help="Demand over that which was counted, instead of the scenario's; real places."
        ),
    ] = None
    objective: Annotated[
        str | None,
        Parameter(
            name="--objective",
            help="What walkers keep low: time, distance, exposure, or weights, such as exposure=0.5,max_density=4.",
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
        raise SidestepError(f"--{name} must be at least {least}, not {value}")
    return value


def check_minutes(by: float | None, option: str = "by") -> None:
    """Refuse minutes that are not positive."""
    if by is not None and not (math.isfinite(by) and by > 0):
        raise SidestepError(f"--{option} must be a positive number of minutes, not {by}")


def thread_count(workers: int | None) -> int:
    """Threads to run maps on: one for each processor, unless told otherwise."""
    if workers is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    at_least("workers", workers, 1)
    return workers


def start_jax() -> None:
    """Keep compiled programs between runs: compiling takes longer than training."""
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


def hand_over(out: Path | None, show: "Callable[[], None]") -> None:
    """Print, or write what would be printed to a file, whole or not at all."""
    from sidestep.files import write_text

    if out is None:
        show()
        return
    with redirect_stdout(StringIO()) as text:
        show()
    write_text(out, text.getvalue())
