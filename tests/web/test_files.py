"""The files of the page: fetched from npm by lock and hash, in wheels, and served."""

import json
import re
import shutil
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path

import pytest
from fastapi import FastAPI

from sidestep.errors import SidestepError
from sidestep.server import page_paths
from sidestep.server.problems import on_error

ROOT = Path(__file__).parents[2]
WEB = ROOT / "src" / "sidestep" / "web"
VENDOR = "sidestep/web/vendor/"


@pytest.mark.parametrize("lock", [WEB / "package-lock.json", ROOT / "tests" / "web" / "package-lock.json"])
def test_locks_hold_hashes_and_no_registry(lock):
    packages = json.loads(lock.read_text())["packages"]
    packages.pop("")
    assert packages
    assert all(each["integrity"].startswith("sha512-") and "resolved" not in each for each in packages.values())


def test_nothing_of_others_is_in_the_repository():
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    assert not [name for name in tracked if "/vendor/" in name or "node_modules" in name]


def test_no_module_of_the_page_names_another_host():
    for path in WEB.glob("*.*"):
        hosts = re.findall(r"https?://[\w.]+", path.read_text(encoding="utf-8"))
        allowed = {"http://www.w3.org"} if path.suffix in {".js", ".svg"} else set()  # the name of SVG, not an address
        assert path.name == "package-lock.json" or set(hosts) <= allowed, path.name


@pytest.fixture(scope="module")
def wheels(files, tmp_path_factory) -> list[Path]:  # noqa: ARG001 # the files come first
    """A wheel that is built twice."""
    made = []
    for _ in range(2):
        folder = tmp_path_factory.mktemp("wheel")
        build = f"from hatchling.build import build_wheel; print(build_wheel({str(folder)!r}))"
        subprocess.run([sys.executable, "-c", build], cwd=ROOT, check=True, capture_output=True)
        made.extend(folder.glob("*.whl"))
    return made


def test_wheels_hold_the_files_and_their_licences_and_are_the_same(wheels):
    one, other = wheels
    assert one.read_bytes() == other.read_bytes()
    with zipfile.ZipFile(one) as wheel:
        names = set(wheel.namelist())
        licences = wheel.read(f"{VENDOR}LICENSES.txt").decode()
    assert {f"{VENDOR}maplibre-gl{end}" for end in (".mjs", "-worker.mjs", ".css")} <= names
    assert {f"sidestep/web/{path.name}" for path in WEB.glob("*.*") if path.suffix != ".json"} <= names
    assert not [name for name in names if "package" in name]
    said = json.loads((WEB / "package-lock.json").read_text())["packages"]
    assert all(
        f"{name.rpartition('node_modules/')[2]} {each['version']}: " in licences for name, each in said.items() if name
    )


def test_npm_is_asked_only_where_files_are_missing_or_changed(files, from_npm, tmp_path, monkeypatch):  # noqa: ARG001
    web = tmp_path / from_npm.WEB
    shutil.copytree(WEB, web, ignore=shutil.ignore_patterns(".vendor-*"))
    asked = []

    def npm_ci(folder: Path) -> None:
        asked.append(folder)
        raise SystemExit("no npm")

    monkeypatch.setattr(from_npm, "npm_ci", npm_ci)
    assert not from_npm.fetch(tmp_path)
    assert not asked
    with (web / "vendor" / "maplibre-gl.mjs").open("a") as file:
        file.write(" ")
    with pytest.raises(SystemExit):
        from_npm.fetch(tmp_path)
    assert asked
    assert (web / "vendor").exists()  # what was there stays, and nothing half-fetched
    assert not list(web.glob(".vendor-*"))


@pytest.fixture
def client(monkeypatch, tmp_path):
    """The page's paths alone, from a folder that tests may change."""
    shutil.copytree(WEB, tmp_path / "web", ignore=shutil.ignore_patterns("vendor", ".vendor-*"))
    (tmp_path / "web" / "vendor").mkdir()
    (tmp_path / "web" / "vendor" / "maplibre-gl.mjs").write_text("export default 1;")
    monkeypatch.setattr(page_paths, "WEB", tmp_path / "web")
    app = FastAPI()
    app.include_router(page_paths.router)
    app.add_exception_handler(SidestepError, on_error)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Starlette would rather have httpx2
        from fastapi.testclient import TestClient
    with TestClient(app) as found:
        yield found


def test_a_checkout_without_the_files_says_which_command_fetches_them(client, tmp_path):
    shutil.rmtree(tmp_path / "web" / "vendor")
    answer = client.get("/")
    assert answer.status_code == 503
    assert "make page" in answer.text


def test_files_are_served_packed_and_only_once(client):
    page = client.get("/", headers={"accept-encoding": "identity"})
    assert page.headers["content-type"].startswith("text/html")
    assert client.head("/").status_code == 200
    names = re.findall(r'(?:src|href)="(assets/[^"]+)"', page.text)
    assert "assets/main.js" in names
    packed = client.get("/assets/main.js", headers={"accept-encoding": "gzip"})
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.headers["content-type"].startswith("text/javascript")
    assert packed.text == (WEB / "main.js").read_text(encoding="utf-8")
    again = client.get("/assets/main.js", headers={"if-none-match": packed.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    "name",
    [
        "",
        "index.html",
        "package.json",
        "../server/app.py",
        "%2e%2e/server/app.py",
        "vendor",
        "vendor/%2e%2e/main.js",
        "nothing.js",
    ],
)
def test_nothing_else_is_served(client, name):
    assert client.get(f"/assets/{name}").status_code == 404


def test_a_file_that_changed_is_read_anew(client, tmp_path):
    tag = client.get("/assets/dom.js").headers["etag"]
    (tmp_path / "web" / "dom.js").write_text("// changed")
    changed = client.get("/assets/dom.js", headers={"if-none-match": tag})
    assert (changed.status_code, changed.text) == (200, "// changed")
