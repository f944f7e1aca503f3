"""Which scenarios there are and cannot be; the streams that maps, futures and walks are drawn from."""

import copy
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.types import EnvParams
from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.episodes import instances, sampler, standard_destinations
from sidestep.scenarios.futures import make_environment, replace_futures, sample_futures
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map, fingerprint
from sidestep.scenarios.model import LAWS, RushHours, Scenario, ScenarioError, Venue

HOUR = 3600.0


def small(**changes) -> Scenario:
    """Nine crossings and twelve slots."""
    return scenario("paper-congested", **(dict(side=3, crowded_nodes=2, horizon=HOUR) | changes))


def volumes(scenario_map: ScenarioMap) -> np.ndarray:
    return np.asarray(scenario_map.flow.initial)


def crowded(scenario_map: ScenarioMap) -> np.ndarray:
    """Which segments are: no other has more than 1,000 people."""
    return volumes(scenario_map) > 1001


# --- Names and values -----------------------------------------------------------------------------------------------


def test_the_papers_scenarios() -> None:
    unblocked, congested = BUILT_IN["paper-unblocked"], BUILT_IN["paper-congested"]
    for one in (unblocked, congested):
        assert (one.side, one.lengths, one.volumes) == (6, (100, 1000), (200, 1000))
        assert (one.origin, one.destination) == (0, 35)
        assert (one.law, one.rule, one.slot_seconds) == ("power", "integrated", 300)
        assert one.slots == one.horizon / 300
    assert (unblocked.crowded_nodes, congested.crowded_nodes) == (0, 4)
    assert congested.crowded_volume == (5000, pytest.approx(31.6227766))  # the root of 1000
    assert all(name == one.name for name, one in BUILT_IN.items())


def test_a_part_of_a_slot_is_a_slot() -> None:
    # 1,000 s are three slots of 300 s and a third
    assert small(horizon=1000.0).slots == 4
    assert small(horizon=900.0).slots == 3
    assert small(horizon=10.0).slots == 1


def test_fields_may_be_changed() -> None:
    changed = scenario("paper-unblocked", side=3, law="weidmann")
    assert (changed.side, changed.law, changed.destination) == (3, "weidmann", 8)
    assert BUILT_IN["paper-unblocked"].side == 6


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("paper-congestd", "did you mean paper-congested?"),
        ("unblocked", "did you mean paper-unblocked?"),
        ("zoo", "there are paper-unblocked, paper-congested"),
    ],
)
def test_unknown_names(name: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(name)
    assert f"unknown scenario '{name}'" in str(caught.value)
    assert message in str(caught.value)


def test_unknown_fields() -> None:
    with pytest.raises(ScenarioError, match="no field colour, size"):
        scenario("paper-unblocked", size=3, colour="red")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(side=1), "at least 2 nodes, not 1"),
        (dict(side=0), "at least 2 nodes, not 0"),
        (dict(side=-6), "at least 2 nodes, not -6"),
        (dict(crowded_nodes=-1), "between 0 and 34 on a grid of 6 x 6, not -1"),
        (dict(crowded_nodes=35), "between 0 and 34 on a grid of 6 x 6, not 35"),
        (dict(side=2, crowded_nodes=3), "between 0 and 2 on a grid of 2 x 2, not 3"),
        (dict(horizon=0.0), "horizon must be a positive"),
        (dict(horizon=-1.0), "horizon must be a positive number of seconds, not -1"),
        (dict(horizon=float("nan")), "horizon must be a positive"),
        (dict(horizon=float("inf")), "horizon must be a positive"),
        (dict(slot_seconds=0.0), "slot_seconds must be a positive"),
        (dict(slot_seconds=-300.0), "slot_seconds must be a positive"),
        (dict(departures=(600.0, 300.0)), "departures must be two times in order, not 600.0 and 300.0"),
        (dict(departures=(-1.0, 300.0)), "departures must be two times in order"),
        (dict(maps=0), "numbers of maps and walks"),
        (dict(larger=(8,)), "maps of several sizes need maps of one size to train on"),
    ],
)
def test_scenarios_that_cannot_be(changes: dict, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        scenario("paper-congested", **changes)
    with pytest.raises(ScenarioError, match=message):
        dataclasses.replace(BUILT_IN["paper-congested"], **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(flows="real"), "flows must be one of arima, forecast, not 'real'"),
        (dict(law="aoki"), "law must be one of power, power-capped, weidmann, not 'aoki'"),
        (dict(rule="exit"), "rule must be one of integrated, entry, not 'exit'"),
        (dict(level="hindsight"), "level must be one of position, local, map, live, not 'hindsight'"),
    ],
)
def test_choices_that_are_none(changes: dict, message: str) -> None:
    # Where annotations are checked, as in these tests, the constructor would not let these pass to the check.
    one = copy.copy(BUILT_IN["paper-congested"])
    for name, value in changes.items():
        object.__setattr__(one, name, value)
    with pytest.raises(ScenarioError, match=message):
        one.__post_init__()


