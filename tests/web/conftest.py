"""The map page in a real browser, from a server of its own.

Without Chromium or npm the tests are skipped, but not where CI is set.
"""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.network.formats import save_town

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
KEY = "a-key-for-tests-of-the-page"
ARGUMENTS = [
    "--no-sandbox",
    "--headless",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
SIZES = {"desktop": {"width": 1440, "height": 900}, "phone": {"width": 390, "height": 844}}


def missing(said: str) -> None:
    """Skip, or fail where nothing may be skipped."""
    if os.environ.get("CI"):
        pytest.fail(said)
    pytest.skip(said)


@pytest.fixture(scope="session")
def from_npm():
    """What ``make page`` runs, which also fetches axe-core."""
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    hook = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hook)
    return hook


@pytest.fixture(scope="session")
def files(from_npm) -> None:
    """MapLibre GL, as in wheels."""
    try:
        from_npm.fetch(ROOT)
    except SystemExit as error:
        missing(f"the map page cannot be built: {error}")


@pytest.fixture(scope="session")
def axe(from_npm) -> str:
    """axe-core, which finds faults of accessibility."""
    folder = ROOT / ".cache" / "page-tests"
    script, lock = folder / "node_modules" / "axe-core" / "axe.min.js", folder / "package-lock.json"
    if not script.exists() or lock.read_bytes() != (HERE / lock.name).read_bytes():
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("package.json", lock.name):
            shutil.copy(HERE / name, folder)
        try:
            from_npm.npm_ci(folder)
        except SystemExit as error:
            missing(f"axe-core cannot be fetched: {error}")
    return script.read_text(encoding="utf-8")


CLASSES = """(streets) => Array.from({ length: streets }, (_, street) =>
  sidestep.map.getFeatureState({ source: "streets", id: street }).crowd ?? 0)"""


@dataclass
class Server:
    """A running ``sidestep serve``."""

    address: str
    streets: int = 0

    def ask(self, path: str) -> object:
        with urllib.request.urlopen(f"{self.address}{path}", timeout=60) as answer:  # noqa: S310
            return json.load(answer)

    def send(self, path: str, body: object) -> object:
        headers = {"Content-Type": "application/json", "Authorization": f"Bearer {KEY}"}
        request = urllib.request.Request(f"{self.address}{path}", json.dumps(body).encode(), headers)  # noqa: S310
        with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310
            return json.load(answer)


