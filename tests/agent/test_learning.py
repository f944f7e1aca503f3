"""Learning: the optimiser by hand, the error of one transition, one gradient step, and how the target follows."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.agent.acting import Transition
from sidestep.agent.layers import Linear
from sidestep.agent.learning import Optimiser, learn, move_target, optimiser, start_learner, td_error
from sidestep.agent.presets import PRESETS
from sidestep.agent.q_networks import DuelingQNetwork, QTable
from sidestep.agent.replay import add, empty_replay
from sidestep.environment.types import Observation

# --- The optimiser --------------------------------------------------------------------------------------------------


def rule(**changes: Any) -> Optimiser:
    """A preset's optimiser with other numbers; two rounds of one iteration."""
    config = PRESETS["paper"].changed(rounds=2, round_steps=4, walkers=4, **changes)
    return optimiser(config)


def follow(rule: Optimiser, *gradients: list[float]) -> list[np.ndarray]:
    """What is added to the parameters at each step."""
    begin, update = rule
    state = begin(jnp.zeros(len(gradients[0])))
    changes = []
    for gradient in gradients:
        change, state = update(jnp.array(gradient), state)
        changes.append(np.asarray(change))
    return changes


def test_rmsprop() -> None:
    changes = follow(rule(learning_rate=0.1, learning_rate_end=0.1, decay=0.75, damping=0.5), [4.0, -8.0], [2.0, 0.0])
    # g = .25 * 4² = 4: -.1 * 4 / (√4 + .5) = -.16.   g = .25 * 8² = 16: .1 * 8 / (√16 + .5) = .177778
    np.testing.assert_allclose(changes[0], [-0.16, 0.1777778], rtol=1e-5)
    # g = .75 * 4 + .25 * 2² = 4: -.1 * 2 / (√4 + .5) = -.08.   A gradient of 0 changes nothing.
    np.testing.assert_allclose(changes[1], [-0.08, 0.0], rtol=1e-5)


def test_the_learning_rate_falls_linearly() -> None:
    changes = follow(rule(learning_rate=0.1, learning_rate_end=0.02, decay=0.75, damping=0.5), [4.0], [2.0], [2.0])
    # Two iterations from .1 to .02: .1, then .06, and .02 at the end. As above: 4 / 2.5 = 1.6 and 2 / 2.5 = .8;
    # then g = .75 * 4 + .25 * 4 = 4 again.
    np.testing.assert_allclose(np.concatenate(changes), [-0.16, -0.048, -0.016], rtol=1e-5)


def test_adam_is_there_too() -> None:
    # Adam's first step is the learning rate in the direction of the gradient, whatever its size.
    (change,) = follow(rule(optimiser="adam", learning_rate=0.01, learning_rate_end=0.01), [300.0, -0.02])
    np.testing.assert_allclose(change, [-0.01, 0.01], rtol=1e-4)


# --- The error of one transition ------------------------------------------------------------------------------------


def constant(*q: float) -> DuelingQNetwork:
    """A network with these Q-values everywhere where all exits exist."""
    value = jnp.array(q).mean()
    return DuelingQNetwork(
        offset=jnp.zeros(2),
        scale=jnp.ones(2),
        hidden=(),
        value=Linear(jnp.zeros((1, 2)), value[None]),
        advantage=Linear(jnp.zeros((3, 2)), jnp.array(q) - value),
        crossings=0,
        unit=1.0,
    )


@pytest.mark.parametrize(("double", "by_hand"), [(False, 10.0), (True, 5.5)])
def test_td_error(double: bool, by_hand: float) -> None:
    seen = Observation(jnp.int32(0), jnp.zeros(2), jnp.ones(3, bool), jnp.int32(0))
    item = Transition(seen, jnp.int32(1), jnp.float32(2), jnp.float32(0.5), seen)
    # The network says 1, 3, 8; the target 22, 9, 13. The error of exit 1 is 2 + .5 max(22, 9, 13) - 3 = 10; with
    # double Q 2 + .5 * 13 - 3 = 5.5, because the network prefers exit 2.
    config = PRESETS["paper"].changed(double=double)
    found = td_error(config, constant(1, 3, 8), constant(22, 9, 13), item)
    np.testing.assert_allclose(found, (by_hand, 3), rtol=1e-6)


