"""Walks in venues: between which places, at which hours, through which futures, and what learns them."""

from datetime import datetime

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.presets import preset_for
from sidestep.crowds.counts import CountTable
from sidestep.crowds.live import LiveCount, latest
from sidestep.evaluation.compare import compare
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import check_paths, destinations_of, instances, random_destinations, sampler
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import draw_map, sensor_names, with_latest_counts, with_live_counts
from sidestep.scenarios.spec import ScenarioError

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))


@pytest.fixture(scope="module")
def place():
    return draw_map(HELSINKI, 1)


@pytest.fixture(scope="module")
def somewhere():
    """Helsinki with three origins and two destinations, one of them an origin too."""
    sensors = HELSINKI.place.crowd_source.sensors[:2]
    ends = dict(origins=(5, 17, 200), destinations=(17, 300))
    problem = HELSINKI.changed(streets_per_sensor=1, sensors=sensors, **ends, horizon=1800.0, departures=(0.0, 0.0))
    return problem, draw_map(problem, 0)


def test_every_walk_goes_elsewhere(place) -> None:
    parts = [random_destinations(place, 50, part) for part in range(3)]
    for destinations in parts:
        assert destinations.shape == (50, 1)
        assert len(np.unique(destinations)) == 50
        assert (destinations >= 0).all()
        assert (destinations < place.network.nodes).all()
    assert len(np.unique(parts)) > 100
    np.testing.assert_array_equal(parts[1], random_destinations(place, 50, 1))
    assert (parts[0] != random_destinations(draw_map(HELSINKI, 2), 50, 0)).any()
    with pytest.raises(ScenarioError, match="cannot be 1284 different destinations among 1284 nodes"):
        random_destinations(place, place.network.nodes, 0)


def test_futures_begin_at_the_hours_of_their_destinations(place) -> None:
    check_paths(place)
    destinations = random_destinations(place, 6, 2)
    params = make_environment(HELSINKI, place, "test", 6, destinations=destinations, part=2)
    assert params.futures.hour.tolist() == HELSINKI.place.departure_hours(18)[12:]
    assert params.futures.destination.tolist() == list(range(6))
    learned = make_environment(HELSINKI, place, "learn", 7, destinations=destinations[:2])
    assert learned.futures.hour.tolist() == (HELSINKI.place.departure_hours(2) * 4)[:7]
    # (300 + 1,200 s) / 300 s = 5 slots
    assert learned.futures.speeds.crowds.counted.shape == (7, 5, 160)
    assert learned.expected.mean.crowds.counted.shape == (2, 5, 160)
    expected = jax.jit(lambda hours: place.flow.expected(hours, 5).counted)(learned.futures.hour[:2])
    np.testing.assert_allclose(learned.expected.mean.crowds.counted, expected, rtol=1e-4)


def test_no_walk_ends_where_it_begins(place) -> None:
    destinations = random_destinations(place, 6, 0)
    params = make_environment(HELSINKI, place, "test", 6, destinations=destinations)
    found = instances(HELSINKI, place, params, 6, destinations=destinations)
    assert found.destination.tolist() == destinations[:, 0].tolist()
    many = instances(HELSINKI, place, params, 5_000, destinations=destinations)
    assert (many.origin != many.destination).all()
    assert (many.origin >= 0).all()
    assert (many.origin < place.network.nodes).all()
    assert ((many.departure >= 0) & (many.departure < 300)).all()
    np.testing.assert_array_equal(many.future, np.arange(5_000) % 6)
    np.testing.assert_array_equal(many.destination, destinations[np.arange(5_000) % 6, 0])


