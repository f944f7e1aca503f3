"""How Q-values become a decision, in training as in deployment."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Int, Key

from sidestep.agent.config import TrainConfig
from sidestep.agent.q_networks import QNetwork
from sidestep.agent.td import mask
from sidestep.environment.types import Observation


class Policy(eqx.Module):
    """Take the valid exit of the highest Q-value.

    Training follows it without margins. Deployed agents and test walks follow it with the margins of their
    configuration (:func:`deployed`): learned corrections that are small against the walk are then left to the level's
    own estimate of the cost to go.
    """

    q_network: QNetwork
    margin: float = eqx.field(static=True, default=0.0)
    """Value by which another exit must exceed the one that the estimate prefers, in units of reward."""
    estimate_when_revisiting: bool = eqx.field(static=True, default=False)
    """Follow the estimate at crossings that this walk has left before."""

    def __call__(self, observation: Observation, _key: Key[Array, ""] | None = None) -> Int[Array, ""]:
        """Decide which exit to take."""
        values, local, estimate = self.q_network(observation), observation.local, observation.estimate
        if local is not None and estimate is not None:  # level position has no estimate, and so there are no margins
            if self.margin:
                preferred = jnp.argmax(mask(-estimate, observation.valid))
                values = values.at[preferred].add(self.margin)
            if self.estimate_when_revisiting:
                values = jnp.where(local.revisiting, -estimate, values)
        return jnp.argmax(mask(values, observation.valid))


def deployed(config: TrainConfig, q_network: QNetwork, reward_seconds: float) -> Policy:
    """Make the policy that walkers follow once they have learned.

    Parameters
    ----------
    config
        Whose margins are used.
    q_network
        What was learned.
    reward_seconds
        Seconds of cost in one unit of reward.

    Returns
    -------
    Policy
        With margins in units of reward.
    """
    return Policy(q_network, config.correction_margin_seconds / reward_seconds, config.estimate_when_revisiting)
