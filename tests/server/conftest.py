"""Databases: files of SQLite, and a cluster of Debian's PostgreSQL that lives as long as the tests."""

import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import httpx
import psycopg
import pytest

from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.network.formats import save_town
from sidestep.server.app import make_app
from sidestep.server.settings import Settings
from sidestep.server.store import Store

from .processes import PROGRAM, Server, serving

OWNER = "nobody"  # PostgreSQL refuses to run as root


@dataclass
class Cluster:
    """A PostgreSQL server of its own."""

    programs: Path
    folder: Path
    """Has the data and the socket, whose path must be short."""
    user: str | None
    """Who runs it; None: the user who runs the tests."""
    port: int = 0
    process: subprocess.Popen | None = None
    databases: int = 0

    @property
    def options(self) -> dict:
        if self.user is None:
            return {}
        return {"user": self.user, "group": pwd.getpwnam(self.user).pw_gid, "extra_groups": []}

    def init(self) -> None:
        command = ["initdb", "--pgdata", "data", "--no-sync", "--auth", "trust", "--username", "sidestep"]
        self.run(*command, "--encoding", "UTF8", "--locale", "C")

    def run(self, program: str, *args: str) -> None:
        done = subprocess.run(
            [self.programs / program, *args], cwd=self.folder, capture_output=True, text=True, **self.options
        )
        assert done.returncode == 0, done.stderr

    def start(self) -> None:
        if not self.port:
            with socket.create_server(("127.0.0.1", 0)) as free:
                self.port = free.getsockname()[1]
        settings = {"listen_addresses": "127.0.0.1", "port": self.port, "unix_socket_directories": self.folder}
        with (self.folder / "log").open("a") as log:
            self.process = subprocess.Popen(
                [self.programs / "postgres", "-D", "data", *(f"--{key}={value}" for key, value in settings.items())],
                cwd=self.folder, stdout=log, stderr=log, **self.options,
            )  # fmt: skip
        until = time.monotonic() + 60
        while True:
            try:
                psycopg.connect(self.url("postgres"), connect_timeout=5).close()
            except psycopg.OperationalError:
                if self.process.poll() is not None or time.monotonic() > until:
                    pytest.fail((self.folder / "log").read_text()[-2000:])
                time.sleep(0.05)
            else:
                return

    def stop(self, how: signal.Signals = signal.SIGINT) -> None:
        """SIGINT: connections are cut."""
        if self.process is not None:
            self.process.send_signal(how)
            self.process.wait(60)
            self.process = None

    def url(self, database: str) -> str:
        return f"postgresql://sidestep@127.0.0.1:{self.port}/{database}"

    def new_database(self) -> str:
        self.databases += 1
        name = f"town{self.databases}"
        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return self.url(name)


def _programs() -> Path | None:
    """Where initdb and postgres are, of the latest version."""
    found = [path.parent for path in Path("/usr/lib/postgresql").glob("*/bin/initdb")]
    if (on_path := shutil.which("initdb")) is not None:
        found.append(Path(on_path).parent)
    return max(found, key=lambda path: path.parent.name.zfill(4)) if found else None


@pytest.fixture(scope="session")
def postgresql() -> Iterator[Cluster]:
    """A server that runs; each process of a run has its own."""
    programs = _programs()
    if programs is None:
        reason = "PostgreSQL is not there: apt-get install --no-install-recommends postgresql"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(reason)
    folder = Path(tempfile.mkdtemp(prefix="sidestep-"))
    user = OWNER if os.geteuid() == 0 else None
    if user is not None:
        os.chown(folder, pwd.getpwnam(user).pw_uid, pwd.getpwnam(user).pw_gid)
    cluster = Cluster(programs, folder, user)
    try:
        cluster.init()
        cluster.start()
        yield cluster
    finally:
        cluster.stop()
        shutil.rmtree(folder)


@dataclass
class Database:
    """An empty database, and how to take it away."""

    url: str
    kind: str
    go: Callable[[], None]
    come_back: Callable[[], None]
    opened: list[Store] = field(default_factory=list)

    def open(self, **options) -> Store:
        self.opened.append(Store(self.url, **options))
        return self.opened[-1]


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request, tmp_path: Path) -> Iterator[Database]:
    if request.param == "sqlite":
        file, away = tmp_path / "a town's.db", tmp_path / "away"
        made = Database(f"sqlite:///{file}", "sqlite", lambda: file.rename(away), lambda: away.rename(file))
    else:
        cluster = request.getfixturevalue("postgresql")
        made = Database(cluster.new_database(), "postgresql", cluster.stop, cluster.start)
    yield made
    for store in made.opened:
        store.close()


@pytest.fixture
def store(database: Database) -> Store:
    return database.open()


SIDE, BLOCK, DEGREE = 4, 100.0, 111_195.08  # crossings, m, m on the equator
ENDS = "0.0001,0.0001;0.0026,0.0026"
"""Two places in the small town, as the services of OSRM take them."""


