"""Walks under way through towns in which all times are known, and on grids."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timedelta

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.presets import preset
from sidestep.agent.runs import train
from sidestep.environment.dynamics import reset, step
from sidestep.environment.types import Instance
from sidestep.errors import SidestepError
from sidestep.network.formats import save_town
from sidestep.planners.base import Planner, Remembering
from sidestep.planners.random import RandomWalk
from sidestep.planners.reactive import GreedyLocal, GreedyMap
from sidestep.planners.real_time import LrtaStar
from sidestep.routing.deciding import LEAST_GAIN
from sidestep.routing.live import begin, replan, report
from sidestep.routing.request import RouteError, RouteRequest, read_departure
from sidestep.routing.router import Router
from sidestep.routing.under_way import Ahead, Decision, WalkUnderWay
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import ObjectiveSpec
from sidestep.scenarios.places import Counters, Sensor
from sidestep.walking.sightings import COUNTS_FOR, FORGOTTEN
from sidestep.walking.speed_laws import FREE_SPEED, Weidmann

NOON = datetime.fromisoformat("2025-05-24T12:30")  # a Saturday
EAST, SOUTH = 90, 180
LONG_METRES, BACK_METRES = 200, 300
MOST = 6  # crossings of a walk before the horizon
SMALL = scenario("rush-16", side=3, crowded_nodes=1, horizon=2 * 3600.0)


def after(seconds: float) -> datetime:
    return NOON + timedelta(seconds=seconds)


def law(density: float) -> float:
    return float(Weidmann().speed(jnp.float32(density)))


@pytest.fixture(scope="module")
def quiet(tabled) -> Router:
    """Nobody walks there, except on the Quay."""
    return Router(tabled("street,direction,time,density", "5,,2025-05-24T12:00,0.5", "5,,2025-05-24T13:00,0.5"))


@pytest.fixture(scope="module")
def walk(quiet) -> Callable[..., tuple[WalkUnderWay, Decision]]:
    """From node 3 by way of node 0 and Long Street, or Back Road, to node 2."""

    def make(planner: str | None = None, origin=3, destination=2, **more: object) -> tuple[WalkUnderWay, Decision]:
        return begin(quiet, RouteRequest(origin, destination, depart=NOON, planner=planner, **more))

    return make


def streets(decision: Decision) -> list[str]:
    return [leg.name for leg in decision.plan.legs]


def test_a_walk_begins_with_the_planned_route(router, place) -> None:
    request = RouteRequest(place(50, 4), place(300, -50), depart=NOON, futures=7)
    under_way, found = begin(router, request)
    plan = router.answer(request)
    assert [leg.segment for leg in found.plan.legs] == [leg.segment for leg in plan.legs]
    assert found.plan.minutes == pytest.approx(plan.minutes, rel=1e-5)
    assert (found.p50, found.p90) == pytest.approx((60 * plan.median_minutes, 60 * plan.p90_minutes), rel=1e-4)
    assert found.seconds == pytest.approx(60 * plan.expected_minutes)
    assert found.arrives == after(round(found.seconds)).isoformat()
    assert (found.changed, found.why, found.arrived, found.seen, found.left_route) == (False, None, False, False, False)
    assert (under_way.planner, under_way.arrival) == ("expected", pytest.approx(found.seconds))
    assert (found.next.turn, found.next.street, found.next.metres) == ("head east", "Long Street", 0)
    assert found.next.bearing == pytest.approx(EAST, abs=1e-3)


@pytest.mark.parametrize("planner", ["expected", "shortest-path", "greedy-map", "snapshot", "forecast", "clairvoyant"])
def test_a_walker_on_its_route_arrives_and_nothing_changes(router, place, planner: str) -> None:
    under_way, first = begin(router, RouteRequest(place(50, 4), place(300, -90), depart=NOON, planner=planner))
    # By Long Street, one position every 30 s, off by up to 12 m: 250 m to node 2 and 90 m of the Quay.
    places = [(x, 12 * (-1) ** (x // 40)) for x in range(90, 300, 40)] + [(312, -30), (290, -60), (300, -80)]
    seconds, left, arrived = 0.0, first.seconds, []
    for x, y in places:
        seconds += 30
        under_way, found = report(router, under_way, place(x, y), after(seconds))
        assert (found.changed, found.why, found.left_route) == (False, None, False)
        assert found.seconds < left
        assert found.seconds == pytest.approx(60 * found.plan.expected_minutes if found.plan else 0)
        left = found.seconds
        arrived.append(found.arrived)
    assert arrived == [False] * (len(places) - 1) + [True]
    assert (found.next, found.plan, found.p50, found.p90) == (None, None, 0, 0)
    assert (under_way.nodes[1:], under_way.arrived, under_way.arrival) == ((1, 2), True, seconds)
    # And that is where it stays.
    again, still = report(router, under_way, place(0, 0), after(seconds + 10))
    assert (still.arrived, again.arrived) == (True, True)


def test_times_are_those_of_what_is_left(walk, quiet, place) -> None:
    under_way, first = walk()
    on_quay = 100 / law(0.5)
    assert first.seconds == pytest.approx(100 / FREE_SPEED + (LONG_METRES + 100) / FREE_SPEED, rel=1e-4)
    # The Quay is not on this route; 60 m from node 0, and 15 s late.
    under_way, found = report(quiet, under_way, place(0, 60), after(45))
    assert found.seconds == pytest.approx(360 / FREE_SPEED, rel=1e-4)
    assert under_way.arrival == pytest.approx(45 + 360 / FREE_SPEED, rel=1e-4)
    assert (found.p50, found.p90) == pytest.approx((found.seconds, found.seconds), rel=1e-4)
    assert found.plan.metres == pytest.approx(360, rel=1e-4)
    assert found.plan.legs[0].coordinates[0] == pytest.approx(place(0, 60)[::-1], abs=1e-7)
    assert sum(leg.minutes for leg in found.plan.legs) == pytest.approx(found.seconds / 60, rel=1e-4)
    assert (found.next.turn, found.next.street, found.next.node) == ("turn left", "Long Street", 0)
    assert found.next.metres == pytest.approx(60, rel=1e-3)
    assert [step.street for step in found.plan.steps] == ["footway", "Long Street"]
    assert found.plan.nodes == [None, 0, 1, 2]
    # Once round the corner the route is a straight line to its end.
    under_way, found = report(quiet, under_way, place(30, 0), after(100))
    assert found.seconds == pytest.approx(270 / FREE_SPEED, rel=1e-4)
    assert under_way.nodes == (3,)
    assert under_way.metres == pytest.approx(130, rel=1e-3)
    # On the Quay it is as slow as its crowd.
    _, quay = begin(quiet, RouteRequest(2, 5, depart=NOON))
    assert quay.seconds == pytest.approx(on_quay, rel=1e-4)


def test_the_first_dense_crowd_on_the_way_is_told(walk, quiet, place) -> None:
    under_way, found = walk()
    assert found.crowd_ahead is None
    ahead = [Ahead(bearing=EAST, density=1.0)]
    under_way, found = report(quiet, under_way, place(0, 60), after(30), ahead=ahead)
    crowd = found.crowd_ahead
    assert (crowd.leg.label, crowd.crowding) == ("Long Street", "dense")
    assert crowd.metres == pytest.approx(60, rel=1e-3)
    _, there = report(quiet, under_way, place(300, 0), after(400))
    assert (there.arrived, there.crowd_ahead) == (True, None)


@pytest.mark.parametrize("gain", [-30.0, -1.0, LEAST_GAIN - 1, LEAST_GAIN + 1, 60.0])
def test_a_crowd_ahead_is_avoided_exactly_where_the_detour_is_shorter(walk, quiet, place, gain: float) -> None:
    """Long Street takes 200 m / v(density) instead of 149 s, and Back Road 300 m / 1.34 m/s = 224 s."""
    wanted = LONG_METRES / (BACK_METRES / FREE_SPEED + gain)
    # v = 1.34 (1 - exp[-1.913 (1/density - 1/5.4)]), for the density
    density = 1 / (1 / 5.4 - np.log(1 - wanted / FREE_SPEED) / 1.913)
    assert law(density) == pytest.approx(wanted, rel=1e-5)
    under_way, _ = walk()
    under_way, found = report(quiet, under_way, place(2, 30), after(60), ahead=[Ahead(bearing=EAST, density=density)])
    changes = gain > LEAST_GAIN
    assert found.changed == changes
    assert streets(found)[1] == ("Back Road" if changes else "Long Street")
    over = min(BACK_METRES / FREE_SPEED, LONG_METRES / wanted) if changes else LONG_METRES / wanted
    assert found.seconds == pytest.approx(130 / FREE_SPEED + over, rel=1e-3)
    assert found.seen
    if changes:
        saved = "1 min" if gain == 60 else f"{gain:.0f} s"
        assert found.why == f"a crowd of {density:.1f} persons/m² ahead on Long Street: {saved} longer that way"
    # It stays that way at the crossing, where nothing is seen any more.
    under_way, there = report(quiet, under_way, place(0, 2), after(80))
    assert (there.changed, streets(there)[-2]) == (False, "Back Road" if changes else "Long Street")
    assert there.next.segment == found.plan.legs[1].segment


@pytest.mark.parametrize("planner", ["expected", "snapshot", "forecast", "clairvoyant"])
def test_planners_that_know_the_counts_avoid_crowds_that_are_not_counted(router, place, planner: str) -> None:
    under_way, _ = begin(router, RouteRequest(3, 2, depart=NOON, planner=planner, futures=7))
    for density, street in ((0.2, "Long Street"), (3.0, "Back Road")):
        _, found = report(router, under_way, place(0, 30), after(60), ahead=[Ahead(bearing=EAST, density=density)])
        assert (found.next.street, streets(found)[1]) == (street, street)
        took = 130 / FREE_SPEED + (LONG_METRES / law(density) if street == "Long Street" else BACK_METRES / FREE_SPEED)
        assert (found.seconds, found.p50) == pytest.approx((took, took), rel=2e-3)


@pytest.mark.parametrize(("time", "exposure"), [(1.0, 0.5), (0.1, 1.0)])
def test_an_objective_decides_on_the_way(tiny, place, time: float, exposure: float) -> None:
    """Long Street costs 149 s (time + density x exposure), Back Road 224 s x time."""
    here = Router(tiny.changed(objective=ObjectiveSpec(time=time, exposure=exposure)))
    under_way, _ = begin(here, RouteRequest(3, 2, depart=NOON, futures=7))
    for density in (0.1, 0.3, 0.7, 1.1):
        _, found = report(here, under_way, place(0, 30), after(60), ahead=[Ahead(bearing=EAST, density=density)])
        seconds = LONG_METRES / law(density)
        saves = seconds * (time + density * exposure) - time * BACK_METRES / FREE_SPEED
        assert abs(saves - LEAST_GAIN) > 1
        assert streets(found)[1] == ("Back Road" if saves > LEAST_GAIN else "Long Street")


def test_crowds_are_forgotten(walk, quiet, place) -> None:
    under_way, _ = walk()
    crowd = [Ahead(bearing=EAST, density=4.0)]
    under_way, found = report(quiet, under_way, place(0, 30), after(60), ahead=crowd)
    assert streets(found)[1] == "Back Road"
    # Whoever waits there finds the crowd as it was, then thinner, and then gone.
    under_way, found = report(quiet, under_way, place(0, 30), after(60 + COUNTS_FOR))
    assert (found.seen, streets(found)[1], len(under_way.sightings)) == (True, "Back Road", 1)
    under_way, found = report(quiet, under_way, place(0, 30), after(62 + COUNTS_FOR))
    assert (found.seen, streets(found)[1]) == (False, "Back Road")
    under_way, found = report(quiet, under_way, place(0, 30), after(60 + FORGOTTEN))
    assert (streets(found)[1], found.changed, under_way.sightings) == ("Long Street", True, ())
    assert found.why == "Long Street is 1 min faster by now"


def test_the_latest_crowd_of_a_street_counts(walk, quiet, place) -> None:
    under_way, _ = walk()
    under_way, found = report(quiet, under_way, place(0, 60), after(40), ahead=[Ahead(bearing=EAST, density=4.0)])
    assert found.why.startswith("a crowd of 4.0 persons/m² ahead on Long Street")
    under_way, found = report(quiet, under_way, place(0, 30), after(60), ahead=[Ahead(bearing=100, density=0.1)])
    assert (streets(found)[1], len(under_way.sightings)) == ("Long Street", 1)
    assert found.why == "only 0.1 persons/m² on Long Street: 1 min faster that way"


def test_a_crowd_around_the_walker_slows_it_down(walk, quiet, place) -> None:
    under_way, _ = walk()
    under_way, found = report(quiet, under_way, place(0, 60), after(30), density=2.0)
    assert found.seconds == pytest.approx(60 / law(2.0) + 300 / FREE_SPEED, rel=1e-3)
    assert found.plan.legs[0].density == pytest.approx(2.0)
    assert found.p90 == pytest.approx(found.seconds, rel=1e-3)
    # By the number of its segment a crowd may be that of any street.
    later = found.plan.legs[-1].segment
    _, more = report(quiet, under_way, place(0, 60), after(30), ahead=[Ahead(segment=later, density=2.0)])
    assert more.seconds == pytest.approx(found.seconds + 100 / law(2.0) - 100 / FREE_SPEED, rel=1e-3)


def test_who_is_beside_the_street_is_on_it(walk, quiet, place) -> None:
    under_way, _ = walk()
    for beside in (10, -19):  # Back Road is 50 m away from Long Street
        _, found = report(quiet, under_way, place(100, beside), after(160))
        assert (found.left_route, found.metres_away) == (False, pytest.approx(abs(beside), rel=1e-3))
        assert found.seconds == pytest.approx(200 / FREE_SPEED, rel=1e-3)


def test_who_leaves_the_route_gets_another(walk, quiet, place) -> None:
    under_way, _ = walk()
    under_way, _ = report(quiet, under_way, place(0, 5), after(70))
    # By Back Road there are 150 m to node 1, back by Long Street 350 m.
    there, found = report(quiet, under_way, place(100, -45), after(190))
    assert (found.left_route, found.changed, found.why) == (True, True, "left the route")
    assert found.metres_away == pytest.approx(5, rel=1e-3)
    assert streets(found) == ["Back Road", "Long Street"]
    assert found.seconds == pytest.approx(250 / FREE_SPEED, rel=1e-3)
    assert (there.begins, there.nodes, there.origin) == (pytest.approx(place(100, -45)), (3,), 3)
    # It goes on from there.
    there, found = report(quiet, there, place(160, -50), after(240))
    assert (found.left_route, found.changed, found.seconds) == (False, False, pytest.approx(190 / FREE_SPEED, rel=1e-3))
    there, found = report(quiet, there, place(240, 0), after(400))
    assert (found.left_route, there.nodes) == (False, (3, 8))  # the place where it left the route has a number as well
    there, found = report(quiet, there, place(291, 0), after(440))
    assert found.arrived


def test_who_turns_back_has_left_the_route(walk, quiet, place) -> None:
    under_way, _ = walk()
    under_way, _ = report(quiet, under_way, place(100, 0), after(150))
    _, near = report(quiet, under_way, place(90, 0), after(160))
    assert (near.left_route, near.seconds) == (False, pytest.approx(200 / FREE_SPEED, rel=1e-3))
    _, found = report(quiet, under_way, place(70, 0), after(175))
    assert (found.left_route, found.next.turn, streets(found)) == (True, "head east", ["Long Street"] * 2)


def test_near_the_end_off_the_route_is_there(walk, quiet, place) -> None:
    under_way, _ = walk(destination=place(50, 0))
    _, found = report(quiet, under_way, place(50, -10), after(150))
    assert found.arrived


@pytest.mark.parametrize(
    ("location", "time", "more", "field"),
    [
        ((48.0, 11.0), 60, {}, "location"),
        ((float("nan"), 0.0), 60, {}, "location"),
        ((0.0, 95.0), 60, {}, "location"),
        (99, 60, {}, "location"),
        (7, 60, {}, "location"),  # on the island
        ("somewhere", 60, {}, "location"),
        (0, -1, {}, "time"),
        (0, 29, {}, "time"),
        (0, 60, {"density": -0.1}, "density"),
        (0, 60, {"density": float("nan")}, "density"),
        (0, 60, {"density": 99.0}, "density"),
        (0, 60, {"ahead": [Ahead(density=float("inf"), bearing=1.0)]}, "ahead"),
        (0, 60, {"ahead": [Ahead(density=1.0)]}, "ahead"),
        (0, 60, {"ahead": [Ahead(density=1.0, bearing=float("nan"))]}, "ahead"),
        (0, 60, {"ahead": [Ahead(density=1.0, segment=999)]}, "ahead"),
    ],
)
def test_reports_that_say_nothing_are_refused(walk, quiet, place, location, time, more: dict, field: str) -> None:
    under_way, _ = walk()
    under_way, _ = report(quiet, under_way, place(0, 60), after(30))
    with pytest.raises(SidestepError) as caught:
        report(quiet, under_way, location, after(time), **more)
    assert caught.value.field == field


def test_a_crowd_in_no_direction_of_a_street_is_left_out(walk, quiet, place) -> None:
    under_way, _ = walk()
    under_way, found = report(quiet, under_way, place(0, 60), after(30), ahead=[Ahead(bearing=270, density=4.0)])
    assert (under_way.sightings, found.seen) == ((), False)


def test_walks_are_those_of_their_scenario(walk, router) -> None:
    under_way, _ = walk()
    with pytest.raises(RouteError) as caught:
        report(router, under_way, 0, after(60))
    assert caught.value.field == "walk"


@pytest.mark.parametrize(
    ("more", "field"),
    [
        ({"by": 10.0}, "by"),
        ({"alternatives": 1}, "alternatives"),
        ({"arrive_by": NOON}, "arrive_by"),
        ({"planner": RandomWalk()}, "planner"),
        ({"planner": "nobody"}, "planner"),
        ({"avoid": "area.json"}, "avoid"),
        ({"origin": (48.0, 11.0)}, "origin"),
        ({"destination": 7}, "destination"),
    ],
)
def test_walks_that_cannot_begin(quiet, more: dict, field: str) -> None:
    with pytest.raises(SidestepError) as caught:
        begin(quiet, RouteRequest(**{"origin": 3, "destination": 2, "depart": NOON, **more}))
    assert caught.value.field == field


def test_another_process_goes_on_with_a_walk(tiny, place) -> None:
    def walked(*, written: bool) -> list[dict]:
        here = Router(tiny)
        under_way, first = begin(here, RouteRequest(place(50, 4), place(300, -90), depart=NOON, planner="greedy-map"))
        told = [first.to_json()]
        crowd = [Ahead(bearing=EAST, density=0.3)]
        for x, y, seconds in ((100, 5, 40), (200, -40, 150), (200, 2, 200), (299, 3, 400)):
            if written:
                under_way, here = WalkUnderWay.from_json(json.loads(json.dumps(under_way.to_json()))), Router(tiny)
            under_way, found = report(here, under_way, place(x, y), after(seconds), density=0.5, ahead=crowd)
            told.append(found.to_json())
        return json.loads(json.dumps(told))

    alone = walked(written=False)
    assert walked(written=True) == alone
    assert [each["left_route"] for each in alone] == [False, False, True, False, False]


def test_what_is_no_walk_is_refused(walk) -> None:
    state = walk()[0].to_json()
    for wrong in ({}, {**state, "clock": "noon"}, {**state, "along": float("nan")}, {**state, "more": 1}):
        with pytest.raises(RouteError) as caught:
            WalkUnderWay.from_json(wrong)
        assert caught.value.field == "walk"


def test_segments_that_are_no_route_are_refused(walk, quiet) -> None:
    under_way, _ = walk()
    for segments in ((0, 0), (999,), (-1,)):
        with pytest.raises(RouteError) as caught:
            report(quiet, replace(under_way, segments=segments), 0, after(60))
        assert caught.value.field == "walk"


# --- Counts ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def counted(tiny) -> Router:
    """The counter of the Quay stands on Long Street: 0.5 persons/m², if nothing else is counted."""
    sensors = (Sensor(name="back road", place=(0, 250 / 111_195)), Sensor(name="the quay", place=(0, 100 / 111_195)))
    source = tiny.place.crowd_source
    counters = Counters(**{**vars(source), "sensors": sensors, "reach": 20.0})
    return Router(tiny.changed(place=tiny.place.model_copy(update={"crowd_source": counters})))


def test_new_counts_change_the_plan(counted, live) -> None:
    under_way, found = begin(counted, RouteRequest(3, 2, depart=NOON))
    assert streets(found)[1] == "Long Street"
    same, found = replan(counted, under_way)
    assert (found.changed, found.why, same) == (False, None, under_way)
    counts = live("2025-05-24 12:00,40000")
    under_way, found = replan(counted, under_way, live=counts, time=after(20))
    assert (found.changed, streets(found)[1]) == (True, "Back Road")
    assert found.why.startswith("new counts make Back Road, Long Street ")
    assert found.why.endswith(" min faster")
    # It knows of no other way from here, and sees no reason for another.
    under_way, found = report(counted, under_way, 0, after(75), live=counts)
    assert (found.changed, streets(found)[0]) == (False, "Back Road")


# --- Who sees only what is around ------------------------------------------------------------------------------------


def test_who_sees_nothing_believes_in_what_is_expected(walk, quiet, place) -> None:
    under_way, first = walk("greedy-local")
    under_way, found = report(quiet, under_way, place(0, 60), after(30))
    assert (first.seen, found.seen, found.next.street) == (False, False, "Long Street")
    # It sees the crowd, and goes straight on at free speed beyond: 50 m more by Back Road's end are nothing to it.
    under_way, found = report(quiet, under_way, place(0, 40), after(45), ahead=[Ahead(bearing=EAST, density=3.0)])
    assert (found.seen, found.next.street, found.changed) == (True, "Back Road", True)
    assert found.why.startswith("a crowd of 3.0 persons/m² ahead on Long Street")


class Wanderer(GreedyLocal):
    """Go where it was the longest ago."""

    name = "wanderer"

    @staticmethod
    def decide(_shared, _own, observation, _key) -> jax.Array:
        return jnp.argmax(jnp.where(observation.valid, observation.local.steps_since_visit, -1))


class With(Router):
    """Knows one planner."""

    def choose_planner(self, asked, located) -> Planner:
        return self.planner if asked == self.planner.name else super().choose_planner(asked, located)


def rolled_out(planner: Planner, future: int) -> tuple[list[int], list[tuple[int, float, Sequence]]]:
    """The segments that a planner walks in a future; where and when it decides, and what it sees from there."""
    here = draw_map(SMALL, 2)
    params = make_environment(SMALL, here, "test", 3, level=planner.observes, densities=True)
    params = replace(params, level=planner.observes)
    whole = jnp.int32
    state, seen = reset(params, Instance(whole(0), whole(8), jnp.float32(600), whole(future)))
    walked, looks, remembered = [], [], jnp.zeros(9)
    shared = planner.plan(params, jax.tree.map(lambda leaf: leaf[None], state.instance)).shared
    while int(state.node) != 8 and len(walked) < MOST:
        segments = [one for one in np.asarray(params.network.exit_segment)[int(state.node)].tolist() if one >= 0]
        slot = jnp.int32(min(int(state.clock // SMALL.slot_seconds), SMALL.slots - 1))
        density = params.futures.speeds.density_at(whole(future), jnp.array(segments), slot).tolist()
        looks.append((int(state.node), float(state.clock), [*zip(segments, density, strict=True)]))
        seen = replace(seen, remembered=remembered)
        if isinstance(planner, Remembering):
            remembered = remembered.at[state.node].set(planner.remember(shared, jnp.float32(0), seen))
        action = planner.decide(shared, jnp.float32(0), seen, jax.random.key(0))
        state, outcome = step(params, state, action)
        seen = outcome.observation
        walked.append(int(outcome.segment))
    return walked, looks


@pytest.mark.parametrize("planner", [GreedyLocal(), LrtaStar(), GreedyMap(), Wanderer()])
@pytest.mark.parametrize("future", [0, 1, 2])
def test_who_sees_the_same_decides_the_same(planner, future: int) -> None:
    here = With(SMALL, seed=2)
    here.planner = planner
    walked, looks = rolled_out(planner, future)
    under_way, _ = begin(here, RouteRequest(0, 8, depart=10.0, planner=planner.name))
    for segment, (node, clock, crowds) in zip(walked, looks, strict=True):
        ahead = [Ahead(segment=one, density=density) for one, density in crowds]
        under_way, found = report(here, under_way, node, clock / 60, ahead=ahead)
        assert (found.next.segment, found.seen, found.left_route) == (segment, True, False)
    assert len(walked) > 2
    if len(walked) == MOST:
        return
    under_way, found = report(here, under_way, 8, clock / 60 + 10)
    assert found.arrived
    assert under_way.nodes == tuple(node for node, *_ in looks)


@pytest.fixture(scope="module")
def dead_end(tiny, make_town, tmp_path_factory) -> Router:
    """Nobody walks there. Node 1 lies before node 3, to which only node 2 leads, 100 m south of node 0."""
    town = make_town([[0, 0], [100, 0], [0, -100], [200, 0]], [(0, 1), (0, 2), (2, 3)])
    save_town(town, file := tmp_path_factory.mktemp("dead-end") / "town.npz")
    sensors = (Sensor(name="back road", place=(0, 0)),)
    source = tiny.place.crowd_source.model_copy(update={"sensors": sensors})
    venue = tiny.place.model_copy(update={"streets": str(file), "crowd_source": source})
    return Router(tiny.changed(name="dead end", place=venue))


# Twice the straight line at free speed, in m: 400 from node 0, 200 from node 1, 447 from node 2.
TO_1 = max(400, 100 + 200)  # remembered of node 0, where 100 + 447 by node 2 are more
BACK = 100 + TO_1  # of node 1
TO_2 = 100 + 447.2136  # of node 0, where 100 + BACK are more by now


def kept(walk: WalkUnderWay) -> WalkUnderWay:
    """The walk as another process reads it."""
    return WalkUnderWay.from_json(json.loads(json.dumps(walk.to_json())))


def test_what_was_learned_on_the_way_is_kept(dead_end) -> None:
    walk, found = begin(dead_end, RouteRequest(0, 3, depart=NOON, planner="lrta-star"))
    assert found.plan.nodes == [0, 1, 0, 2, 3]
    for node, nodes in ((1, [1, 0, 2, 3]), (0, [0, 2, 3]), (2, [2, 3])):
        walk, found = report(dead_end, kept(walk), node, after(80 * (len(walk.nodes) + 1)))
        assert (found.plan.nodes, found.changed) == (nodes, False)
    again, found = replan(dead_end, kept(walk))
    assert (again.remembered, found.changed) == (walk.remembered, False)
    assert walk.nodes == (0, 1, 0)
    assert np.multiply(walk.remembered[:3], FREE_SPEED) == pytest.approx([TO_1, BACK, TO_2], rel=1e-5)


def test_crossings_passed_without_a_report_are_learned_as_well(dead_end) -> None:
    walk, _ = begin(dead_end, RouteRequest(0, 3, depart=NOON, planner="lrta-star"))
    walk, found = report(dead_end, walk, 2, after(240))
    assert (walk.nodes, found.plan.nodes) == ((0, 1, 0), [2, 3])
    assert np.multiply(walk.remembered[:3], FREE_SPEED) == pytest.approx([TO_1, BACK, TO_2], rel=1e-5)


def test_what_was_learned_outlives_the_route(dead_end, place) -> None:
    walk, _ = begin(dead_end, RouteRequest(0, 3, depart=NOON, planner="lrta-star"))
    walk, _ = report(dead_end, walk, 1, after(80))
    # 30 m from the dead end, but 25 m beside the street: it begins anew there, and knows better than to go back.
    walk, found = report(dead_end, kept(walk), place(70, 25), after(120))
    assert (found.left_route, walk.nodes) == (True, (0, 1))
    assert (found.plan.nodes[1], walk.remembered[1] * FREE_SPEED) == (0, pytest.approx(BACK, rel=1e-5))


def test_a_trained_model_walks(tmp_path) -> None:
    tiny = preset("default", "map").changed(rounds=2, round_steps=64, walkers=8, batch=16, capacity=64, hidden=(4,))
    train(SMALL, tiny.changed(test_walks=2, futures=2, fresh_futures=0), out=tmp_path / "model")
    here = Router(SMALL, model=tmp_path / "model")
    under_way, found = begin(here, RouteRequest(0, 8, depart=10.0))
    assert (under_way.planner, found.plan.planner, found.plan.level) == ("darp", "darp", "map")
    minutes, turns = 10.0, 0
    while not found.arrived and turns < 30:
        minutes, turns = minutes + 4, turns + 1
        onto = int(draw_map(SMALL, 0).network.head[found.next.segment])
        ahead = [Ahead(segment=found.next.segment, density=0.2)]
        under_way, found = report(here, under_way, onto, minutes, ahead=ahead)
        assert not found.left_route
    assert under_way.clock == 240.0 * turns


def test_grids_have_no_coordinates() -> None:
    here = Router(SMALL)
    under_way, found = begin(here, RouteRequest(depart=10.0))
    assert (found.next.latitude, found.plan.steps) == (None, None)
    assert found.arrives.endswith(" min after the start")
    with pytest.raises(RouteError) as caught:
        report(here, under_way, (60.0, 25.0), 11.0)
    assert caught.value.field == "location"


def test_times_without_a_date(hours, place) -> None:
    here = Router(hours())
    under_way, first = begin(here, RouteRequest(3, 2, depart=read_departure("Sat 12:02:30")))
    assert (under_way.crowds_at, under_way.crowds_from) == ("Saturday 12:00:00", -150)
    assert first.arrives.startswith("Saturday 12:0")
    under_way, found = report(here, under_way, place(0, 60), "Sat 12:05:10")
    assert (under_way.clock, under_way.crowds_at, under_way.crowds_from) == (160, "Saturday 12:05:00", 150)
    assert not found.changed
    with pytest.raises(RouteError) as caught:
        report(here, under_way, place(0, 60), "Sat 12:05:09")
    assert caught.value.field == "time"
    # Crowds are known until 14:00, and then stay as they are.
    under_way, found = report(here, under_way, place(0, 50), "Sat 14:01")
    assert (found.arrived, under_way.crowds_at) == (False, "Saturday 13:55:00")


def test_times_where_crowds_have_none(slots, place) -> None:
    here = Router(slots)
    under_way, first = begin(here, RouteRequest(3, 2))
    assert (first.arrives, under_way.crowds_at) == (None, None)
    under_way, found = report(here, under_way, place(0, 60), 0.5)
    assert (under_way.clock, found.changed) == (30, False)
    for wrong in ("12:30", 0.4):
        with pytest.raises(RouteError) as caught:
            report(here, under_way, place(0, 60), wrong)
        assert caught.value.field == "time"


# --- Rules of streets ------------------------------------------------------------------------------------------------


def test_who_came_in_before_the_gate_shuts_walks_on(tiny, town, place, tmp_path) -> None:
    gated = replace(town, opening=("Mo-Su 06:00-12:31", *town.opening[1:]))  # Long Street, from 0 to 1
    save_town(gated, tmp_path / "town.npz")
    here = Router(tiny.changed(place=tiny.place.model_copy(update={"streets": str(tmp_path / "town.npz")})))
    under_way, _ = begin(here, RouteRequest(0, 1, depart=NOON))
    under_way, found = report(here, under_way, place(60, 0), after(90))
    assert found.seconds == pytest.approx(140 / FREE_SPEED, rel=1e-3)
    # So does whoever turns back on it, but not somebody who is still before it.
    _, found = report(here, under_way, place(30, 0), after(95))
    assert (found.left_route, found.seconds) == (True, pytest.approx(170 / FREE_SPEED, rel=1e-3))
    under_way, _ = begin(here, RouteRequest(3, 1, depart=NOON))
    under_way, found = report(here, under_way, place(0, 50), after(90))
    assert streets(found)[-1] == "Back Road"


def test_a_report_compiles_nothing_that_was_compiled(tiny, place, compiled) -> None:
    here = Router(tiny)
    under_way, _ = begin(here, RouteRequest(3, 2, depart=NOON, futures=7))
    crowd = [Ahead(bearing=EAST, density=0.2)]
    under_way, _ = report(here, under_way, place(0, 60), after(30))
    under_way, _ = report(here, under_way, place(0, 30), after(60), ahead=crowd)
    under_way, _ = report(here, under_way, place(100, -50), after(90), density=0.1)
    compiled.clear()
    under_way, _ = begin(here, RouteRequest(place(300, -50), 3, depart=NOON, futures=7))
    for x, y, seconds in ((300, -20, 30), (250, 2, 330), (199, 6, 360), (120, -49, 700)):
        under_way, _ = report(here, under_way, place(x, y), after(seconds), density=0.3)
    replan(here, under_way)
    assert compiled == []
