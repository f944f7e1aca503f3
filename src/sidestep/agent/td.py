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
    selector_t: Float[Array, " exit"],
    valid_t: Bool[Array, " exit"],
) -> Float[Array, ""]:
    """Work out the error of Q-learning, single or double: r + γ Q⁻ of the next action - Q.

    Parameters
    ----------
    q_tm1, a_tm1
        Values of the state that was left, by the online network, and the exit that was taken there.
    r_t, discount_t
        Reward and discount of the step.
    q_t
        Values of the state that was reached, by the target network.
    selector_t
        Values that choose the next action: the target network's own, or in double Q-learning the online network's.
    valid_t
        Which exits of the state that was reached exist.

    Returns
    -------
    Float[Array, ""]
        In units of reward.

    References
    ----------
    Eqs. 16 and 17 of the paper; Mnih et al. 2015, "Human-level control through deep reinforcement learning"; van
    Hasselt et al. 2016, "Deep reinforcement learning with double Q-learning".
    """
    # A sum of one number: of a batch it is quicker than to look the numbers up.
    best_t = jnp.arange(q_t.shape[0]) == jnp.argmax(mask(selector_t, valid_t))
    value_t = jnp.sum(q_t, where=best_t)
    # Without a valid exit the value is that of exit 0 and means nothing; only where episodes end may that be so.
    return r_t + jnp.where(discount_t > 0, discount_t * value_t, 0.0) - q_tm1[a_tm1]