@contextmanager
def _serve(scenario: str | Path, folder: Path, port: int = 0) -> Iterator[Server]:
    """``sidestep serve`` as users run it, with a store of its own in a folder; by default at a free port."""
    command = [sys.executable, "-m", "sidestep", "serve", str(scenario), "--port", str(port)]
    process = subprocess.Popen(
        [*command, "--store", str(folder / "store.db")],
        cwd=folder, env={**os.environ, "SIDESTEP_API_KEY": KEY}, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    said: list[str] = []
    address, watching = None, threading.Timer(120, process.kill)
    watching.start()
    for line in process.stderr:
        said.append(line)
        if found := re.search(r"http://\S+?(?=/? |/?$)", line):
            address = found[0]
            break
    watching.cancel()
    if address is None:
        process.kill()
        pytest.fail(f"the server did not start: {''.join(said)}")
    reading = threading.Thread(target=process.stderr.read, daemon=True)  # or its log would fill the pipe
    reading.start()
    running = Server(address)
    running.streets = running.ask("/town")["streets"]
    yield running
    process.terminate()
    process.wait(120)  # what it compiles it ends
    reading.join(10)
    process.stderr.close()


@pytest.fixture(scope="session")
def serve(files) -> Callable[..., AbstractContextManager[Server]]:  # noqa: ARG001 # the page's files come first
    """Starts servers: of a scenario, with their store in a folder."""
    return _serve


@pytest.fixture(scope="module")
def server(serve, tmp_path_factory) -> Iterator[Server]:
    """Central Helsinki."""
    with serve("helsinki", tmp_path_factory.mktemp("server")) as running:
        yield running


@pytest.fixture(scope="session")
def small(make_town, tmp_path_factory) -> Callable[..., Path]:
    """Files of scenarios: one straight street after another, with a crowd on the first that knows no times."""

    def make(name: str, streets: int) -> Path:
        folder = tmp_path_factory.mktemp(name)
        places, ends = [(100 * turn, 0) for turn in range(streets + 1)], [(turn, turn + 1) for turn in range(streets)]
        town = make_town(places, ends, name=tuple(f"{name} {turn}" for turn in range(streets)))
        save_town(town, folder / "town.npz")
        (folder / "crowds.csv").write_text("street,slot,density\n0,0,0.5\n0,1,0.5\n")
        save_crowd_table(read_table(folder / "crowds.csv", town), folder / "crowds.npz")
        (folder / f"{name}.toml").write_text(
            'law = "weidmann"\nhorizon_minutes = 60\n[place]\nstreets = "town.npz"\n'
            '[place.crowd_source]\nkind = "crowd_table"\nfile = "crowds.npz"\nnoise = [0.9, 0.0]\n'
        )
        return folder / f"{name}.toml"

    return make


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Debian's Chromium, which draws maps without a graphics card.

    Playwright's event loop ends with this module: other tests of this process may have loops of their own.
    """
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        missing("there is no Chromium; on Debian: apt-get install chromium")
    with sync_playwright() as playwright, playwright.chromium.launch(executable_path=path, args=ARGUMENTS) as found:
        yield found


@dataclass
class View:
    """A page that is open, and what went on in it."""

    page: Page
    server: Server
    requested: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def open(self, link: str = "", *, drawn: bool = True) -> "View":
        self.page.goto(f"{self.server.address}/{link}")
        if drawn:
            self.page.wait_for_selector("html[data-map=drawn]")
        return self

    def get(self, expression: str, given: object = None) -> object:
        return self.page.evaluate(expression, given)

    def until(self, said: Callable[[], object], seconds: float = 15.0) -> object:
        """Wait until something is true. Playwright's own way needs eval, which the page forbids."""
        for _ in range(int(seconds * 20)):
            if found := said():
                return found
            self.page.wait_for_timeout(50)
        return pytest.fail("it did not come true")

    def classes(self) -> list[int]:
        """Of every street the class of crowding that it is drawn in."""
        return self.get(CLASSES, self.server.streets)


@pytest.fixture(scope="module")
def contexts(chromium: Browser) -> Callable[..., BrowserContext]:
    """What pages of one size share: files that were fetched and compiled once, the clock and what is remembered."""

    @cache
    def make(size: str, alone: str, **options: object) -> BrowserContext:  # noqa: ARG001 # a key of the cache
        return chromium.new_context(viewport=SIZES[size], has_touch=size == "phone", **options)

    return make


@pytest.fixture
def opened(
    contexts: Callable[..., BrowserContext], server: Server, request: pytest.FixtureRequest
) -> Iterator[Callable[..., View]]:
    """Pages in a browser: none may ask another host, or complain on its console, unless a test says what it may say."""
    views: list[tuple[View, tuple[str, ...]]] = []

    def make(
        size: str = "desktop",
        *,
        allowed: tuple[str, ...] = (),
        alone: bool = False,
        init: str = "",
        server: Server = server,
        **options: object,
    ) -> View:
        view = View(contexts(size, request.node.name if alone else "", **options).new_page(), server)
        if init:
            view.page.add_init_script(init)
        view.page.on("request", lambda request: view.requested.append(request.url))
        view.page.on("pageerror", lambda error: view.errors.append(str(error)))
        view.page.on("console", lambda message: message.type == "error" and view.errors.append(message.text))
        views.append((view, allowed))
        return view

    yield make
    for view, allowed in views:
        view.page.close()
        assert [
            url for url in view.requested if not url.startswith((f"{view.server.address}/", "blob:", "data:"))
        ] == []
        assert [said for said in view.errors if not any(words in said for words in allowed)] == []