def test_the_most_crowded_nodes_that_can_be() -> None:
    assert crowded(draw_map(small(crowded_nodes=7), 0)).all()
    assert scenario("paper-congested", side=2, crowded_nodes=2).crowded_nodes == 2


def renew_crowds(
    scenario: Scenario, scenario_map: ScenarioMap, params: EnvParams, number: int, futures: int, first: int
):
    return replace_futures(params, sample_futures(scenario, scenario_map, params, number, futures), jnp.int32(first))


# --- Maps -----------------------------------------------------------------------------------------------------------


def same(one: ScenarioMap, other: ScenarioMap) -> bool:
    return bool((one.network.length == other.network.length).all() and (one.flow.initial == other.flow.initial).all())


def test_the_same_seed_and_number_give_the_same_map() -> None:
    one = draw_map(small(), 3, 5)
    assert same(one, draw_map(small(), 3, 5))
    assert (jax.random.key_data(one.key) == jax.random.key_data(draw_map(small(), 3, 5).key)).all()
    for other in (draw_map(small(), 3, 6), draw_map(small(), 4, 5), draw_map(small(), 5, 3)):
        assert not (one.network.length == other.network.length).any()
        assert not (jax.random.key_data(one.key) == jax.random.key_data(other.key)).all()


def test_flows_law_rule_and_horizon_leave_the_map_alone() -> None:
    one = draw_map(small(), 3)
    for changes in (dict(flows="forecast"), dict(law="weidmann"), dict(rule="entry"), dict(horizon=9 * HOUR)):
        assert same(one, draw_map(small(**changes), 3))


def test_crowding_leaves_the_streets_and_the_other_volumes_alone() -> None:
    free, full = (draw_map(scenario(name), 7) for name in ("paper-unblocked", "paper-congested"))
    assert (free.network.length == full.network.length).all()
    assert 0 < crowded(full).sum() < 120
    assert (volumes(free)[~crowded(full)] == volumes(full)[~crowded(full)]).all()


def test_volumes_fill_their_range() -> None:
    drawn = volumes(draw_map(scenario("paper-unblocked", side=16), 0))
    assert (drawn >= 200).all()
    assert (drawn <= 1000).all()
    # 960 uniform draws: mean 600 with a standard error of 800 / sqrt(12 * 960) = 7.5
    assert drawn.mean() == pytest.approx(600, abs=30)
    assert drawn.min() < 215
    assert drawn.max() > 985


def test_crowded_volumes_have_the_papers_mean_and_standard_deviation() -> None:
    drawn = volumes(draw_map(scenario("paper-congested", side=16, crowded_nodes=254), 0))
    # 960 normal draws of standard deviation 31.6: standard errors 1.0 and .7
    assert drawn.mean() == pytest.approx(5000, abs=4)
    assert drawn.std() == pytest.approx(31.6, abs=3)


def test_volumes_may_be_chosen() -> None:
    scenario_map = draw_map(small(volumes=(3.0, 4.0), crowded_volume=(70.0, 1e-3)), 0)
    assert set(np.round(volumes(scenario_map)[volumes(scenario_map) > 5])) == {70}
    assert (volumes(scenario_map)[volumes(scenario_map) < 5] >= 3).all()
    assert (volumes(scenario_map)[volumes(scenario_map) < 5] <= 4).all()


