"""One virtual environment for each library, from its pinned requirements."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

from registry import PROJECT

HERE = Path(__file__).parent
REQUIREMENTS = HERE / "requirements"
LONGEST = 200
"""Characters of a line of the reason why something does not install."""


class NotInstalledError(Exception):
    """An environment cannot be made; says why."""


def python_of(environment: str) -> Path:
    """Make an environment unless it is there, and return its interpreter.

    Raises
    ------
    NotInstalledError
        With the reason that the installer gives.
    """
    if environment == PROJECT:
        return Path(sys.executable)
    pinned = REQUIREMENTS / f"{environment}.txt"
    folder = HERE.parent / f".venv-{environment}"
    ready, python = folder / "ready", folder / "bin" / "python"
    wanted = hashlib.sha256(pinned.read_bytes()).hexdigest()
    if ready.exists() and ready.read_text() == wanted:
        return python
    print(f"making {folder.name} from {pinned.name}", file=sys.stderr, flush=True)
    _run([sys.executable, "-m", "venv", folder])
    _run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--requirement", pinned])
    ready.write_text(wanted)
    return python


def _run(command: list[str | Path]) -> None:
    # Some machines forbid byte-code; without it the first start would be measured with compiling it.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or done.stderr.splitlines()
        words = " ".join(line[:LONGEST].removeprefix("ERROR: ") for line in said[-2:])
        raise NotInstalledError(words or f"{command[0]} ended with status {done.returncode}")
