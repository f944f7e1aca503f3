"""Walkers in a small town of which everything is known: what they take, where they go, and what results say of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidestep.network.formats import save_town
from sidestep.network.parts import largest_part
from sidestep.routing.request import RouteError
from sidestep.routing.router import Router
from sidestep.scenarios.episodes import check_paths, random_destinations
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.spec import ScenarioError
from sidestep.scenarios.streets import for_walkers, town_of, walked_streets, walker_facts
from sidestep.scenarios.walkers import ADULT, Child, Custom, Robot, Walker, Wheelchair

STEPS, QUAY_STREET = 3, 5
WHEELS = Wheelchair(least_width=0.0)


@pytest.fixture(scope="session")
def tall(tiny, town) -> Scenario:
    """The small town without its island; a way back from 4 to 1; steps that lead up from 3 to 4.

    ::

        3 =steps= 4
        |         |
        0 ------- 1 --- 2
        '---------'     |
                        5
    """
    back = replace(town, one_way=np.zeros(town.streets, bool))
    rising = replace(back, incline=np.where(np.arange(town.streets) == STEPS, 0.5, np.nan).astype(np.float32))
    file = Path(tiny.place.streets).with_name("tall.npz")
    kept = np.arange(town.streets) < town.streets - 1
    save_town(largest_part(rising, kept).town, file)
    return tiny.changed(streets=str(file))


def walk(problem: Scenario, walker: Walker, origin: int, destination: int, planner: str = "expected"):
    return Router(problem.changed(walker=walker)).plan(origin, destination, futures=2, planner=planner)


def test_seconds_on_stairs(tall) -> None:
    # 200 m of stairs: up at .61 m/s, down at .69, or at half of that. The way round is 100 + 200 + 100 m.
    half = Custom(free_speed=0.67)
    for walker, up, down in ((ADULT, 200 / 0.61, 200 / 0.69), (half, 400 / 0.61, 400 / 0.69)):
        upstairs, downstairs = (walk(tall, walker, *ends, planner="shortest-path") for ends in ((3, 4), (4, 3)))
        assert (upstairs.metres, downstairs.metres) == pytest.approx((200, 200), abs=0.1)
        assert 60 * upstairs.expected_minutes == pytest.approx(up, rel=1e-3)
        assert 60 * downstairs.expected_minutes == pytest.approx(down, rel=1e-3)
    # The way round takes 400 / 1.34 = 298.5 s: faster than 327.9 s up, and slower than 289.9 s down.
    up, down = (walk(tall, ADULT, *ends) for ends in ((3, 4), (4, 3)))
    assert (up.metres, down.metres) == pytest.approx((400, 200), abs=0.1)
    assert 60 * up.expected_minutes == pytest.approx(400 / 1.34, rel=1e-3)
    assert up.walker is None
    assert "Walker" not in up.to_text()


def test_a_wheelchair_takes_the_way_round(tall) -> None:
    for ends in ((3, 4), (4, 3)):
        plan = walk(tall, WHEELS, *ends, planner="shortest-path")
        assert plan.metres == pytest.approx(400, abs=0.1)
        assert 60 * plan.expected_minutes == pytest.approx(400 / 0.79, rel=1e-3)
    assert plan.walker["kind"] == "wheelchair"
    assert (plan.walker["streets"], plan.walker["streets_left_out"]) == (7, 1)
    assert plan.to_json()["walker"] == plan.walker == walker_facts(tall.changed(walker=WHEELS))
    line = next(line for line in plan.to_text().splitlines() if line.startswith("Walker"))
    assert "wheelchair" in line
    assert "0.79 m/s" in line
    assert "1 of 7 streets" in line


def test_a_child_takes_longer_in_the_same_crowd(tall) -> None:
    # Along the Quay, where there is always half a person per m².
    adult, child, robot = (walk(tall, walker, 2, 5) for walker in (ADULT, Child(), Robot(least_width=0.0)))
    assert child.expected_minutes / adult.expected_minutes == pytest.approx(1.34 / 0.81, rel=1e-5)
    assert child.mean_density == pytest.approx(adult.mean_density, rel=1e-3)
    # As if there were two: 1 - exp(-1.913 (1/p - 1/5.4)) is .968937 for .5 and .452417 for 2.
    ratio = 1.34 * 0.968937 / (1.79 * 0.452417)
    assert robot.expected_minutes / adult.expected_minutes == pytest.approx(ratio, rel=0.01)


def test_crossings_keep_their_numbers_for_everybody(tall) -> None:
    # Without kerbs higher than 0 on the lower street, what lies beyond is out of reach.
    town = town_of(tall.place.streets)
    file = Path(tall.place.streets).with_name("kerbs.npz")
    kerb = np.where(np.isin(np.arange(town.streets), (STEPS, 1)), 0.1, 0).astype(np.float32)
    save_town(replace(town, kerb=kerb), file)
    problem = tall.changed(streets=str(file), walker=WHEELS)
    part = walked_streets(str(file), WHEELS)
    assert part.crossings.tolist() == [0, 1, 3, 4]  # not 2 and 5, beyond the kerb
    here = draw_map(problem, 0)
    assert here.network.nodes == town.nodes
    assert here.origins == here.destinations == (0, 1, 3, 4)
    check_paths(here)
    assert sorted(random_destinations(here, 4, 0).ravel().tolist()) == [0, 1, 3, 4]
    router = Router(problem)
    assert router.plan(0, 4, futures=2).nodes[0] == 0
    for ends, field in (((2, 0), "origin"), ((0, 5), "destination")):
        with pytest.raises(RouteError) as caught:
            router.plan(*ends)
        assert caught.value.field == field
    with pytest.raises(ScenarioError) as caught:
        draw_map(problem.changed(origins=(0, 2)), 0)
    assert caught.value.field == "origins"
    assert draw_map(problem.changed(origins=(0, 1)), 0).origins == (0, 1)


def test_walkers_of_one_comparison_take_the_same_walks(tall) -> None:
    assert [each.walker for each in for_walkers(tall, [ADULT, Child()])] == [ADULT, Child()]
    assert for_walkers(tall, [ADULT])[0] == tall
    fussy = WHEELS.changed(least_width=3.0)
    with pytest.raises(ScenarioError) as caught:
        for_walkers(tall, [ADULT, fussy])
    assert caught.value.field == "walker"
    town = town_of(tall.place.streets)
    file = Path(tall.place.streets).with_name("narrow.npz")
    save_town(replace(town, width=np.where(np.arange(town.streets) == 1, 0.5, 2).astype(np.float32)), file)
    problem = tall.changed(streets=str(file))
    several = for_walkers(problem, [ADULT, Wheelchair()])
    maps = [draw_map(each, 3) for each in several]
    assert maps[0].origins == maps[1].origins == maps[1].destinations == (0, 1, 3, 4)
    np.testing.assert_array_equal(*(random_destinations(each, 3, 0) for each in maps))
    own = for_walkers(problem.changed(origins=(0,)), [ADULT, Wheelchair()])
    assert [each.place.origins for each in own] == [(0,), (0,)]
    assert own[0].place.destinations == (0, 1, 3, 4)


def test_crowds_are_those_of_all_streets(tall, hours) -> None:
    whole, left = (draw_map(tall.changed(walker=walker), 0) for walker in (ADULT, WHEELS))
    segments = walked_streets(tall.place.streets, WHEELS).segments()
    assert len(segments) == left.network.segments == whole.network.segments - 2
    for name in ("sensor", "weight"):
        before, after = (getattr(each.flow.weights, name) for each in (whole, left))
        np.testing.assert_array_equal(after, np.asarray(before)[segments])
    # Recorded weeks stay what walks are tested in.
    np.testing.assert_array_equal(left.test_flow.record, whole.test_flow.record)
    # A table of the whole town serves those who do not take all of it.
    whole, left = (draw_map(hours().changed(walker=walker), 0) for walker in (ADULT, WHEELS))
    segments = walked_streets(hours().place.streets, WHEELS).segments()
    np.testing.assert_allclose(left.flow.volume, np.asarray(whole.flow.volume)[:, segments], rtol=1e-6)


def test_maps_are_the_same_for_walkers_that_take_the_same_streets(tall) -> None:
    adult, child, wheels = (draw_map(tall.changed(walker=walker), 0) for walker in (ADULT, Child(), WHEELS))
    assert adult.fingerprint == child.fingerprint != wheels.fingerprint
    assert adult.network.pace is not None
    assert wheels.network.pace is None


def test_a_lift_takes_a_minute_and_stays_where_it_is_on_split_streets(tall, place) -> None:
    town = town_of(tall.place.streets)
    file = Path(tall.place.streets).with_name("lift.npz")
    kind = tuple("elevator" if street == QUAY_STREET else one for street, one in enumerate(town.kind))
    save_town(replace(town, kind=kind), file)
    problem = tall.changed(streets=str(file))
    for walker, wait in ((ADULT, 60), (Custom(free_speed=1.34, lift_wait=15.0), 15)):
        plain, lifted = walk(tall, walker, 2, 5), walk(problem, walker, 2, 5)
        assert 60 * (lifted.expected_minutes - plain.expected_minutes) == pytest.approx(wait, abs=0.01)
        assert 60 * (lifted.median_minutes - plain.median_minutes) == pytest.approx(wait, abs=0.5)
    # Who is inside has waited before.
    inside, outside = (Router(each).plan(place(300, -30), 5, futures=2) for each in (problem, tall))
    assert inside.expected_minutes == pytest.approx(outside.expected_minutes)
