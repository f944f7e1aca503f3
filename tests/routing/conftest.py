"""A small town of which everything is known, with counters or a table of crowds."""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory

import jax
import numpy as np
import pytest

from sidestep import programs
from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.network.formats import save_town
from sidestep.network.town import Town
from sidestep.routing.plan import RoutePlan
from sidestep.routing.router import Router
from sidestep.scenarios.model import RewardSpec, Scenario
from sidestep.scenarios.places import Counters, CrowdTable, Sensor, Venue

NOON = "2025-05-24T12:30"  # a Saturday
DEGREE = 111_195.08  # m, on the equator in both directions
PLACES = [(0, 0), (200, 0), (300, 0), (0, 100), (200, 100), (300, -100), (0, 300), (100, 300)]
STREETS = [  # tail, head, one-way, kind, name, points between
    (0, 1, False, "footway", "Long Street", []),
    (1, 2, False, "footway", "Long Street", []),
    (1, 4, True, "residential", "Side Lane", []),
    (3, 4, False, "steps", "", []),
    (0, 3, False, "footway", "", []),
    (2, 5, False, "pedestrian", "Quay", []),
    (0, 1, False, "path", "Back Road", [(0, -50), (200, -50)]),
    (6, 7, False, "footway", "Island Street", []),
]
QUAY_COUNT = 4824  # persons/h: 0.5 persons/m² on 2 m


def at(x: float, y: float) -> tuple[float, float]:
    """Latitude and longitude of a place in metres."""
    return y / DEGREE, x / DEGREE


def small_town() -> Town:
    """See PLACES and STREETS.

    ::

        6 --- 7        (an island)

        3 ----- 4
        |       | one-way, up
        0 ----- 1 --- 2
        '-------'     |
                      5
    """
    courses = [np.array([PLACES[a], *inner, PLACES[b]], float) for a, b, *_, inner in STREETS]
    return Town(
        place=np.array(PLACES, float) / DEGREE,
        ids=np.arange(len(PLACES)),
        tail=np.array([street[0] for street in STREETS], np.int32),
        head=np.array([street[1] for street in STREETS], np.int32),
        one_way=np.array([street[2] for street in STREETS]),
        length=np.array([np.linalg.norm(np.diff(course, axis=0), axis=1).sum() for course in courses], np.float32),
        width=np.full(len(STREETS), 2, np.float32),
        kind=tuple(street[3] for street in STREETS),
        name=tuple(street[4] for street in STREETS),
        signals=np.zeros(len(STREETS), np.int16),
        crossings=np.zeros(len(STREETS), np.int16),
        opening=("",) * len(STREETS),
        restricted=np.zeros(len(STREETS), bool),
        incline=np.full(len(STREETS), np.nan, np.float32),
        kerb=np.zeros(len(STREETS), np.float32),
        points=np.concatenate(courses) / DEGREE,
        first=np.cumsum([0, *map(len, courses)]),
        attribution="© nobody & sons, ODbL 1.0",
    )


@pytest.fixture(scope="session")
def place() -> Callable[[float, float], tuple[float, float]]:
    """Latitude and longitude of a place in metres."""
    return at


@pytest.fixture(scope="session")
def town() -> Town:
    return small_town()


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """Nobody on Back Road and always as many on the Quay, so that all times are known."""
    folder = tmp_path_factory.mktemp("tiny")
    save_town(small_town(), folder / "town.npz")
    first = datetime.fromisoformat("2024-01-01")
    hours = [(first + timedelta(hours=hour)).isoformat(timespec="minutes") for hour in range(8 * 168)]
    rows = "".join(f"{hour},0,{QUAY_COUNT - 1}\n" for hour in hours)
    (folder / "counts.csv").write_text(f"time,back road,the quay\n{rows}")
    counters = Counters(
        file=str(folder / "counts.csv"),
        sensors=(Sensor(name="back road", place=at(100, -50)), Sensor(name="the quay", place=at(300, -50))),
        reach=20.0,
        fitted=("2024-01-01", "2024-02-12"),
        tested=("2024-02-12", "2024-02-26"),
    )
    return Scenario(
        name="tiny",
        place=Venue(streets=str(folder / "town.npz"), crowd_source=counters),
        law="weidmann",
        horizon=1200.0,
        reward=RewardSpec(progress=0.0, bonus=0.0),
    )


@pytest.fixture(scope="session")
def router(tiny) -> Router:
    return Router(tiny)


@pytest.fixture(scope="session")
def plan(router) -> RoutePlan:
    """From the middle of Long Street to the middle of the Quay."""
    return router.plan(at(50, 4), at(300, -50), depart=NOON, futures=7, by=10.0)


@pytest.fixture
def live(tmp_path) -> Callable[..., Path]:
    """A file of current counts."""

    def write(*rows: str, header: str = "time,the quay") -> Path:
        file = tmp_path / "now.csv"
        file.write_text("\n".join([header, *rows]) + "\n")
        return file

    return write


@pytest.fixture(scope="session")
def tabled(tiny) -> Callable[..., Scenario]:
    """The small town with a table of densities on its streets, instead of counters."""

    def make(*rows: str, noise: tuple[float, float] = (0.9, 0.0), **changes: object) -> Scenario:
        folder = Path(tiny.place.streets).parent
        file = folder / f"crowds-{abs(hash(rows))}" / "crowds.npz"
        file.parent.mkdir(exist_ok=True)
        with TemporaryDirectory() as drawer:
            table = Path(drawer) / "crowds.csv"
            table.write_text("\n".join(rows))
            save_crowd_table(read_table(table, small_town()), file)
        source = CrowdTable(file=str(file), noise=noise)
        venue = Venue(streets=tiny.place.streets, crowd_source=source, days=(5,), hours=(12, 14), **changes)
        return tiny.changed(name="tabled", place=venue)

    return make


LONG, SLOW = 0, 2.0  # a street; persons/m² on Long Street from noon to one o'clock


@pytest.fixture(scope="session")
def hours(tabled) -> Callable[..., Scenario]:
    """Saturday from noon to two: Long Street is slow in the first hour, and slower for walkers to the west."""

    def make(**changes: object) -> Scenario:
        return tabled(
            "street,direction,time,density",
            *(f"{LONG},forward,2025-05-24T{12 + hour}:00,{SLOW * (1 - hour)}" for hour in (0, 1)),
            *(f"{LONG},backward,2025-05-24T{12 + hour}:00,{2 * SLOW * (1 - hour)}" for hour in (0, 1)),
            *(f"5,,2025-05-24T{12 + hour}:00,0.5" for hour in (0, 1)),
            **changes,
        )

    return make


@pytest.fixture(scope="session")
def slots(tabled) -> Scenario:
    """Slots without times."""
    return tabled("street,slot,density", f"{LONG},0,{SLOW}", f"{LONG},1,{SLOW}")


@pytest.fixture
def compiled():
    """Names of the events of compilation since this list was cleared."""
    events: list[str] = []
    jax.clear_caches()  # of what other tests have compiled
    programs.clear_caches()

    def listen(event: str, *_: object, **__: object) -> None:
        if "backend_compile" in event:
            events.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    jax.jit(lambda number: number + 1)(1.0)
    assert events
    yield events
    jax.monitoring.unregister_event_duration_listener(listen)
