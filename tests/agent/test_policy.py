"""Decisions by Q-values, with the margins of deployment and without."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jaxtyping import Array, Float

from sidestep.agent.layers import Linear
from sidestep.agent.policy import Policy, deployed
from sidestep.agent.presets import PRESETS, preset
from sidestep.agent.q_networks import DuelingQNetwork, QTable
from sidestep.environment.types import Local, Observation

Three = Float[Array, " 3"]


def scored(*q: float) -> DuelingQNetwork:
    """A network with these Q-values everywhere, whatever else is valid."""
    return DuelingQNetwork(
        offset=jnp.zeros(2),
        scale=jnp.ones(2),
        hidden=(),
        value=Linear(jnp.zeros((1, 2)), jnp.zeros(1)),
        advantage=Linear(jnp.zeros((3, 2)), jnp.array(q, float)),
        crossings=0,
        unit=1.0,
        dueling=False,
    )


@pytest.fixture
def seen() -> Callable[..., Observation]:
    """What is seen at a crossing with two exits, the first of which is 100 s better by the level's estimate."""

    def make(*, revisiting: bool = False) -> Observation:
        three, where = jnp.zeros(3), jnp.zeros(2)
        local = Local(
            jnp.float32(0), where, jnp.arange(3), jnp.zeros((3, 2)), *[three] * 3, jnp.array(revisiting), jnp.arange(3)
        )
        estimate, valid = jnp.array([500.0, 600.0, 100.0]), jnp.array([True, True, False])
        return Observation(jnp.int32(0), where, valid, jnp.int32(0), local=local, estimate=estimate)

    return make


TOWN = preset("default", "map").changed(correction_margin_seconds=3.0, estimate_when_revisiting=True)


@pytest.mark.parametrize(
    ("values", "revisiting", "chosen", "without"),
    [
        ([-9.0, -5.0, -9.0], False, 1, 1),  # what was learned counts: 4 minutes
        ([-9.0, -8.96, -9.0], False, 0, 1),  # not for .04 minutes, 2.4 s
        ([-9.0, -8.94, -9.0], False, 1, 1),  # but for 3.6 s
        ([-9.0, -5.0, -9.0], True, 0, 1),  # and not where the walker has been before
        ([-9.0, -9.0, -1.0], False, 0, 0),  # exits that do not exist are never taken
    ],
)
def test_corrections_are_followed_where_they_save_seconds(
    seen: Callable[..., Observation], values: list[float], revisiting: bool, chosen: int, without: int
) -> None:
    q_network, observation = scored(*values), seen(revisiting=revisiting)
    assert int(deployed(TOWN, q_network, 60.0)(observation, jax.random.key(0))) == chosen
    # In training there are no margins.
    assert int(Policy(q_network)(observation)) == without
    assert int(deployed(preset("default", "map"), q_network, 60.0)(observation)) == without


def test_margins_are_seconds_whatever_a_reward_is() -> None:
    assert deployed(TOWN, scored(0, 0, 0), 60.0).margin == pytest.approx(0.05)
    assert deployed(TOWN, scored(0, 0, 0), 1.0).margin == 3


def test_each_margin_works_alone(seen: Callable[..., Observation]) -> None:
    nearly, much = scored(-9.0, -8.96, -9.0), scored(-9.0, -5.0, -9.0)
    margin = TOWN.changed(estimate_when_revisiting=False)
    assert int(deployed(margin, nearly, 60.0)(seen())) == 0
    assert int(deployed(margin, much, 60.0)(seen(revisiting=True))) == 1
    again = TOWN.changed(correction_margin_seconds=0.0)
    assert int(deployed(again, nearly, 60.0)(seen())) == 1
    assert int(deployed(again, much, 60.0)(seen(revisiting=True))) == 0


@pytest.mark.parametrize("name", PRESETS)
def test_at_level_position_values_alone_decide(name: str) -> None:
    table = QTable(jnp.array([[1.0, 3.0, 9.0], [5.0, 4.0, 9.0]]))
    valid = jnp.array([True, True, False])
    for node, chosen in ((0, 1), (1, 0)):
        observation = Observation(jnp.int32(node), jnp.zeros(2), valid, jnp.int32(0))
        assert int(deployed(PRESETS[name], table, 60.0)(observation)) == chosen


def test_a_policy_is_a_pytree_of_its_network_alone() -> None:
    policy = deployed(TOWN, scored(1, 2, 3), 60.0)
    assert eqx.tree_equal(jax.tree.leaves(policy), jax.tree.leaves(policy.q_network))
