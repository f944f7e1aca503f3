"""Types and shapes checked at run time; Hypothesis profiles; the smallest networks."""

import ctypes
import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path

# All processes of a run share what they compile, and so do runs. Before anything imports JAX.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parents[1] / ".cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
# But not with numbers that are changed below, of which the names of files say nothing.
os.environ.setdefault("SIDESTEP_CACHE", "")
# Most programs of tests run once, so what counts is how fast they compile. `make coverage` and `make stress` compile
# as users do, with 0 and no flags. XLA refuses flags that it does not know, should a later one drop this.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# Of the 32 parts that code is made in, each repeats some of the others' work.
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1")
# pytest-xdist tells its processes how wide the terminal is, for which commands would wrap what they print.
os.environ.pop("COLUMNS", None)

import beartype.typing  # noqa: F401 # for the hook below
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

# Before anything imports sidestep, or its annotations go unchecked.
# To mypy an int is a float (PEP 484), and methods may return Self (PEP 673); beartype has to be told.
install_import_hook(
    "sidestep",
    "beartype.beartype(conf=beartype.BeartypeConf("
    "is_pep484_tower=True, hint_overrides=beartype.FrozenDict({beartype.typing.Self: object})))",
)

from sidestep import programs  # noqa: E402
from sidestep.environment.types import EnvParams, Instance, futures_in_turn  # noqa: E402
from sidestep.network.graph import RoadNetwork, road_network  # noqa: E402
from sidestep.network.town import Town  # noqa: E402
from sidestep.scenarios import expectation  # noqa: E402
from sidestep.walking.crossing_time import CrossingRule  # noqa: E402
from sidestep.walking.opening import AnyWaits, with_opening_times  # noqa: E402
from sidestep.walking.speed_field import SpeedField, speed_field  # noqa: E402
from sidestep.walking.waits import NoWaits  # noqa: E402

# The same examples in every run, and no time limit on one: the first of each compiles.
settings.register_profile("sidestep", derandomize=True, deadline=None)
# Others in every run, for `make stress`: --hypothesis-profile stress --hypothesis-seed N
settings.register_profile("stress", deadline=None, print_blob=True)
settings.load_profile("sidestep")

# Behind what is expected stand fewer futures than users have; tests of how good plans are ask for more.
expectation.FEW_SAMPLES, expectation.MOST_SAMPLES = 16, 32

# Garbage is looked for less often: JAX makes objects by the million, and few of them are garbage in cycles.
gc.set_threshold(50_000, 20, 20)

MakeField = Callable[..., SpeedField]
MakeParams = Callable[..., EnvParams]
MakeInstance = Callable[..., Instance]