def test_walks_begin_and_end_where_the_venue_says(somewhere) -> None:
    problem, place = somewhere
    assert (place.origins, place.destinations) == ((5, 17, 200), (17, 300))
    destinations = random_destinations(place, 50, 0)
    assert sorted(destinations.ravel().tolist()) == [17, 300]
    params = make_environment(problem, place, "test", 60, destinations=destinations)
    walks = instances(problem, place, params, 60, destinations=destinations)
    pairs = set(zip(walks.origin.tolist(), walks.destination.tolist(), strict=True))
    assert pairs == {(5, 17), (200, 17), (5, 300), (17, 300), (200, 300)}
    assert walks.destination.tolist()[:4] == destinations.ravel().tolist() * 2
    draws = jnp.asarray(np.random.default_rng(0).random((300, 4)), jnp.float32)
    for anywhere in (True, False):
        here = sampler(problem, place, params, 60, destinations=destinations, anywhere=anywhere)
        drawn = jax.jit(jax.vmap(here.sample))(draws)
        assert set(zip(drawn.origin.tolist(), drawn.destination.tolist(), strict=True)) == pairs
    # without being told where, they do not go from corner to corner either
    alone = instances(problem, place, make_environment(problem, place, "test", 60), 20)
    assert set(alone.origin.tolist()) <= {5, 17, 200}
    assert len(set(alone.destination.tolist()) & {17, 300}) == 1


def test_destinations_to_learn_and_to_compare(somewhere) -> None:
    problem, place = somewhere
    assert sorted(destinations_of(place, 2).ravel().tolist()) == [17, 300]
    assert destinations_of(place, 1).tolist() == destinations_of(place, 2)[:1].tolist()
    with pytest.raises(ScenarioError, match="between 1 and 2 destinations, not 3"):
        destinations_of(place, 3)
    config = preset_for(problem, "default")
    assert (config.destinations, config.futures, config.fresh_futures) == (2, 64, 32)
    three = problem.changed(destinations=(1, 2, 3))
    for level in ("local", "map", "live"):
        config = preset_for(three, "default", level)
        # at level live they are not renewed
        futures, fresh = (90, 0) if level == "live" else (60, 30)
        assert (config.destinations, config.futures, config.fresh_futures) == (3, futures, fresh)
    assert preset_for(HELSINKI, "default").destinations == 32


def test_the_only_origin_is_nobodys_destination(somewhere) -> None:
    problem, _ = somewhere
    lone = draw_map(problem.changed(origins=(17,), destinations=()), 0)
    nodes = lone.network.nodes
    everywhere = destinations_of(lone, nodes - 2).ravel().tolist()
    assert len(set(everywhere)) == nodes - 2
    assert 17 not in everywhere
    assert 17 not in random_destinations(lone, nodes - 1, 0)


def test_a_comparison_walks_between_the_venues_places(somewhere) -> None:
    problem, _ = somewhere
    chosen = choose_planners(problem, ["shortest-path"]).factories
    walked = compare(problem, chosen, maps=[0], walks=5).records["shortest-path"]
    assert walked.minutes.shape == (1, 5)
    assert (walked.minutes > 0).all()


def test_live_counts_of_whole_hours_are_those_of_a_file(place) -> None:
    names, now = sensor_names(place), datetime.fromisoformat("2025-05-24T09:45Z")
    assert len(names) == len(set(names)) < len(place.sensors)  # most stand in several places
    hours = np.array(["2025-05-24T11"], "datetime64[h]")
    table = CountTable(hours, (names[3], names[0]), np.array([[900.0, 70.0]]), None, (), "")
    file, known = with_live_counts(place, table, datetime.fromisoformat("2025-05-24T12:45"))
    hour = now.replace(hour=8, minute=0)
    posted = [LiveCount(names[0], hour, 3600.0, 70.0), LiveCount(names[3], hour, 3600.0, 900.0)]
    found = latest(posted, names, now, "Europe/Helsinki")
    live = with_latest_counts(place, found)
    assert (known, found.known) == (2, 2)

    @jax.jit
    def expected(flow):
        return flow.expected(jnp.full(1, 132.75), 12).counted[0]

    same, without = np.asarray(expected(file.flow)), np.asarray(expected(place.flow))
    np.testing.assert_allclose(np.asarray(expected(live.flow)), same, rtol=1e-6)
    counted = np.isin(place.sensors, (names[0], names[3]))
    np.testing.assert_allclose(same[:, ~counted], without[:, ~counted], rtol=1e-6)
    assert (same[:, counted] != without[:, counted]).all()
    assert live.test_flow is live.flow
