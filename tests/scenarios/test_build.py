"""Venues: what cannot be, where sensors stand, which hours and weeks walks meet, and their models on disk."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent import checkpoint
from sidestep.agent.checkpoint import TrainingRun
from sidestep.agent.config import TrainConfigError
from sidestep.agent.presets import preset_for
from sidestep.agent.segment_network import SegmentQNetwork
from sidestep.agent.train import greedy, learned_place, prepare
from sidestep.crowds.profile import hour_of_week
from sidestep.crowds.sensor_model import fit_sensors, recorded_weeks
from sidestep.environment.types import Local, Observation, Usual
from sidestep.network.formats import load_helsinki
from sidestep.network.snap import Snapper
from sidestep.planners.base import walk_plan
from sidestep.planners.learned import ModelError, load_planners, trainable
from sidestep.planners.reactive import GreedyMap
from sidestep.planners.time_dependent import Clairvoyant, Expected
from sidestep.scenarios import build as towns
from sidestep.scenarios.build import APART, counts_of, stations, town_of
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.episodes import anywhere_to_anywhere, instances, set_out
from sidestep.scenarios.futures import make_environment, replace_futures, sample_futures
from sidestep.scenarios.maps import draw_map
from sidestep.scenarios.model import Light, Scenario, ScenarioError, Sensor, Traffic, Venue
from sidestep.walking.objective import Objective
from sidestep.walking.speed_field import SensedSpeeds
from sidestep.walking.speed_laws import FREE_SPEED
from sidestep.walking.waits import GOLDEN

HELSINKI = scenario("helsinki", horizon=1200.0, departures=(0.0, 300.0))
VENUE = HELSINKI.venue


@pytest.fixture(scope="module")
def place():
    return draw_map(HELSINKI, 1)


# --- What cannot be -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(crowding=0.0), "crowding must be a positive number, not 0"),
        (dict(crowding=float("nan")), "crowding must be a positive"),
        (dict(reach=-1.0), "reach must be a positive number, not -1"),
        (dict(reach=float("inf")), "reach must be a positive"),
        (dict(days=()), "days must be some of 0"),
        (dict(days=(1, 7)), "not 1, 7"),
        (dict(hours=(20, 10)), "hours must be two of 0 to 24 in order, not 20 and 10"),
        (dict(hours=(10, 10)), "hours must be two"),
        (dict(hours=(10, 25)), "hours must be two"),
        (dict(hours=(-1, 5)), "hours must be two"),
        (dict(pairing=-1), "pairing must be a seed"),
        (
            dict(fitted=("2024", "2025-03-10T01")),
            "tested must not overlap fitted, but 2025-03-10 to 2025-06-01 and 2024 ",
        ),
        (dict(tested=("2024-12-31T23", "2025-06-01")), "tested must not overlap fitted"),
        (dict(tested=("soon", "later")), "must be days such as 2025-03-10"),
        (dict(sensors=(Sensor("a"), Sensor("b"), Sensor("b"))), "stands in the list twice: 'b'"),
    ],
)
def test_venues_that_cannot_be(changes: dict, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        Venue(**changes)


def test_streets_may_be_empty_so_speeds_need_a_cap() -> None:
    # Without people the paper's literal law has no speed, and nobody would ever arrive.
    with pytest.raises(ScenarioError, match="the law power has no speed where nobody walks"):
        Scenario("here", "a venue with the paper's law", venue=Venue())
    assert scenario("helsinki", law="power-capped").law == "power-capped"


def test_hours_are_those_of_the_days() -> None:
    # Tuesday and Sunday from 9 to 11: hours 33, 34, 153 and 154. Multiples of 1.732051 less their whole part are
    # 0, .732, .464, .196, .928, .660: of four hours number 0, 2, 1, 0, 3, 2.
    venue = Venue(days=(6, 1), hours=(9, 11))
    assert venue.starts(6) == [33, 153, 34, 33, 154, 153]
    assert venue.starts(3, first=2) == [34, 33, 154]


def test_hours_are_spread_evenly() -> None:
    # Seventy hours from 10 to 20 of every day
    starts = np.array(VENUE.starts(700))
    numbers = np.unique(starts, return_counts=True)
    assert numbers[0].tolist() == [24 * day + hour for day in range(7) for hour in range(10, 20)]
    assert set(numbers[1].tolist()) <= {8, 9, 10, 11, 12}


def test_minutes_have_nothing_to_do_with_hours() -> None:
    # 840 walks: in every sixth of an hour of every weekday about 20, and of every hour of the day 14.
    walks = 840
    starts = np.array(VENUE.starts(walks)).astype(int)
    sixth = (6 * (np.arange(walks) * GOLDEN % 1)).astype(int)  # of the departures
    for hour, each in ((starts // 24, 20), (starts % 24 - 10, 14)):
        counts = np.zeros((walks // 6 // each, 6))
        np.add.at(counts, (hour, sixth), 1)
        assert (abs(counts - each) <= 3).all()


# --- Where sensors stand --------------------------------------------------------------------------------------------


def test_sensors_without_a_place_are_drawn(place) -> None:
    town = town_of("helsinki")
    first = stations(town, place.network, VENUE.sensors, 0)
    np.testing.assert_array_equal(first, stations(town, place.network, VENUE.sensors, 0))
    other = stations(town, place.network, VENUE.sensors, 1)
    assert len(set(first.tolist()) & set(other.tolist())) < len(first) / 2
    position = np.asarray(place.network.position)
    for found in (first, other):
        assert len(set(found.tolist())) == len(VENUE.sensors)
        assert not {town.kind[street] for street in found} & {"steps"}
        middle = (position[town.tail[found]] + position[town.head[found]]) / 2
        apart = np.hypot(*(middle[:, None] - middle).transpose(2, 0, 1))
        assert apart[~np.eye(len(found), dtype=bool)].min() >= APART


def test_more_sensors_than_room_stand_closer(place) -> None:
    town = town_of("helsinki")
    many = tuple(Sensor(str(number)) for number in range(400))
    assert len(set(stations(town, place.network, many, 0).tolist())) == 400
    too_many = tuple(Sensor(str(number)) for number in range(town.streets + 1))
    with pytest.raises(ScenarioError, match=f"there are {town.streets + 1} sensors, but {town.streets} streets"):
        stations(town, place.network, too_many, 0)
    with pytest.raises(ScenarioError, match=f"there are 400 sensors in 2000 places, but {town.streets} streets"):
        stations(town, place.network, many * 5, 0)


def test_sensors_with_a_place_stand_there(place) -> None:
    town = town_of("helsinki")
    longitude, latitude = town.course(321).mean(axis=0).tolist()
    here = (latitude + 1e-5, longitude)
    found = stations(town, place.network, (Sensor("a"), Sensor("b", here), Sensor("c")), 5)
    assert found[1] == Snapper(town).nearest(*here).street
    assert len(set(found.tolist())) == 3
    with pytest.raises(ScenarioError, match=r"sensor 'far': .* m from the nearest street"):
        stations(town, place.network, (Sensor("far", (60.5, 25.0)),), 5)


# --- Crowds and weeks -----------------------------------------------------------------------------------------------


def test_the_town_has_its_streets_and_crowds(place) -> None:
    town = town_of("helsinki")
    assert (place.network.nodes, place.parts) == (town.nodes, (town.nodes,))
    assert place.flow.model.expected.shape == (168, 160)  # 16 sensors, in ten places each
    weight = np.asarray(place.flow.weights.weight)
    assert weight.shape == (place.network.segments, 4)
    assert weight.sum(axis=1).max() <= 1 + 1e-6
    # Of each person an hour 1 / (3,600 s * 1.34 m/s * width) are on a square metre, 120 times.
    segment = stations(town, place.network, VENUE.sensors * 10, VENUE.pairing)
    width = np.asarray(place.network.width)[segment]
    np.testing.assert_allclose(place.flow.per_count, 120 / (3600 * FREE_SPEED * width), rtol=1e-6)


def test_walks_are_tested_in_weeks_that_were_not_fitted(place) -> None:
    fitted, tested = (counts_of("auckland").between(*period) for period in (VENUE.fitted, VENUE.tested))
    assert {str(time)[:4] for time in fitted.times} == {"2024"}
    assert {str(time)[:4] for time in tested.times} == {"2025"}
    assert place.flow_for("learn").record is place.flow_for("explore").record is None
    record = np.asarray(place.flow_for("test").record)
    names = [sensor.name for sensor in VENUE.sensors]
    # In its first place each sensor has its own weeks; in the tenth those nine tenths of eleven weeks, nine, later.
    alone = recorded_weeks(fit_sensors(fitted, names), tested, names)
    assert alone.shape == (11, 168, 16)
    np.testing.assert_array_equal(record[..., :16], alone)
    np.testing.assert_array_equal(record[0, :, 144:], alone[9])
    # The second week's Wednesday noon: Monday, 10 March 2025 and 9 days.
    noon = np.datetime64("2025-03-19T12", "h")
    (row,) = np.flatnonzero(tested.times == noon)
    assert hour_of_week(tested.times)[row] == 60
    counts = np.expm1(record[1, 60] + np.asarray(place.flow.model.expected)[60])[:16]
    np.testing.assert_allclose(counts, [tested.series(name)[row] for name in names], rtol=1e-3)


def test_every_walk_goes_elsewhere(place) -> None:
    parts = [anywhere_to_anywhere(place, 50, part) for part in range(3)]
    for destinations in parts:
        assert destinations.shape == (50, 1)
        assert len(np.unique(destinations)) == 50
        assert (destinations >= 0).all()
        assert (destinations < place.network.nodes).all()
    assert len(np.unique(parts)) > 100
    np.testing.assert_array_equal(parts[1], anywhere_to_anywhere(place, 50, 1))
    assert (parts[0] != anywhere_to_anywhere(draw_map(HELSINKI, 2), 50, 0)).any()
    with pytest.raises(ScenarioError, match="cannot be 946 different destinations among 946 nodes"):
        anywhere_to_anywhere(place, place.network.nodes, 0)


def test_the_place_begins_at_the_hours_of_its_goals(place) -> None:
    here = set_out(HELSINKI, place, anywhere_to_anywhere(place, 6, 2), first=12)
    assert here.hours.tolist() == VENUE.starts(18)[12:]
    assert here.recorded.record is place.recorded.record
    assert place.hours.tolist() == VENUE.starts(1)


# --- Learning -------------------------------------------------------------------------------------------------------

CONFIG = dataclasses.replace(
    preset_for(HELSINKI, "default"), rounds=1, round_steps=8, walkers=4, batch=4, capacity=8, hidden=(4,), n_step=2,
    destinations=2, futures=4, fresh_futures=2, test_walks=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def learned(place):
    here = learned_place(CONFIG, HELSINKI, place)
    return here, *prepare(CONFIG, HELSINKI, here)


def test_an_environment_expects_each_goal_at_its_hour(learned) -> None:
    here, problem, _ = learned
    params = problem.params
    assert isinstance(params.futures, SensedSpeeds)
    assert isinstance(params.expected, SensedSpeeds)
    # (300 + 1,200 s) / 300 s = 5 slots
    assert params.futures.density.shape == (7, 5, 160)
    assert params.expected.density.shape == (2, 5, 160)
    assert here.hours.tolist() == VENUE.starts(2)
    np.testing.assert_allclose(
        params.expected.density, jax.jit(lambda m: m.flow.expected(m.hours, 5).sensed)(here), rtol=1e-4
    )


def test_no_walk_ends_where_it_begins(place, learned) -> None:
    _, problem, _ = learned
    destinations = anywhere_to_anywhere(place, 7, 0)
    found = instances(HELSINKI, place, problem.params, 7, destinations=destinations)
    assert found.destination.tolist() == destinations[:, 0].tolist()
    many = instances(HELSINKI, place, problem.params, 5_000, destinations=destinations)
    assert (many.origin != many.destination).all()
    assert (many.origin >= 0).all()
    assert (many.origin < place.network.nodes).all()
    assert ((many.departure >= 0) & (many.departure < 300)).all()
    # Crowd number c is for goal number c.
    np.testing.assert_array_equal(many.future, np.arange(5_000) % 7)
    np.testing.assert_array_equal(many.destination, destinations[np.arange(5_000) % 7, 0])


def test_fresh_crowds_are_others_at_the_same_sensors(learned) -> None:
    here, problem, _ = learned
    params = problem.params
    after = replace_futures(params, sample_futures(HELSINKI, here, params, 1, 2), jnp.int32(2))
    assert (after.futures.density[2:4] != params.futures.density[2:4]).all(axis=(1, 2)).all()
    kept = jnp.array([0, 1, 4, 5, 6])
    np.testing.assert_array_equal(after.futures.density[kept], params.futures.density[kept])
    for one, other in zip(jax.tree.leaves(after.futures.weights), jax.tree.leaves(here.flow.weights), strict=True):
        np.testing.assert_array_equal(one, other)


def test_fresh_crowds_begin_at_the_hours_of_those_they_replace(place) -> None:
    # Of two goals, three fresh crowds would begin at the hours of goals 0, 1, 0 in the places of 1, 0, 1.
    three = dataclasses.replace(CONFIG, futures=6, fresh_futures=3)
    with pytest.raises(TrainConfigError, match="goals must divide the 3 fresh crowds, and 2 will not do"):
        learned_place(three, HELSINKI, place)
    learned_place(dataclasses.replace(three, fresh_futures=0), HELSINKI, place)


def test_a_model_can_be_read_without_its_place(learned, tmp_path, monkeypatch) -> None:
    _, problem, state = learned
    placed = dataclasses.replace(VENUE, sensors=(Sensor("somewhere", (60.17, 24.94)), *VENUE.sensors))
    told = dataclasses.replace(HELSINKI, venue=placed)
    checkpoint.save(TrainingRun(told, 1, 0, CONFIG, ((7.0, 8.0),), "a place", state), tmp_path)

    def never(*_):
        raise AssertionError

    monkeypatch.setattr(checkpoint, "draw_training_map", never)
    monkeypatch.setattr(towns, "town_of", never)
    model = checkpoint.load_model(tmp_path)
    assert (model.scenario, model.config, model.fingerprint) == (told, CONFIG, "a place")
    assert model.scenario.venue.sensors[0].place == (60.17, 24.94)
    for read, kept in zip(jax.tree.leaves(model.network), jax.tree.leaves(state.network), strict=True):
        np.testing.assert_array_equal(read, kept)
    # It has the numbers of its own town's streets, not those that it was read with.
    assert float(model.network.metres) == pytest.approx(float(problem.params.network.length.mean()))


def test_models_of_grids_do_not_walk_towns_nor_the_reverse(learned, tmp_path) -> None:
    _, _, state = learned
    checkpoint.save(TrainingRun(HELSINKI, 1, 0, CONFIG, ((7.0, 8.0),), "a place", state), tmp_path)
    assert load_planners([tmp_path], scenario("helsinki"), 0).index is None
    with pytest.raises(ModelError, match=r"learned to walk in a town whose crowds .* sensors; unseen-maps is another"):
        load_planners([tmp_path], scenario("unseen-maps"), 0)


def test_models_walk_for_the_objective_that_they_learned_for(learned, tmp_path) -> None:
    _, _, state = learned
    exposed = dataclasses.replace(HELSINKI, objective=Objective(exposure=0.5, max_density=4.0))
    checkpoint.save(TrainingRun(exposed, 1, 0, CONFIG, ((7.0, 8.0),), "a place", state), tmp_path)
    assert checkpoint.load_model(tmp_path).scenario == exposed
    assert load_planners([tmp_path], exposed, 0).index is None
    with pytest.raises(ModelError, match="learned for another objective"):
        load_planners([tmp_path], HELSINKI, 0)


def test_no_agent_walks_a_town_by_its_position() -> None:
    for name in ("default", "paper", "tabular-q"):
        with pytest.raises(TrainConfigError, match="cannot learn to walk anywhere in helsinki"):
            preset_for(HELSINKI, name, "position")
    assert set(trainable(HELSINKI, 0, "map", "default")) == {"darp", "dqn"}


def test_more_places_than_recorded_weeks() -> None:
    many = dataclasses.replace(HELSINKI, venue=dataclasses.replace(VENUE, places=12))
    with pytest.raises(ScenarioError, match=r"cannot stand in 12 places .* there are 11 weeks"):
        draw_map(many, 0)
    with pytest.raises(ScenarioError, match="places must be a number of streets, 1 or more, not 0"):
        dataclasses.replace(VENUE, places=0)


# --- Deciding -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "again", "chosen"),
    [
        ([-9.0, -5.0, -9.0], False, 1),  # what was learned counts: 4 minutes
        ([-9.0, -8.96, -9.0], False, 0),  # not for .04 minutes, 2.4 s
        ([-9.0, -8.94, -9.0], False, 1),  # but for 3.6 s
        ([-9.0, -5.0, -9.0], True, 0),  # and not where the walker has been before
        ([-9.0, -9.0, -1.0], False, 0),  # exits that do not exist are never taken
    ],
)
def test_corrections_are_followed_where_they_save_seconds(
    learned, monkeypatch, values: list[float], again: bool, chosen: int
) -> None:
    _, _, state = learned
    monkeypatch.setattr(SegmentQNetwork, "__call__", lambda *_: jnp.array(values))
    three = jnp.zeros(3)
    first, where = jnp.float32(0), jnp.zeros(2)
    local = Local(first, where, jnp.arange(3), jnp.zeros((3, 2)), *[three] * 3, jnp.array(again), jnp.arange(3))
    usual = Usual(three, three, log_density_ratio=three, cost_to_go_scaled=three)
    # in seconds: the first exit is the level's own choice
    estimate = jnp.array([500.0, 600.0, 100.0])
    valid = jnp.array([True, True, False])
    seen = Observation(jnp.int32(0), jnp.zeros(2), valid, jnp.int32(0), local, usual, None, estimate)
    assert int(greedy(state.network)(seen, jax.random.key(0))) == chosen


# --- Lights and crossings -------------------------------------------------------------------------------------------


def test_lights_and_crossings_are_those_of_the_streets_both_ways(place) -> None:
    assert place.waits is None
    town = load_helsinki()
    lit = dataclasses.replace(HELSINKI, venue=dataclasses.replace(VENUE, traffic=Traffic(vehicles=720.0)))
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
    known = Light("known", tuple(middle.tolist()), 60.0, 20.0, 5.0)
    lit_too = dataclasses.replace(lit, venue=dataclasses.replace(VENUE, traffic=Traffic(lights=(known,))))
    timed = draw_map(lit_too, 1).waits
    both = np.flatnonzero(street == dark)
    found = [np.asarray(each)[both].tolist() for each in (timed.lights, timed.cycle, timed.green, timed.offset)]
    assert found == [[one] * len(both) for one in (1, 60, 20, 5)]
    others = street != dark
    np.testing.assert_array_equal(np.asarray(timed.offset)[others], np.asarray(waits.offset)[others])
    # Goals have hours of their own.
    destinations = np.array([[3], [4]])
    here = set_out(lit, draw_map(lit, 1), destinations)
    np.testing.assert_array_equal(here.waits.start, here.hours)


def test_nobody_beats_who_knows_the_phases_of_all_lights() -> None:
    lit = dataclasses.replace(HELSINKI, venue=dataclasses.replace(VENUE, traffic=Traffic()))
    destinations = np.array([[3], [400]])
    here = set_out(lit, draw_map(lit, 1), destinations)
    params = make_environment(lit, here, "test", 2, level="map", destinations=destinations)
    todo = instances(lit, here, params, 2, destinations=destinations)
    minutes = {}
    for planner in (Expected(), GreedyMap(), Clairvoyant()):
        walked = walk_plan(planner, params, planner.plan(params, todo), todo, jax.random.key(0))
        minutes[planner.name] = np.asarray(walked.seconds) / 60
    for name in ("expected", "greedy-map"):
        assert (minutes[name] >= minutes["clairvoyant"] - 1e-3).all()