@pytest.mark.parametrize("seed", range(12))
def test_one_crowded_node_crowds_its_own_segments_alone(seed: int) -> None:
    scenario_map = draw_map(scenario("paper-congested", crowded_nodes=1), seed)
    tail, head = np.asarray(scenario_map.network.tail), np.asarray(scenario_map.network.head)
    at = crowded(scenario_map)
    (node,) = (node for node in range(36) if at[(tail == node) | (head == node)].all())
    assert node not in {0, 35}
    assert (at == ((tail == node) | (head == node))).all()


def test_origin_and_destination_are_never_crowded_and_all_others_may_be() -> None:
    # On a grid of 2 x 2 only two nodes are neither: one in two seeds each.
    chosen = set()
    for seed in range(20):
        scenario_map = draw_map(scenario("paper-congested", side=2, crowded_nodes=1), seed)
        tail, head = np.asarray(scenario_map.network.tail), np.asarray(scenario_map.network.head)
        at = crowded(scenario_map)
        assert at.sum() == 4
        chosen |= {node for node in range(4) if at[(tail == node) | (head == node)].all()}
    assert chosen == {1, 2}


# --- Futures --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenario_map() -> ScenarioMap:
    return draw_map(small(), 0)


@pytest.fixture(scope="module")
def params_of_test(scenario_map) -> EnvParams:
    return make_environment(small(), scenario_map, "test", 4)


def test_an_environment_has_what_was_asked_for(scenario_map, params_of_test) -> None:
    assert params_of_test.futures.speed.shape == (4, 24, 12)
    assert params_of_test.expected.speed.shape == (1, 24, 12)
    assert params_of_test.futures.slot_seconds == params_of_test.expected.slot_seconds == 300
    assert float(params_of_test.horizon) == HOUR
    assert (params_of_test.network.length == scenario_map.network.length).all()
    assert (params_of_test.rule, params_of_test.reward) == ("integrated", small().reward)
    assert make_environment(small(rule="entry"), scenario_map, "test", 4).rule == "entry"


def test_the_same_purpose_gives_the_same_futures_and_another_others(scenario_map, params_of_test) -> None:
    again = make_environment(small(), draw_map(small(), 0), "test", 4)
    assert (again.futures.speed == params_of_test.futures.speed).all()
    futures = {"test": np.asarray(params_of_test.futures.speed)}
    for purpose in ("learn", "explore"):
        futures[purpose] = np.asarray(make_environment(small(), scenario_map, purpose, 4).futures.speed)
    # Slot 0 is today's crowd. After it no future of one purpose is one of another, and none is there twice.
    everything = np.concatenate(list(futures.values()))
    assert np.ptp(everything[:, :, 0], axis=0).max() == 0
    for slot in (1, 11):
        assert len(np.unique(everything[:, 0, slot])) == 12


def test_what_is_expected_does_not_depend_on_the_purpose(scenario_map, params_of_test) -> None:
    learn = make_environment(small(), scenario_map, "learn", 4)
    assert (learn.expected.speed == params_of_test.expected.speed).all()


def test_futures_vary_about_what_is_expected(scenario_map) -> None:
    slots = 12
    expected = np.asarray(scenario_map.flow.expected(jnp.zeros(1), slots).volume[0])
    drawn = np.asarray(scenario_map.flow.draw(jax.random.key(0), jnp.zeros(400), slots).volume)
    assert expected.shape == (slots, 24)
    assert drawn.shape == (400, slots, 24)
    assert np.ptp(drawn[:, 0], axis=0).max() == 0
    spread = drawn.std(axis=0, dtype=np.float64)
    assert (np.diff(spread.mean(axis=1)) > 0).all()
    # Crowded segments are so full that the floor of one person is never met, so there the mean is the forecast.
    full = crowded(scenario_map)
    error = (drawn.mean(axis=0) - expected)[1:, full] / (spread[1:, full] / 20)  # in standard errors
    assert abs(error).max() < 5


