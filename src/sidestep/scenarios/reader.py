"""Scenarios in files: a place of one's own, said in TOML. docs/scenarios.md lists the fields."""

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from sidestep.files import reason
from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.file_model import ScenarioFile
from sidestep.scenarios.model import Scenario, read_objective
from sidestep.scenarios.spec import Fault, ScenarioError, faults
from sidestep.scenarios.toml_lines import line_of

LARGEST = 1 << 16  # bytes and
MOST_LINES = 2_000  # lines of a scenario file; more is no scenario
_LINE_OF_ERROR = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


def find_scenario(name_or_file: str | Path, *, objective: str | None = None, **changes: object) -> Scenario:
    """A built-in scenario by its name, or one in a file, with some fields changed.

    Parameters
    ----------
    name_or_file
        A name; or a path, which ends in ``.toml``, has a separator in it, or exists.
    objective
        What walkers keep low, instead of the scenario's own, as
        :func:`sidestep.scenarios.model.read_objective` reads it.
    **changes
        Fields of the scenario, its place or its crowd source.

    Returns
    -------
    Scenario
        The scenario, checked.

    Raises
    ------
    SidestepError
        Unknown names and fields, wrong values, files that hold no scenario.
    """
    name = str(name_or_file)
    in_a_file = name.endswith(".toml") or set(name) & {os.sep, os.altsep} or _exists(Path(name))
    found = load_scenario(name) if name not in BUILT_IN and in_a_file else scenario(name)
    if objective is not None:
        changes["objective"] = read_objective(objective)
    return found.changed(**changes)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # too long a name, or a null character
        return False


def load_scenario(path: str | Path) -> Scenario:
    r"""Read a scenario file, and make sure that its streets, counts, sensors and places exist.

    Fields that the file leaves out are as in the built-in scenario ``helsinki``, but without its event (``crowding`` is
    1, ``uneven`` 0, ``streets_per_sensor`` 1, ``reach`` 150). Files that it names are looked for from its own folder.

    Parameters
    ----------
    path
        A TOML file, as docs/scenarios.md describes it.

    Raises
    ------
    ScenarioError
        One sentence that names the file and, where they are known, the line and the field; ``others`` has further
        mistakes.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from sidestep.scenarios.reader import load_scenario
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder) / "park.toml"
    ...     _ = file.write_text('walks = 20\n[place]\nstreets = "helsinki"\nhours = [8, 18]\n')
    ...     park = load_scenario(file)
    >>> park.name, park.walks, park.place.hours
    ('park', 20, (8, 18))
    """
    path = Path(path)
    text = _text(path)
    values, folder = _tuples(_parsed(path, text)), path.resolve().parent
    name = folder.name if folder.name and path.name == "scenario.toml" else path.stem
    try:
        read = ScenarioFile.model_validate(values, context={"folder": folder})
        from sidestep.scenarios.maps import mistakes  # with JAX, which mistakes in the file itself need not wait for

        if found := mistakes(read.place):
            raise _refusal(path, text, found)
        return Scenario.model_validate(read.model_dump() | {"name": read.name or name})
    except ValidationError as error:
        raise _refusal(path, text, faults(error, ScenarioFile)) from error


def _text(path: Path) -> str:
    if _exists(path) and path.is_dir():
        raise ScenarioError(f"{path} is a folder; name the file in it, such as {path / 'scenario.toml'}")
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        said = reason(error) if isinstance(error, OSError) else str(error)
        raise ScenarioError(f"cannot read the scenario {str(path)!r:.300}: {said}") from error
    if len(content) > LARGEST or content.count(b"\n") > MOST_LINES:
        raise ScenarioError(f"{path}: more than {LARGEST >> 10} KiB or {MOST_LINES:,} lines are no scenario")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ScenarioError(f"{path}: line {line}: not a text file (UTF-8)", line=line) from error
    if not text.strip():
        raise ScenarioError(f"{path}: the file is empty")
    return text


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ScenarioError(f"{path}: brackets are nested too deeply") from error
    except tomllib.TOMLDecodeError as error:
        said, line = str(error), text.rstrip("\n").count("\n") + 1
        if found := _LINE_OF_ERROR.search(said):
            said, line = said[: found.start()], min(int(found[1] or line), line)
        said = f"{said[:1].lower()}{said[1:]:.200}"
        raise ScenarioError(f"{path}: line {line}: not TOML: {said}", line=line) from error
    except ValueError as error:  # a number of thousands of digits
        raise ScenarioError(f"{path}: not TOML: {str(error)[:200]}") from error


def _tuples(value: Any) -> Any:
    """Lists, which may change, as tuples, which specs hold."""
    if isinstance(value, dict):
        return {key: _tuples(item) for key, item in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _refusal(path: Path, text: str, mistakes: list[Fault]) -> ScenarioError:
    """The first mistake of a file by its line, with the others."""
    errors = sorted((_located(path, text, fault) for fault in mistakes), key=lambda error: error.line or 0)
    first, others = errors[0], errors[1:]
    more = f" ({len(others)} more mistake{'s' * (len(others) > 1)} in this file)" if others else ""
    return ScenarioError(f"{first}{more}", field=first.field, line=first.line, others=others)


def _located(path: Path, text: str, fault: Fault) -> ScenarioError:
    line, sentence = line_of(text, fault.path), " ".join(fault.sentence.split())
    return ScenarioError(f"{path}: line {line}: {sentence}", field=".".join(fault.path), line=line)
