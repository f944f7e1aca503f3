"""A scenario file to start from: every field, with what it means and what it is by default."""

import os
import re
from pathlib import Path
from tempfile import TemporaryDirectory

from sidestep.files import OutputError, reason
from sidestep.scenarios.builtin import AUCKLAND_SENSORS, BUILT_IN
from sidestep.scenarios.spec import ScenarioError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def new_scenario(folder: Path, name: str) -> Path:
    """Make a folder with a ``scenario.toml`` in it, whole or not at all.

    Parameters
    ----------
    folder
        Where the new folder is made.
    name
        Of the new folder and the scenario.

    Returns
    -------
    file
        The scenario file.

    Raises
    ------
    ScenarioError
        A name that is not allowed, or that a built-in scenario has.
    OutputError
        A folder that exists already or cannot be made.
    """
    if not _NAME.fullmatch(name):
        rule = "at most 64 letters, digits, - and _, and begin with a letter or digit"
        raise ScenarioError(f"a scenario's name must have {rule}, not {name!r:.80}", field="name")
    if name in BUILT_IN:
        raise ScenarioError(f"{name} is the name of a built-in scenario; choose another", field="name")
    made = folder / name
    if os.path.lexists(made):
        raise OutputError(f"{made} exists already, and is left as it is")
    try:
        with TemporaryDirectory(dir=folder, prefix=f".{name}.") as temporary:
            file = Path(temporary, name, "scenario.toml")
            file.parent.mkdir()
            file.write_text(template(name), encoding="utf-8")
            file.parent.rename(made)
    except OSError as error:
        raise OutputError(f"cannot make the folder {made}: {reason(error)}") from error
    return made / file.name


def template(name: str) -> str:
    """The text of a scenario file: central Helsinki with Auckland's counts, and what may be changed."""
    width = max(len(sensor.name) for sensor in AUCKLAND_SENSORS) + 2
    names = (f'"{sensor.name}"' for sensor in AUCKLAND_SENSORS)
    sensors = "\n".join(f'{quoted:{width}} = "paired"' for quoted in names)
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    return text.replace("SENSORS", sensors).replace("NAME", name)
