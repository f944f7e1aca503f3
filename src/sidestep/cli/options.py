"""Options that several commands share, and the checks of their values.

The help of an option is its description in the docstring of its command, or stands here if commands share it.
"""

import math
import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from sidestep.errors import SidestepError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from _typeshed import DataclassInstance
    from cyclopts import Token

    from sidestep.crowds.layouts import Layout
    from sidestep.scenarios.model import Scenario


def whole_number(_type: object, tokens: "Sequence[Token]") -> int:
    """Read a whole number; the library itself would silently round 1.5 to 2."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError as error:
        raise ValueError(f"{text!r} is not a whole number") from error


Whole = Annotated[int, Parameter(converter=whole_number)]
Flag = Annotated[bool, Parameter(negative=())]
ScenarioOption = Annotated[
    str, Parameter(help="Name of a scenario, such as rush-16 (see sidestep scenarios), or a scenario file.")
]
MapNumber = Annotated[Whole, Parameter(name="--map", help="Number of the map.")]
Seed = Annotated[Whole, Parameter(help="Seed of maps, crowds and training.")]
Json = Annotated[Flag, Parameter(name="--json", help="Print JSON instead of tables.")]
Out = Annotated[Path, Parameter(help="Folder to write to; it is made if missing, but none above it.")]
Workers = Annotated[Whole | None, Parameter(help="Maps to walk at a time; by default one for each processor.")]
Processes = Annotated[Whole | None, Parameter(help="Processes on this machine; by default one for each processor.")]
Scheduler = Annotated[
    str | None, Parameter(help="Address of a Dask scheduler whose workers do the jobs, such as tcp://host:8786.")
]
ResultsOut = Annotated[
    Path | None, Parameter(help="File for the results as a table, .csv or .parquet: a row for each planner.")
]
By = Annotated[float | None, Parameter(help="Minutes: say how likely it is to arrive within them.")]
Rule = Annotated[
    Literal["integrated", "entry"],
    Parameter(help="Integrate crossing times over all slots, or keep the density at entry (the paper)."),
]
Law = Literal["power", "power-capped", "weidmann"]
LevelOption = Annotated[
    Literal["position", "local", "map", "live"] | None,
    Parameter(help="Level of the agent's knowledge; by default the scenario's."),
]
PresetOption = Annotated[
    Literal["default", "paper", "dqn", "tabular-q"],
    Parameter(
        help="Settings of the learner: ours, the paper's as printed, or those of a baseline (plain DQN; a table)."
    ),
]


@Parameter(name="*")
@dataclass(frozen=True)
class Changes:
    """Changes to a scenario; None leaves a field as it is."""

    flows: Literal["arima", "forecast"] | None = None
    """Draw crowds with the model's noise, or take its forecast."""

    rule: Rule | None = None

    law: Law | None = None
    """Walking speed by density."""

    side: Whole | None = None
    """Nodes along a side of the grid."""

    crowded_nodes: Whole | None = None
    """Nodes whose streets begin crowded; on grids."""

    crowding: float | None = None
    """Demand as a multiple of the counts; in real places."""

    objective: str | None = None
    """Keep time, distance, exposure or a weighted sum low, such as exposure=0.5,max_density=4."""

    walker: str | None = None
    """Who walks: adult, older, child, wheelchair, robot or custom, also with other numbers, such as
    older,free_speed=1.0. See sidestep walkers."""


UNCHANGED = Changes()


@Parameter(name="*")
@dataclass(frozen=True)
class Reading:
    """What a file of counts does not say itself."""

    columns: Annotated[list[str] | None, Parameter(negative=())] = None
    """Columns that are not recognised: time=NAME,sensor=NAME,count=NAME, likewise date, hour, direction, latitude,
    longitude and ignore; NAME+NAME sums directions. Repeatable."""

    date_format: str | None = None
    """Order of dates that do not tell it, day-first or month-first, or a format such as "%d/%m/%y %H:%M"."""

    decimal: Literal[".", ","] | None = None
    """Mark before decimals, where the file does not tell."""

    timezone: str | None = None
    """Timezone of the place, such as Europe/Helsinki: for times with UTC offsets, and for clock changes."""

    def layout(self) -> "Layout":
        """As the reader of counts takes it."""
        from sidestep.crowds.layouts import Layout, read_columns

        said: dict[str, Any] = {**changed_fields(replace(self, columns=None)), **read_columns(self.columns or [])}
        return Layout(**said)


AS_FOUND = Reading()


def changed_fields(options: "DataclassInstance") -> dict[str, Any]:
    """The fields of a dataclass of options that are not None."""
    return {field: value for field, value in asdict(options).items() if value is not None}


def read_scenario(name: str, changes: Changes) -> "Scenario":
    """Find a scenario by its name or file, with the options applied."""
    from sidestep.scenarios.reader import find_scenario

    return find_scenario(name, **changed_fields(changes))


def read_scenarios(name: str, changes: Changes) -> "list[Scenario]":
    """The same, once for each walker that the options name."""
    from sidestep.scenarios.streets import for_walkers
    from sidestep.scenarios.walkers import read_walkers

    found = read_scenario(name, replace(changes, walker=None))
    return [found] if changes.walker is None else for_walkers(found, read_walkers(changes.walker, found.walker))


LEAST = {"seed": 0, "map": 0, "maps": 1, "walks": 1, "workers": 1}
"""The least values of options that are whole numbers."""


def check_least(**numbers: int | None) -> None:
    """Refuse whole numbers below their least value.

    Parameters
    ----------
    **numbers
        Values by option; None where it was not given.

    Raises
    ------
    SidestepError
        With the option as its field.
    """
    for option, number in numbers.items():
        if number is not None and number < LEAST[option]:
            raise SidestepError(f"--{option} must be at least {LEAST[option]}, not {number}", field=option)


def check_minutes(**minutes: float | None) -> None:
    """Refuse minutes that are not positive.

    Parameters
    ----------
    **minutes
        Values by option; None where it was not given.

    Raises
    ------
    SidestepError
        With the option as its field.
    """
    for option, number in minutes.items():
        if number is not None and not 0 < number < math.inf:
            raise SidestepError(f"--{option} must be a positive number of minutes, not {number}", field=option)


def names_in(text: str) -> list[str]:
    """Split names with commas between them."""
    return [name.strip() for name in text.split(",")]


def processors() -> int:
    """Count the processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start_jax() -> None:
    """Let JAX keep compiled programs between runs, also small ones: compiling takes longer than training."""
    from sidestep.compilation import SMALLEST, configure, keep_compiled

    keep_compiled()
    configure(SMALLEST)