def full() -> bool:
    """Say whether this process holds more than 1.5 GiB; where the system does not tell, it may."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return True
    return pages * os.sysconf("SC_PAGE_SIZE") > 3 * 2**29


@pytest.fixture(scope="session")
def give_back() -> Callable[[], None]:
    """Give the system the memory that the compiler no longer uses; glibc keeps it otherwise."""

    def trim() -> None:
        if full() and hasattr(libc := ctypes.CDLL(None), "malloc_trim"):
            libc.malloc_trim(0)

    return trim


@pytest.fixture(scope="module", autouse=True)
def bounded_memory(give_back: Callable[[], None]) -> Iterator[None]:
    """Compiled programs take gigabytes in the end; modules share few of them."""
    yield
    give_back()
    if full():
        jax.clear_caches()
        programs.clear_caches()
        gc.collect()
        give_back()


@pytest.fixture(scope="session")
def diamond() -> RoadNetwork:
    """Two ways from node 0 to node 3, each street in both directions; node 1 is above, node 2 below.

           1
    100 m / \\ 200 m        segments 0: 0>1, 1: 1>3, 2: 0>2, 3: 2>3
         0   3              and backwards 4: 1>0, 5: 3>1, 6: 2>0, 7: 3>2
    150 m \\ / 250 m
           2
    """
    return road_network(
        np.array([[0, 0], [100, 100], [100, -100], [200, 0]]),
        tail=[0, 1, 0, 2, 1, 3, 2, 3],
        head=[1, 3, 2, 3, 0, 1, 0, 2],
        length=[100, 200, 150, 250, 100, 200, 150, 250],
    )


@pytest.fixture(scope="session")
def make_town() -> Callable[..., Town]:
    """A town of straight streets about the equator, from the crossings' x and y in m and the streets' ends."""

    def make(xy: np.ndarray, ends: list[tuple[int, int]], **columns: object) -> Town:
        place, pairs, streets = np.asarray(xy) / 111_195.08, np.array(ends), len(ends)
        length = np.linalg.norm(np.asarray(xy, float)[pairs[:, 0]] - np.asarray(xy, float)[pairs[:, 1]], axis=1)
        straight = dict(
            place=place, ids=1000 + np.arange(len(place)), one_way=np.zeros(streets, bool), length=length,
            width=np.full(streets, 2.0), kind=("footway",) * streets, name=("",) * streets,
            signals=np.zeros(streets), crossings=np.zeros(streets), points=place[pairs.ravel()],
            first=np.arange(0, 2 * streets + 1, 2), attribution="nobody",
        )  # fmt: skip
        return Town.of_streets(pairs, **(straight | columns))

    return make


@pytest.fixture(scope="session")
def block(make_town) -> Callable[..., Town]:
    """Footways 120 m apart that cross in 4 x 4 nodes, and "Test", 170 m from node 5 to node 10: the last street."""
    xy = 120.0 * np.stack([np.arange(16) % 4, np.arange(16) // 4], axis=1)
    ends = [(i, i + 1) for i in range(16) if i % 4 < 3] + [(i, i + 4) for i in range(12)] + [(5, 10)]

    def make(opening: str = "", *, restricted: bool = False, **columns: object) -> Town:
        last = np.arange(len(ends)) == len(ends) - 1
        times, names = (("",) * (len(ends) - 1) + (word,) for word in (opening, "Test"))
        return make_town(xy, ends, opening=times, name=names, restricted=last & restricted, **columns)

    return make


@pytest.fixture(scope="session")
def gates() -> Callable[[Town], AnyWaits]:
    """The opening times of a town's streets, and nothing else to wait for."""

    def of(town: Town) -> AnyWaits:
        street, _ = town.street_of_segment()
        return with_opening_times(NoWaits(), [town.opening[number] for number in street.tolist()])

    return of


@pytest.fixture(scope="session")
def constant_field() -> MakeField:
    """The same speed on every segment of a network for ever."""

    def make(network: RoadNetwork, speed: float = 1.0, slots: int = 2, slot_seconds: float = 300.0) -> SpeedField:
        return speed_field(jnp.full((network.segments, slots), speed), slot_seconds)

    return make


@pytest.fixture(scope="session")
def make_params() -> MakeParams:
    """An environment of one future or several, of which one, by default the first, is expected.

    They are for as many destinations in turn as there are ``hours``.
    """

    def make(
        network: RoadNetwork,
        futures: SpeedField,
        expected: SpeedField | None = None,
        *,
        horizon: float = 1e5,
        rule: CrossingRule = "integrated",
        hours: tuple[float, ...] = (0.0,),
    ) -> EnvParams:
        several = futures if futures.speed.ndim == 3 else jax.tree.map(lambda leaf: leaf[None], futures)
        one = jax.tree.map(lambda leaf: leaf[:1] if expected is None else leaf[None], expected or several)
        return EnvParams(network, futures_in_turn(several, jnp.array(hours)), one, jnp.float32(horizon), rule=rule)

    return make


@pytest.fixture(scope="session")
def make_instance() -> MakeInstance:
    """A walk, or a batch of walks where lists are given."""

    def make(
        origin: int | list[int] = 0,
        destination: int | list[int] = 3,
        departure: float | list[float] = 0.0,
        future: int | list[int] = 0,
    ) -> Instance:
        shape = np.broadcast_shapes(*(np.shape(each) for each in (origin, destination, departure, future)))
        return Instance(
            *(jnp.broadcast_to(jnp.asarray(node, jnp.int32), shape) for node in (origin, destination)),
            jnp.broadcast_to(jnp.asarray(departure, jnp.float32), shape),
            jnp.broadcast_to(jnp.asarray(future, jnp.int32), shape),
        )

    return make


@pytest.fixture(scope="session")
def agreed_row() -> set[str]:
    """The fields of every planner's row of ``results.json`` and ``compare --json``."""
    return {
        "level",
        "mean_minutes",
        "ci95",
        "saving_vs_shortest_path",
        "gap",
        "gap_ci95",
        "arrival_rate",
    }