def test_flows_of_the_forecast_have_one_future_which_is_expected(scenario_map) -> None:
    params = make_environment(small(flows="forecast"), scenario_map, "test", 4)
    assert params.futures.speed.shape == (1, 24, 12)
    assert (params.futures.speed[0] == params.expected.speed).all()
    assert (params.futures.covered[0] == params.expected.covered).all()


def test_slot_0_is_the_crowd_of_the_map(scenario_map, params_of_test) -> None:
    for field in (
        scenario_map.flow.expected(jnp.zeros(1), 12),
        scenario_map.flow.draw(jax.random.key(1), jnp.zeros(3), 12),
    ):
        assert (np.moveaxis(np.asarray(field.volume), -2, 0)[0] == volumes(scenario_map)).all()
    # x0 (p/d)^-0.8
    speed = 1.34 * (volumes(scenario_map) / np.asarray(scenario_map.network.length)) ** -0.8
    np.testing.assert_allclose(params_of_test.expected.speed[0, :, 0], speed, rtol=1e-5)
    for future in range(4):
        np.testing.assert_allclose(params_of_test.futures.speed[future, :, 0], speed, rtol=1e-5)


def test_one_slot_is_enough(scenario_map) -> None:
    params = make_environment(small(horizon=10.0), scenario_map, "test", 2)
    assert params.futures.speed.shape == (2, 24, 1)


@pytest.mark.parametrize("law", LAWS)
def test_speeds_are_positive_and_finite_all_day(law: str) -> None:
    day = small(law=law, horizon=24 * HOUR)
    params = make_environment(day, draw_map(day, 1), "test", 16)
    for field in (params.futures, params.expected):
        assert field.slots == 288
        assert np.isfinite(field.speed).all()
        assert (np.asarray(field.speed) > 0).all()
        assert np.isfinite(field.covered).all()
        if law != "power":
            assert float(field.speed.max()) <= 1.34 * (1 + 1e-6)
    # nobody on the street is taken for one: x0 (1/d)^-0.8 is the highest speed of the literal law
    highest = 1.34 * np.asarray(params.network.length) ** 0.8
    assert (np.asarray(params.futures.speed).max(axis=(0, 2)) <= highest * (1 + 1e-5)).all()


# --- Walks ----------------------------------------------------------------------------------------------------------


def test_walks_go_from_corner_to_corner_each_through_its_own_future(scenario_map, params_of_test) -> None:
    todo = instances(small(), scenario_map, params_of_test, 6, first=3)
    assert todo.origin.tolist() == [0] * 6
    assert todo.destination.tolist() == [8] * 6
    assert todo.departure.tolist() == [0] * 6
    assert todo.future.tolist() == [3, 0, 1, 2, 3, 0]  # of four


