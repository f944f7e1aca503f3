"""Waits of venues: the lights and crossings of their streets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.network.formats import load_helsinki
from sidestep.planners.base import walk_plan
from sidestep.planners.reactive import GreedyMap
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import instances
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.places import Light, Traffic

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))


def test_lights_and_crossings_are_those_of_the_streets_both_ways() -> None:
    town = load_helsinki()
    street, _ = town.street_of_segment()
    # Without traffic nobody waits but for lifts.
    lifts = np.array([kind == "elevator" for kind in town.kind])[street]
    waited = draw_map(HELSINKI, 1).waits.seconds(
        jnp.float32(8), jnp.float32(0), jnp.arange(len(street)), jnp.zeros(len(street))
    )
    np.testing.assert_array_equal(waited, np.where(lifts, 60.0, 0.0))
    lit = HELSINKI.changed(traffic=Traffic(vehicles=720.0))
    waits = draw_map(lit, 1).waits
    street, back = town.street_of_segment()
    np.testing.assert_array_equal(waits.lights, town.signals[street])
    np.testing.assert_array_equal(waits.unsignalised, town.crossings[street])
    assert np.ptp(np.asarray(waits.offset)[np.asarray(waits.lights) > 0]) > 60
    # A street's light is one for both directions.
    first = np.asarray(waits.offset)[: town.streets]
    np.testing.assert_array_equal(np.asarray(waits.offset)[back], first[street[back]])
    assert float(waits.vehicles.max()) == pytest.approx(0.2)
    # A light whose timing is known, on a street that has none in OpenStreetMap.
    dark = int(np.argmin(town.signals))
    middle = town.course(dark).mean(axis=0)[::-1] if len(town.course(dark)) == 2 else town.course(dark)[1][::-1]
    known = Light(name="known", place=tuple(middle.tolist()), cycle=60.0, green=20.0, offset=5.0)
    timed = draw_map(HELSINKI.changed(traffic=Traffic(lights=(known,))), 1).waits
    both = np.flatnonzero(street == dark)
    found = [np.asarray(each)[both].tolist() for each in (timed.lights, timed.cycle, timed.green, timed.offset)]
    assert found == [[one] * len(both) for one in (1, 60, 20, 5)]
    others = street != dark
    np.testing.assert_array_equal(np.asarray(timed.offset)[others], np.asarray(waits.offset)[others])


def test_nobody_beats_who_knows_the_phases_of_all_lights() -> None:
    lit = HELSINKI.changed(traffic=Traffic())
    destinations = np.array([[3], [400]])
    here = draw_map(lit, 1)
    params = make_environment(lit, here, "test", 2, level="map", destinations=destinations)
    todo = instances(lit, here, params, 2, destinations=destinations)
    minutes = {}
    for planner in (Expected(), GreedyMap(), Clairvoyant()):
        walked = walk_plan(planner, params, planner.plan(params, todo), todo, jax.random.key(0))
        minutes[planner.name] = np.asarray(walked.seconds) / 60
    for name in ("expected", "greedy-map"):
        assert (minutes[name] >= minutes["clairvoyant"] - 1e-3).all()