# --- One step -------------------------------------------------------------------------------------------------------


def at(node: int, exits: int = 2) -> Observation:
    return Observation(jnp.int32(node), jnp.zeros(2), jnp.ones(exits, bool), jnp.int32(0))


def memory_of(*steps: tuple[int, int, float, int]) -> Any:
    """A replay of these steps: from a node, by an exit, for a reward, to a node; they end there."""
    items = [Transition(at(a), jnp.int32(b), jnp.float32(c), jnp.float32(0), at(d)) for a, b, c, d in steps]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *items)
    return add(empty_replay(items[0], len(items)), batch, len(items))


def test_one_step_on_a_table_by_hand() -> None:
    # All of the batch is the one step whose error is 6 - 2 = 4. The gradient of its square is -2 * 4, the rate .25.
    config = PRESETS["tabular-q"].changed(learning_rate=0.25, learning_rate_end=0.25)
    learner = start_learner(config, QTable(jnp.array([[1.0, 2.0], [3.0, 4.0]])))
    learner, replay, report = learn(
        config, learner, learner.target, memory_of((0, 1, 6.0, 1)), jnp.linspace(0, 0.99, 64)
    )
    np.testing.assert_allclose(learner.q_network.q, [[1, 2 + 0.25 * 8], [3, 4]], rtol=1e-6)
    assert (float(report.loss), float(report.td_error), float(report.q)) == (16, 4, 2)
    # Without priorities all have priority 1.
    assert float(replay.priorities.total) == 1


def test_errors_become_priorities() -> None:
    config = PRESETS["tabular-q"].changed(alpha=0.5, beta=0.0, priority_floor=0.0)
    learner = start_learner(config, QTable(jnp.zeros((2, 2))))
    # Both steps are in the batch: errors 4 and -9 have priorities 2 and 3.
    steps = memory_of((0, 0, 4.0, 1), (1, 1, -9.0, 0))
    _, replay, report = learn(config, learner, learner.target, steps, jnp.linspace(0, 0.99, 64))
    assert float(report.td_error) == pytest.approx(6.5)  # as large in the mean; half of the batch is of each
    assert replay.priorities.leaves[0, :2].tolist() == pytest.approx([2, 3])


@pytest.mark.parametrize(("huber", "by_hand"), [(0.0, 16.0), (10.0, 16.0), (1.0, 7.0)])
def test_large_errors_count_in_proportion(huber: float, by_hand: float) -> None:
    config = PRESETS["tabular-q"].changed(huber=huber)
    learner = start_learner(config, QTable(jnp.zeros((2, 2))))
    *_, report = learn(config, learner, learner.target, memory_of((0, 1, 4.0, 1)), jnp.linspace(0, 0.99, 64))
    # 4² = 16; beyond 1 it is 2 (4 - 1/2) = 7.
    assert float(report.loss) == pytest.approx(by_hand)


@pytest.mark.parametrize(("period", "rate"), [(1, 1.0), (1, 0.25), (2, 0.25), (5, 1.0)])
def test_the_target_follows_every_k_iterations(period: int, rate: float) -> None:
    config = PRESETS["tabular-q"].changed(target_period=period, target_rate=rate)
    target = QTable(jnp.array([[8.0, 8.0], [8.0, 8.0]]))
    learner = replace(start_learner(config, QTable(jnp.array([[2.0, 4.0], [6.0, 0.0]]))), target=target)
    for iteration in range(1, 5):
        after = move_target(config, learner, jnp.int32(iteration))
        moves = rate if iteration % period == 0 else 0
        np.testing.assert_allclose(after.target.q, moves * learner.q_network.q + (1 - moves) * target.q, rtol=1e-6)