def test_samplers(scenario_map, params_of_test) -> None:
    here, anywhere = (sampler(small(), scenario_map, params_of_test, 3, anywhere=where) for where in (False, True))
    draws = jnp.asarray(np.random.default_rng(0).random((200, 4)), jnp.float32)
    from_here, from_anywhere = (jax.vmap(one.sample)(draws) for one in (here, anywhere))
    assert set(from_here.origin.tolist()) == {0}
    assert set(from_anywhere.origin.tolist()) == set(range(8))
    for drawn in (from_here, from_anywhere):
        assert set(drawn.destination.tolist()) == {8}
        assert set(drawn.departure.tolist()) == {0}
        assert set(drawn.future.tolist()) == {0, 1, 2}
    # no more than there are
    assert int(sampler(small(), scenario_map, params_of_test, 99).futures) == 4
    # the same compiled program serves both
    assert jax.tree.map(jnp.shape, here) == jax.tree.map(jnp.shape, anywhere)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"volumes": (-5.0, 5.0)}, "volumes must be two positive numbers in order"),
        ({"volumes": (1000.0, 200.0)}, "volumes must be two positive numbers in order"),
        ({"lengths": (100.0, float("inf"))}, "lengths must be two positive numbers in order"),
        ({"crowded_volume": (float("nan"), 1.0)}, "crowded_volume must be a positive mean"),
        ({"crowded_volume": (5000.0, -1.0)}, "crowded_volume must be a positive mean"),
    ],
)
def test_numbers_that_cannot_be(changes: dict, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        scenario("paper-congested", **changes)


@pytest.mark.parametrize(("seed", "index"), [(-1, 0), (0, -1)])
def test_maps_are_counted_from_zero(seed: int, index: int) -> None:
    with pytest.raises(ScenarioError, match="must not be negative"):
        draw_map(scenario("paper-congested"), seed, index)


# --- Rush hours -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "side", "crowded_nodes"), [("rush-16", 16, 28), ("rush-32", 32, 114)])
def test_rush_hours_by_the_numbers(name: str, side: int, crowded_nodes: int) -> None:
    rush = BUILT_IN[name]
    # every ninth node is crowded: 256 / 9 = 28.4 and 1,024 / 9 = 113.8
    assert (rush.side, rush.crowded_nodes, rush.departures, rush.level) == (side, crowded_nodes, (0, 3600), "local")
    assert (rush.law, rush.reward.progress, rush.reward.bonus) == ("power-capped", 0, 0)
    scenario_map = draw_map(rush, 0)
    network, flow = scenario_map.network, scenario_map.flow
    assert (network.nodes, network.segments) == (side**2, 4 * side * (side - 1))
    assert scenario_map.parts == (side**2,)
    assert flow.period == 4 * HOUR
    assert ((np.asarray(flow.amplitude) >= 0.2) & (np.asarray(flow.amplitude) <= 0.8)).all()
    assert np.ptp(flow.amplitude) > 0.5
    assert ((np.asarray(flow.phase) >= 0) & (np.asarray(flow.phase) <= 6.2832)).all()
    assert np.ptp(flow.phase) > 6
    # Crowded are nodes whose segments all are: their volumes lie 4 standard deviations of 1,000 about 5,000.
    tail, head = np.asarray(network.tail), np.asarray(network.head)
    full = np.asarray(flow.base) > 1000
    nodes = [node for node in range(side**2) if full[(tail == node) | (head == node)].all()]
    assert (full == (np.isin(tail, nodes) | np.isin(head, nodes))).all()
    # Nodes between crowded ones look crowded too, so there may be a few more.
    assert crowded_nodes <= len(nodes) < 1.2 * crowded_nodes
    assert not {0, side**2 - 1} & set(nodes)
    assert flow.base[full].mean() == pytest.approx(5000, abs=300)
    assert flow.base[~full].min() >= 200


def test_both_directions_of_a_street_have_one_wave_and_streets_have_their_own() -> None:
    scenario_map = draw_map(BUILT_IN["rush-16"], 3)
    waves = zip(scenario_map.flow.amplitude.tolist(), scenario_map.flow.phase.tolist(), strict=True)
    wave = dict(
        zip(
            zip(scenario_map.network.tail.tolist(), scenario_map.network.head.tolist(), strict=True), waves, strict=True
        )
    )
    assert all(wave[head, tail] == wave[tail, head] for tail, head in wave)
    assert len(set(wave.values())) == len(wave) / 2


def test_walks_depart_within_the_hour() -> None:
    rush = scenario("rush-16", side=3, crowded_nodes=1, horizon=HOUR)
    scenario_map = draw_map(rush, 0)
    params = make_environment(rush, scenario_map, "test", 2)
    # the golden ratio: 0, .618034, 1.236068 - 1, 1.854102 - 1 of an hour
    todo = instances(rush, scenario_map, params, 4)
    np.testing.assert_allclose(todo.departure, [0, 2224.92, 849.84, 3074.77], atol=0.01)
    np.testing.assert_allclose(instances(rush, scenario_map, params, 2, first=2).departure, todo.departure[2:])
    drawn = jax.vmap(sampler(rush, scenario_map, params, 2).sample)(jnp.linspace(0, 0.999, 50)[:, None] * jnp.ones(4))
    assert (float(drawn.departure[0]), float(drawn.departure[-1])) == (0, pytest.approx(3596.4))


def test_shifting_crowds_are_elsewhere_in_every_future() -> None:
    shifting, fixed = BUILT_IN["shifting-crowds"], BUILT_IN["rush-16"]
    assert (shifting.side, shifting.crowded_nodes, shifting.departures) == (16, 28, (0, 3600))
    scenario_map = draw_map(shifting, 0)
    assert (scenario_map.network.length == draw_map(fixed, 0).network.length).all()
    # Nobody's streets are crowded in ordinary: nobody can know where they will be.
    assert float(scenario_map.flow.ordinary.base.max()) <= 1000
    drawn = np.asarray(scenario_map.flow.draw(jax.random.key(0), jnp.zeros(4), 1).volume)[:, 0]
    wave = np.asarray(scenario_map.flow.ordinary.median(jnp.array([0]))[0] / scenario_map.flow.ordinary.base)
    # exp(.4 * 2) = 2.2 times 1,000 is little for a crowded street
    full = drawn / wave > 2300
    tail, head = np.asarray(scenario_map.network.tail), np.asarray(scenario_map.network.head)
    assert not full[:, np.isin(tail, [0, 255]) & np.isin(head, [0, 255])].any()
    for one, other in ((0, 1), (1, 2), (2, 3)):
        assert 80 < full[one].sum() < 28 * 8
        assert (full[one] & full[other]).sum() < 0.5 * full[one].sum()


# --- Maps that were never walked ------------------------------------------------------------------------------------


def lengths(scenario_map: ScenarioMap) -> set[float]:
    return set(scenario_map.network.length.tolist())


def test_unseen_maps_have_three_sizes_in_turn() -> None:
    unseen = BUILT_IN["unseen-maps"]
    assert (unseen.sides, unseen.maps, unseen.training_maps, unseen.level) == ((10, 14, 18), 12, 32, "map")
    maps = [draw_map(unseen, 0, index) for index in range(4)]
    assert [scenario_map.network.nodes for scenario_map in maps] == [100, 196, 324, 100]
    assert [scenario_map.parts for scenario_map in maps] == [(100,), (196,), (324,), (100,)]
    # 11 of 100 nodes are crowded, and as large a share of the others: 21.6 and 35.6
    for scenario_map, crowded_nodes in zip(maps, (11, 22, 36, 11), strict=True):
        tail, head = np.asarray(scenario_map.network.tail), np.asarray(scenario_map.network.head)
        full = np.asarray(scenario_map.flow.base) > 1000
        nodes = [node for node in range(scenario_map.network.nodes) if full[(tail == node) | (head == node)].all()]
        assert crowded_nodes <= len(nodes) <= 1.2 * crowded_nodes


def test_training_maps_are_others_side_by_side() -> None:
    unseen = BUILT_IN["unseen-maps"]
    learned = draw_training_map(unseen, 0)
    assert learned.parts == (100,) * 32
    assert (learned.network.nodes, learned.network.segments) == (3200, 32 * 360)
    # no street leads from one to another
    assert (learned.network.tail // 100 == learned.network.head // 100).all()
    # all different
    assert len(lengths(learned)) == pytest.approx(32 * 180, rel=0.01)
    for index in range(unseen.maps):
        # Two uniform draws of some 5,000 values between 100 and 1,000 m may meet in single precision; maps do not.
        walked = lengths(draw_map(unseen, 0, index))
        assert len(walked & lengths(learned)) < 0.05 * len(walked)
    # all maps of a seed are learned for together; their training has streams of its own
    other = draw_training_map(unseen, 0, 3)
    assert fingerprint(other) == fingerprint(learned)
    assert fingerprint(draw_training_map(unseen, 1)) != fingerprint(learned)


def test_a_scenario_without_training_maps_learns_the_map_itself() -> None:
    assert fingerprint(draw_training_map(small(), 3, 5)) == fingerprint(draw_map(small(), 3, 5))


def test_what_moves_the_crowds() -> None:
    tabled = dataclasses.replace(scenario("helsinki"), venue=Venue(counts="crowds.npz"))
    found = [(scenario(name), moved) for name, moved in (("paper-congested", "arima"), ("rush-16", "rush"))]
    for problem, moved in (*found, (scenario("helsinki"), "sensors"), (tabled, "table")):
        assert problem.crowd_model == moved
        assert dataclasses.replace(problem, flows="forecast").crowd_model == "forecast"


def test_the_fingerprint_tells_maps_apart(scenario_map) -> None:
    assert fingerprint(draw_map(small(), 0)) == fingerprint(scenario_map)
    assert fingerprint(draw_map(small(horizon=2 * HOUR, law="weidmann"), 0)) == fingerprint(scenario_map)
    others = [
        draw_map(small(), 1),
        draw_map(small(), 0, 1),
        draw_map(small(crowded_nodes=1), 0),  # the same streets with other crowds
        draw_map(small(side=4), 0),
        draw_map(scenario("rush-16", side=3, crowded_nodes=2), 0),
    ]
    assert len({fingerprint(other) for other in (scenario_map, *others)}) == 6


def tiny_unseen(**changes) -> Scenario:
    """Two maps of nine crossings to learn on; others of nine and sixteen to walk."""
    return scenario("unseen-maps", **(dict(side=3, larger=(4,), crowded_nodes=1, training_maps=2) | changes))


def test_walks_take_the_parts_in_turn() -> None:
    unseen = tiny_unseen(horizon=HOUR)
    learned = draw_training_map(unseen, 0)
    params = make_environment(unseen, learned, "learn", 3)
    todo = instances(unseen, learned, params, 5, first=1)
    assert todo.origin.tolist() == [9, 0, 9, 0, 9]
    assert todo.destination.tolist() == [17, 8, 17, 8, 17]
    assert todo.future.tolist() == [1, 2, 0, 1, 2]
    draws = jnp.asarray(np.random.default_rng(0).random((300, 4)), jnp.float32)
    here, anywhere = (
        jax.vmap(sampler(unseen, learned, params, 3, anywhere=where).sample)(draws) for where in (False, True)
    )
    assert set(zip(here.origin.tolist(), here.destination.tolist(), strict=True)) == {(0, 8), (9, 17)}
    assert set(anywhere.origin.tolist()) == set(range(18)) - {8, 17}
    # nobody is sent to the other part
    assert (anywhere.origin // 9 == anywhere.destination // 9).all()


def test_destinations_are_a_node_of_each_part() -> None:
    assert standard_destinations((9,), 1).tolist() == [[8]]
    assert standard_destinations((9, 16), 1).tolist() == [[8, 24]]
    ends = standard_destinations((9, 16), 5)
    assert ends.shape == (5, 2)
    assert ends[0].tolist() == [8, 24]  # the scenario's own come first
    assert len(set(ends.ravel().tolist())) == 10
    assert set(ends[:, 0].tolist()) <= set(range(1, 9))  # never the first node, where walks begin
    assert set(ends[:, 1].tolist()) <= set(range(10, 25))
    # all that there are, and fewer are the first of them
    assert sorted(standard_destinations((9,), 8).ravel().tolist()) == list(range(1, 9))
    assert standard_destinations((9,), 3).tolist() == standard_destinations((9,), 8)[:3].tolist()


@pytest.mark.parametrize("destinations", [0, -1, 9])
def test_there_are_not_that_many_destinations(destinations: int) -> None:
    with pytest.raises(ScenarioError, match=f"between 1 and 8 destinations, not {destinations}"):
        standard_destinations((9, 16), destinations)


def test_samplers_for_several_destinations(scenario_map, params_of_test) -> None:
    ends = standard_destinations(scenario_map.parts, 3)
    draws = jnp.asarray(np.random.default_rng(0).random((500, 4)), jnp.float32)
    samplers = [
        sampler(small(), scenario_map, params_of_test, 4, destinations=ends, anywhere=where) for where in (False, True)
    ]
    assert jax.tree.map(jnp.shape, samplers[0]) == jax.tree.map(jnp.shape, samplers[1])
    here, anywhere = (jax.vmap(one.sample)(draws) for one in samplers)
    for drawn in (here, anywhere):
        assert set(drawn.destination.tolist()) == set(ends.ravel().tolist())
        assert (drawn.origin != drawn.destination).all()
        # crowd c is for destination c modulo 3
        assert (ends[np.asarray(drawn.future) % 3, 0] == drawn.destination).all()
        assert set(drawn.future.tolist()) == {0, 1, 2, 3}
    assert set(here.origin.tolist()) == {0}
    assert set(anywhere.origin.tolist()) == set(range(9))


# --- Futures of training and of tests -------------------------------------------------------------------------------


def futures(params: EnvParams) -> set[float]:
    """One number of each future that tells it from all others."""
    return set(np.asarray(params.futures.speed)[:, 0, -1].tolist())


def test_no_future_of_a_test_is_one_of_training(scenario_map) -> None:
    tests = [make_environment(small(), scenario_map, "test", 4, part=part) for part in range(3)]
    params = make_environment(small(), scenario_map, "learn", 4)
    learns = [params]
    for number in (1, 2):
        params = renew_crowds(small(), scenario_map, params, number, 2, 2 * (number - 1))
        learns.append(params)
    tested, learned = (set().union(*map(futures, many)) for many in (tests, learns))
    assert len(tested) == 12  # parts have futures of their own
    assert len(learned) == 8  # and renewals bring new ones
    assert not tested & learned
    assert futures(tests[0]) == futures(make_environment(small(), scenario_map, "test", 4))


@pytest.mark.parametrize("first", [0, 2, 4])
def test_renewing_replaces_these_crowds_and_no_others(first: int) -> None:
    rush = tiny_unseen(horizon=1500.0)
    scenario_map = draw_map(rush, 0)
    before = make_environment(rush, scenario_map, "learn", 6, level="live")
    after = renew_crowds(rush, scenario_map, before, 1, 2, first)
    fresh = np.isin(np.arange(6), [first, first + 1])
    for old, new in zip(
        *map(jax.tree.leaves, ((before.futures, before.live), (after.futures, after.live))), strict=True
    ):
        same = (np.asarray(old) == np.asarray(new)).reshape(6, -1)
        assert same[~fresh].all()
        assert not same[fresh].all(axis=1).any()
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), before.expected, after.expected))
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), before.usual, after.usual))
    # another renewal, other crowds; the same again, the same
    assert futures(renew_crowds(rush, scenario_map, before, 2, 2, first)) != futures(after)
    assert futures(renew_crowds(rush, scenario_map, before, 1, 2, first)) == futures(after)


