"""Routes by expected times on the host: golden times in a small town, and the same routes as the planner's."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sidestep.crowds.crowd_table import save_crowd_table
from sidestep.crowds.table_reader import read_table
from sidestep.network.formats import save_town
from sidestep.network.snapping import StreetPoint
from sidestep.network.town import Town, TownError
from sidestep.routing.clocks import TownClock, town_clock
from sidestep.routing.request import RouteError, read_departure
from sidestep.routing.router import Router
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.places import CrowdTable, Venue
from sidestep.walking.speed_laws import LAWS

FREE = 1.34
STREETS = 25
TIMES = ("", "06:00-22:00", "22:00-06:00", "12:00-12:10,12:20-12:30,12:40-12:50")


def clock(router: Router, departure: str) -> TownClock:
    return town_clock(router.scenario.place, router.flow, read_departure(departure))


def point(town: Town, street: int, fraction: float) -> StreetPoint:
    """A place on a straight street."""
    (west, south), (east, north) = town.course(street)[[0, -1]].tolist()
    place = south + fraction * (north - south), west + fraction * (east - west)
    return StreetPoint(street, fraction, 0.0, place)


def test_seconds_on_a_known_route(router, plan, place) -> None:
    """From 50 m along Long Street to the middle of the Quay, where 0.5 persons/m² walk 50 m."""
    quick, noon = router.quick, clock(router, "2025-05-24T12:30")
    ends = [quick.snapper.nearest(*place(*at)) for at in ((50, 4), (300, -50))]
    route = quick.route(*ends, noon)
    slow = float(LAWS["weidmann"].speed(jnp.float32(0.5)))
    assert route.seconds == pytest.approx((150 + 100) / FREE + 50 / slow, rel=2e-3)
    assert [round(leg.metres) for leg in route.legs] == [150, 100, 50]
    assert [leg.name for leg in route.legs] == ["Long Street", "Long Street", "Quay"]
    assert [leg.street for leg in route.legs] == [leg.street for leg in plan.legs]
    assert [leg.density for leg in route.legs] == pytest.approx([leg.density for leg in plan.legs], abs=1e-4)
    assert sum(leg.exposure for leg in route.legs) == pytest.approx(plan.exposure, rel=1e-3)
    assert [step.turn for step in quick.steps(route.legs)] == [step.turn for step in plan.steps]
    assert route.legs[0].coordinates[0] == pytest.approx([place(50, 0)[1], place(50, 0)[0]], abs=1e-6)
    assert route.legs[-1].coordinates[-1] == pytest.approx([place(300, -50)[1], place(300, -50)[0]], abs=1e-6)


def test_ends_on_one_street(router, town) -> None:
    quick, noon = router.quick, clock(router, "2025-05-24T12:30")
    long, side = 0, 2
    for first, second in ((0.2, 0.7), (0.7, 0.2)):
        route = quick.route(point(town, long, first), point(town, long, second), noon)
        assert [round(leg.metres) for leg in route.legs] == [100]
        assert route.seconds == pytest.approx(100 / FREE, rel=1e-3)
    # Side Lane is one-way: back is a way round by 4, 3 and 0, of which 40 m and 60 m are on the lane.
    back = quick.route(point(town, side, 0.6), point(town, side, 0.4), noon)
    assert sum(leg.metres for leg in back.legs) == pytest.approx(40 + 200 + 100 + 200 + 40, abs=0.5)
    same = quick.route(point(town, long, 0.5), point(town, long, 0.5), noon)
    assert (same.legs, same.seconds) == ([], 0.0)


def test_ends_within_a_metre_of_a_crossing_are_the_crossing(router, town) -> None:
    quick, noon = router.quick, clock(router, "2025-05-24T12:30")
    near = quick.route(point(town, 0, 0.001), point(town, 1, 0.999), noon)
    assert near.legs == quick.route(0, 2, noon).legs


def test_places_that_no_path_connects(router) -> None:
    with pytest.raises(RouteError) as found:
        router.quick.route(0, 6, clock(router, "2025-05-24T12:30"))
    assert found.value.field == "destination"


def test_kinds_that_are_not_walked(router) -> None:
    quick, noon = router.quick, clock(router, "2025-05-24T12:30")
    assert {leg.kind for leg in quick.route(4, 0, noon).legs} == {"steps", "footway"}
    with pytest.raises(RouteError) as found:  # Side Lane is one-way
        quick.route(4, 0, noon, ["steps"])
    assert found.value.field == "destination"
    with pytest.raises(TownError) as unknown:
        quick.route(4, 0, noon, ["stepz"])
    assert unknown.value.field == "exclude"
    assert all(kind in str(unknown.value) for kind in quick.snapper.town.kind)


def test_a_matrix_agrees_with_its_routes(router, town) -> None:
    quick, noon = router.quick, clock(router, "2025-05-24T12:30")
    ends = [0, 5, point(town, 0, 0.3), point(town, 0, 0.8), point(town, 5, 0.5), 6]
    seconds, metres = quick.matrix(ends, ends, noon)
    for row, origin in enumerate(ends):
        for column, destination in enumerate(ends):
            if np.isinf(seconds[row, column]):
                assert (origin == 6) != (destination == 6)
                continue
            route = quick.route(origin, destination, noon)
            assert seconds[row, column] == pytest.approx(route.seconds, abs=1e-6)
            assert metres[row, column] == pytest.approx(sum(leg.metres for leg in route.legs))


def test_crowds_are_those_of_the_router(router) -> None:
    found = router.quick.crowds(clock(router, "2025-05-24T12:30"))
    known = [street.density for street in router.crowds("2025-05-24T12:30").streets]
    assert found == pytest.approx(known, rel=1e-3, abs=1e-6)


def test_departures_of_a_day_share_tables(router, monkeypatch) -> None:
    quick, made = router.quick, []
    quick.route(0, 2, clock(router, "Sat 12:30"))
    kept = next(iter(quick.tables._kept.values()))
    monkeypatch.setattr("sidestep.routing.street_times.street_times", lambda *given: made.append(given) or kept)
    quick.tables._kept.clear()
    for departure in ("Sat 12:30", "Sat 12:31", "Sat 13:29", "Sat 13:31", "Sun 12:31"):
        quick.route(0, 2, clock(router, departure))
    assert len(made) == 3
    quick.tables._kept.clear()


def test_grids_have_no_coordinates() -> None:
    from sidestep.scenarios.builtin import scenario

    with pytest.raises(RouteError) as found:
        _ = Router(scenario("paper-congested", side=3, crowded_nodes=1)).quick
    assert found.value.field == "format"


@pytest.fixture(scope="module")
def gated(tiny, block, tmp_path_factory) -> Callable[[int], tuple[Scenario, Town]]:
    """Streets with gates, some of them restricted, in a crowd that changes every five minutes."""

    def make(seed: int) -> tuple[Scenario, Town]:
        rng = np.random.default_rng(seed)
        times = rng.choice(len(TIMES), STREETS, p=[0.6, 0.1, 0.1, 0.2])
        restricted = rng.random(STREETS) < 0.25
        folder = tmp_path_factory.mktemp("gated")
        town = replace(
            block(), opening=tuple(TIMES[number] for number in times), restricted=restricted,
            kind=tuple(rng.choice(["footway", "path"], STREETS).tolist()),
        )  # fmt: skip
        save_town(town, folder / "town.npz")
        rows = [
            f"{street},2025-05-24T12:{minute:02},{density:.2f}"
            for street in range(STREETS)
            for minute, density in zip(range(0, 60, 5), rng.uniform(0, 0.7, 12), strict=True)
        ]
        with TemporaryDirectory() as drawer:
            (Path(drawer) / "crowds.csv").write_text("\n".join(["street,time,density", *rows]))
            save_crowd_table(read_table(Path(drawer) / "crowds.csv", town), folder / "crowds.npz")
        source = CrowdTable(file=str(folder / "crowds.npz"), noise=(0.9, 0.0))
        venue = Venue(streets=str(folder / "town.npz"), crowd_source=source, days=(5,), hours=(12, 13))
        return tiny.changed(name="gated", place=venue), town

    return make


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_planner_finds_the_same_routes(gated, seed: int) -> None:
    """Through gates and around restricted areas, from anywhere to anywhere, at any minute."""
    problem, town = gated(seed)
    router, rng = Router(problem), np.random.default_rng(seed)
    for _ in range(4):
        departure = f"Sat 12:{rng.integers(0, 40):02}"
        streets, fractions = rng.integers(0, STREETS, 2), rng.uniform(0.05, 0.95, 2)
        ends = [point(town, int(street), float(part)) for street, part in zip(streets, fractions, strict=True)]
        if streets[0] == streets[1]:
            fractions = np.array([0.2, 0.7])
        exclude = ("path",) if rng.random() < 0.3 else ()
        plan = None
        with suppress(RouteError):
            plan = router.answer(_request(ends, departure, exclude))
        if plan is None:
            with pytest.raises(RouteError) as found:
                router.quick.route(*ends, clock(router, departure), exclude)
            assert found.value.field == "destination"
            continue
        if not plan.arrives:  # waits at gates for longer than the horizon
            with pytest.raises(RouteError):
                router.quick.route(*ends, clock(router, departure), exclude)
            continue
        route = router.quick.route(*ends, clock(router, departure), exclude)
        # Times are tabulated every minute and linear in between; a gate opens within one of these.
        assert route.seconds == pytest.approx(60 * plan.expected_minutes, rel=0.02, abs=20)


def _request(ends: list[StreetPoint], departure: str, exclude: tuple[str, ...]):
    from sidestep.routing.request import RouteRequest

    origin, destination = (end.place for end in ends)
    return RouteRequest(origin, destination, read_departure(departure), futures=1, exclude=exclude)