@pytest.fixture(scope="session")
def small_town(make_town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a scenario: a square of streets near the equator, with a crowd on one of them."""
    folder = tmp_path_factory.mktemp("small")
    places = [(BLOCK * x, BLOCK * y) for y in range(SIDE) for x in range(SIDE)]
    ends = [(SIDE * y + x, SIDE * y + x + 1) for y in range(SIDE) for x in range(SIDE - 1)]
    ends += [(SIDE * y + x, SIDE * (y + 1) + x) for y in range(SIDE - 1) for x in range(SIDE)]
    town = make_town(places, ends, name=tuple(f"Street {number}" for number in range(len(ends))))
    save_town(town, folder / "town.npz")
    (folder / "crowds.csv").write_text("street,slot,density\n5,0,0.5\n5,1,0.5\n")
    save_crowd_table(read_table(folder / "crowds.csv", town), folder / "crowds.npz")
    (folder / "small.toml").write_text(
        'law = "weidmann"\nhorizon_minutes = 60\n[place]\nstreets = "town.npz"\n'
        '[place.crowd_source]\nkind = "crowd_table"\nfile = "crowds.npz"\nnoise = [0.9, 0.0]\n'
    )
    return folder / "small.toml"


WAYS_PLACES = [(0, 0), (50, 0), (250, 0), (300, 0), (50, -30), (250, -30)]
WAYS_STREETS = [
    (0, 1, "Gate"),
    (1, 2, "Long Street"),
    (2, 3, "Quay"),
    (1, 4, "Back Road"),
    (4, 5, "Back Road"),
    (5, 2, "Back Road"),
]
USUAL = 100.0  # persons/h


def at(x: float, y: float) -> list[float]:
    """Longitude and latitude of a place in metres."""
    return [x / DEGREE, y / DEGREE]


@pytest.fixture(scope="session")
def live_town(make_town, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a scenario with two sensors, and two ways from one end of a town to the other.

    Weeks differ, so what is counted today lasts.
    """
    folder = tmp_path_factory.mktemp("live")
    ends, names = [street[:2] for street in WAYS_STREETS], tuple(street[2] for street in WAYS_STREETS)
    save_town(make_town(WAYS_PLACES, ends, name=names), folder / "town.npz")
    first, rows = datetime.fromisoformat("2024-01-01"), []
    for hour in range(12 * 168):
        now, factor = first + timedelta(hours=hour), (0.5, 2.0)[hour // 168 % 2]
        rows.append(f"{now:%Y-%m-%dT%H:%M},{USUAL * factor:.0f},{USUAL * (2.5 - factor):.0f}")
    (folder / "counts.csv").write_text("\n".join(["time,long,quay", *rows]))
    (folder / "live.toml").write_text(f"""
law = "weidmann"
horizon_minutes = 60
[place]
streets = "town.npz"
timezone = "UTC"
[place.crowd_source]
file = "counts.csv"
reach = 20
fitted = ["2024-01-01", "2024-03-04"]
tested = ["2024-03-04", "2024-03-25"]
[place.crowd_source.sensors]
long = {at(150, 0)[::-1]}
quay = {at(280, 0)[::-1]}
""")
    return folder / "live.toml"


@pytest.fixture(scope="session")
def test_client():
    """The class of clients that ask an app of this process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is to be asked for by another name
        from fastapi.testclient import TestClient
    return TestClient


@pytest.fixture(scope="module", autouse=True)
def unhurried() -> Iterator[None]:
    """Servers within this process look at their store once: what they do in threads draws random numbers, by which
    arguments are checked in tests, and Hypothesis takes those for its strategies'."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sidestep.server.store.LOOKING", 3600.0)
        yield


@pytest.fixture(scope="session")
def prepared() -> Callable[[httpx.Client], None]:
    """Waits until a server within this process has compiled what it compiles in a thread."""

    def wait(client: httpx.Client) -> None:
        for _ in range(1200):
            if client.app.state.preparing.done():
                return
            time.sleep(0.1)
        raise AssertionError("the server is not prepared")

    return wait


@pytest.fixture(scope="module")
def served(small_town: Path, test_client, prepared, tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of the small town, on loopback and without a key."""
    store = tmp_path_factory.mktemp("served") / "store.db"
    settings = Settings(scenario=str(small_town), store=str(store), requests_per_second=1e6)
    with test_client(make_app(settings), base_url="http://127.0.0.1") as client:
        prepared(client)
        yield client


@pytest.fixture(scope="module")
def start(small_town: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Server]]:
    """Start servers as processes, by default of the small town; they end with the module, at the latest."""
    with contextlib.ExitStack() as stack:

        def run(
            *options: str, scenario: str | Path = small_town, program: tuple[str, ...] = PROGRAM, **environ: str
        ) -> Server:
            folder = tmp_path_factory.mktemp("serving")
            running = serving(folder, scenario, *options, program=program, environ={**os.environ, **environ})
            return stack.enter_context(running)

        yield run
