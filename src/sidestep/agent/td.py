"""Temporal-difference errors of one transition; ``jax.vmap`` makes a batch.

Names are the literature's: ``q_tm1`` and ``a_tm1`` belong to the state that was left, ``r_t`` and ``discount_t`` to the
step, ``q_t`` to the state that was reached. ``discount_t`` is 0 where the episode terminated and gamma elsewhere, also
where it was truncated, since the walk would have gone on.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


def mask(q: Float[Array, " exit"], valid: Bool[Array, " exit"]) -> Float[Array, " exit"]:
    """Q-values with minus infinity for exits that do not exist."""
    return jnp.where(valid, q, -jnp.inf)


def q_learning(
    q_tm1: Float[Array, " exit"],
    a_tm1: Int[Array, ""],
    r_t: Float[Array, ""],
    discount_t: Float[Array, ""],
    q_t: Float[Array, " exit"],
    valid_t: Bool[Array, " exit"],
) -> Float[Array, ""]:
    """TD error of Q-learning: r + γ max Q⁻ - Q (eqs. 16 and 17; Mnih et al. 2015). ``q_t`` is the target network's."""
    return r_t + _discounted(discount_t, jnp.max(mask(q_t, valid_t))) - q_tm1[a_tm1]


def double_q_learning(
    q_tm1: Float[Array, " exit"],
    a_tm1: Int[Array, ""],
    r_t: Float[Array, ""],
    discount_t: Float[Array, ""],
    q_t: Float[Array, " exit"],
    selector_t: Float[Array, " exit"],
    valid_t: Bool[Array, " exit"],
) -> Float[Array, ""]:
    """TD error of double Q-learning (van Hasselt et al. 2016).

    The online network's ``selector_t`` chooses the next action, the target network's ``q_t`` values it.
    """
    return r_t + _discounted(discount_t, q_t[jnp.argmax(mask(selector_t, valid_t))]) - q_tm1[a_tm1]


def _discounted(discount_t: Float[Array, ""], value_t: Float[Array, ""]) -> Float[Array, ""]:
    """Nothing after the end of an episode counts, not even the minus infinity of a destination without exits."""
    return jnp.where(discount_t > 0, discount_t * value_t, 0.0)
