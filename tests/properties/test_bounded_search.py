"""Quick routes do not depend on how far the least times to their ends are worked out at first."""

from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.network.snapping import Snapper, StreetPoint
from sidestep.network.town import Town
from sidestep.routing import quick
from sidestep.routing.clocks import TownClock
from sidestep.routing.quick import QuickRoute, QuickRouter
from sidestep.routing.request import RouteError
from sidestep.routing.street_times import StreetTimes, Tables

SIDE, STEPS, ASKED = 9, 30, 12
NOON = TownClock(12.0, 0)


class OneTable(Tables):
    """The same times at every departure."""

    def __init__(self, table: StreetTimes) -> None:
        self.table, self.horizon = table, 3600.0

    def at(self, _clock: TownClock) -> tuple[StreetTimes, float]:
        return self.table, 90.0


def random_town(make_town: Callable[..., Town], rng: np.random.Generator) -> tuple[Town, StreetTimes]:
    """A grid of which streets are missing, one-way and crowded; many of its paths take as long as others."""
    node = np.arange(SIDE**2).reshape(SIDE, SIDE)
    pairs = np.concatenate(
        [np.stack([a.ravel(), b.ravel()], 1) for a, b in ((node[:, :-1], node[:, 1:]), (node[:-1], node[1:]))]
    )
    pairs = rng.permutation(pairs)[: len(pairs) * 9 // 10]
    xy = 100.0 * np.stack([node.ravel() % SIDE, node.ravel() // SIDE], axis=1)
    town = make_town(xy, pairs.tolist(), one_way=np.arange(len(pairs)) % 10 == 0)
    network = town.network()
    slow = rng.choice([1.0, 1.25, 6.0], network.segments, p=[0.9, 0.05, 0.05])
    wave = 1 + 0.25 * rng.integers(0, 2, (STEPS, 1))  # nobody who enters later leaves earlier
    seconds = np.float32(75 * slow * wave)
    density = np.zeros((network.segments, 1), np.float32)
    return town, StreetTimes(network, 12.0, 120.0, seconds, None, None, density, 3600.0)


def answers(router: QuickRouter, ends: list[list[int | StreetPoint]]) -> list[QuickRoute | None]:
    """The routes between pairs of ends; None where there is none."""
    found: list[QuickRoute | None] = []
    for origin, destination in ends:
        found.append(None)
        with suppress(RouteError):
            found[-1] = router.route(origin, destination, NOON)
    return found


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_routes_are_those_of_least_times_over_the_whole_town(make_town, seed: int) -> None:
    """To the bit, from crossings and places on streets, also to ends that were asked for before from elsewhere."""
    rng = np.random.default_rng(seed)
    town, table = random_town(make_town, rng)
    snapper = Snapper(town)
    places = [
        int(rng.integers(town.nodes)) if rng.random() < 0.5
        else StreetPoint(int(rng.integers(town.streets)), float(rng.uniform(0.05, 0.95)), 0.0, (0.0, 0.0))
        for _ in range(ASKED)
    ]  # fmt: skip
    ends = [[one, places[number % 2]] for number, one in enumerate(places)]
    found = {}
    for reach in ((0.0, inf), (0.0, 1.0), (0.5, 60.0), (quick.DETOUR, quick.SPARE)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(quick, "DETOUR", reach[0])
            patch.setattr(quick, "SPARE", reach[1])
            router = QuickRouter(table.network, snapper, OneTable(replace(table, _potentials=OrderedDict())))
            found[reach] = answers(router, ends)
    whole = found.pop((0.0, inf))
    assert all(each == whole for each in found.values())