def test_more_destinations_than_futures_are_refused() -> None:
    scenario_map = draw_map(small(), 0)
    params = make_environment(small(flows="forecast"), scenario_map, "test", 5)
    destinations = standard_destinations(scenario_map.parts, 3)
    with pytest.raises(ScenarioError, match="3 destinations need as many futures, but there are 1"):
        sampler(small(), scenario_map, params, 5, destinations=destinations)
    with pytest.raises(ScenarioError, match="3 destinations need as many futures, but there are 1"):
        instances(small(), scenario_map, params, 5, destinations=destinations)


def test_walks_from_anywhere_go_to_each_destination_in_turn() -> None:
    scenario_map = draw_map(small(), 0)
    destinations = standard_destinations(scenario_map.parts, 3)
    params = make_environment(small(), scenario_map, "test", 90, level="map", destinations=destinations)
    walks = instances(small(), scenario_map, params, 90, destinations=destinations)
    assert np.asarray(walks.destination).tolist() == destinations[:, 0].tolist() * 30
    assert (np.asarray(walks.origin) != np.asarray(walks.destination)).all()
    assert set(np.asarray(walks.origin).tolist()) == set(range(9))
    assert np.asarray(walks.future).tolist() == list(range(90))
    others = instances(small(), scenario_map, params, 90, first=90, destinations=destinations)
    assert (np.asarray(others.origin) != np.asarray(walks.origin)).any()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(amplitude=(0.8, 0.2)), "amplitudes in order and a positive period"),
        (dict(period=0.0), "amplitudes in order and a positive period"),
        (dict(memory=1.0), "a memory from 0 to below 1 and a deviation, not 1.0"),
        (dict(deviation=-0.1), "a memory from 0 to below 1 and a deviation"),
    ],
)
def test_rush_hours_that_cannot_be(changes: dict, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        RushHours(**changes)


def test_futures_last_to_the_horizon_of_the_latest_departure() -> None:
    # half an hour and an hour are 18 slots
    assert small(departures=(0.0, 1800.0)).slots == 18
