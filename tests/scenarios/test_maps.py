"""Maps of scenarios: drawn from a seed, crowded as the scenario says, and told apart by their fingerprints."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.scenarios.builtin import BUILT_IN, scenario
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map
from sidestep.scenarios.model import Scenario
from sidestep.scenarios.spec import ScenarioError

HOUR = 3600.0


def small(**changes) -> Scenario:
    """Nine crossings and twelve slots."""
    return scenario("paper-congested", **(dict(side=3, crowded_nodes=2, horizon=HOUR) | changes))


def volumes(scenario_map: ScenarioMap) -> np.ndarray:
    return np.asarray(scenario_map.flow.initial)


def crowded(scenario_map: ScenarioMap) -> np.ndarray:
    """Which segments are: no other has more than 1,000 people."""
    return volumes(scenario_map) > 1001


@pytest.fixture(scope="module")
def scenario_map() -> ScenarioMap:
    return draw_map(small(), 0)


def test_the_most_crowded_nodes_that_can_be() -> None:
    assert crowded(draw_map(small(crowded_nodes=7), 0)).all()
    assert scenario("paper-congested", side=2, crowded_nodes=2).place.crowded_nodes == 2


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


@pytest.mark.parametrize(("seed", "index", "field"), [(-1, 0, "seed"), (0, -1, "index")])
def test_maps_are_counted_from_zero(seed: int, index: int, field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        draw_map(scenario("paper-congested"), seed, index)
    assert caught.value.field == field


# --- Rush hours -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "side", "crowded_nodes"), [("rush-16", 16, 28), ("rush-32", 32, 114)])
def test_rush_hours_by_the_numbers(name: str, side: int, crowded_nodes: int) -> None:
    rush = BUILT_IN[name]
    # every ninth node is crowded: 256 / 9 = 28.4 and 1,024 / 9 = 113.8
    assert (rush.place.side, rush.place.crowded_nodes, rush.departures, rush.level) == (
        side,
        crowded_nodes,
        (0, 3600),
        "local",
    )
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


def test_shifting_crowds_are_elsewhere_in_every_future() -> None:
    shifting, fixed = BUILT_IN["shifting-crowds"], BUILT_IN["rush-16"]
    assert (shifting.place.side, shifting.place.crowded_nodes, shifting.departures) == (16, 28, (0, 3600))
    scenario_map = draw_map(shifting, 0)
    assert (scenario_map.network.length == draw_map(fixed, 0).network.length).all()
    # Nobody's streets are crowded in ordinary: nobody can know where they will be.
    assert float(scenario_map.flow.ordinary.base.max()) <= 1000
    drawn = np.asarray(scenario_map.flow.draw(jax.random.key(0), jnp.zeros(4), 1).counted)[:, 0]
    ordinary = scenario_map.flow.ordinary
    wave = np.asarray(ordinary.median(jnp.float32(0), jnp.array([0]))[0] / ordinary.base)
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
    assert (unseen.place.sides, unseen.maps, unseen.place.training_maps, unseen.level) == ((10, 14, 18), 12, 32, "map")
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
    assert other.fingerprint == learned.fingerprint
    assert draw_training_map(unseen, 1).fingerprint != learned.fingerprint


def test_a_scenario_without_training_maps_learns_the_map_itself() -> None:
    assert draw_training_map(small(), 3, 5).fingerprint == draw_map(small(), 3, 5).fingerprint


def test_the_fingerprint_tells_maps_apart(scenario_map) -> None:
    assert draw_map(small(), 0).fingerprint == scenario_map.fingerprint
    assert draw_map(small(horizon=2 * HOUR, law="weidmann"), 0).fingerprint == scenario_map.fingerprint
    others = [
        draw_map(small(), 1),
        draw_map(small(), 0, 1),
        draw_map(small(crowded_nodes=1), 0),  # the same streets with other crowds
        draw_map(small(side=4), 0),
        draw_map(scenario("rush-16", side=3, crowded_nodes=2), 0),
    ]
    assert len({other.fingerprint for other in (scenario_map, *others)}) == 6
