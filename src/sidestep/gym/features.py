"""What learners are shown of an observation: a vector of named numbers of about unit size, or the crossing alone."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from sidestep.agent.segment_network import FAR, features
from sidestep.environment.types import LEVELS, EnvParams, Information, Observation
from sidestep.gym.options import Form


class Feature(NamedTuple):
    """One number of a feature vector."""

    name: str
    level: Information
    """The lowest level that sees it."""
    low: float
    """Smaller values are raised to this one."""
    high: float
    """Larger values are lowered to this one."""
    meaning: str
    interpolated: bool = False
    """Whether it is there only where crowds are interpolated between sensors."""


STATE = (
    Feature("x", "position", -1, 1, "from the west (-1) to the east (1) of the map"),
    Feature("y", "position", -1, 1, "from the south (-1) to the north (1) of the map"),
    Feature("clock", "local", 0, FAR, "time since the scenario's start, in 4 hours"),
    Feature("distance", "local", 0, FAR, "straight line to the destination, in 10 mean streets"),
    Feature("least_cost", "local", -FAR, FAR, "the least of the exits' estimates, in 10 mean streets walked freely"),
    Feature("exits", "local", 0, FAR, "exits that may be taken, in fours"),
    Feature("ahead_x", "local", -1, 1, "direction of the destination, eastwards"),
    Feature("ahead_y", "local", -1, 1, "direction of the destination, northwards"),
    Feature("density_ratio", "map", -FAR, FAR, "mean of the exits' density_ratio", interpolated=True),
)
"""Features of the walker, in their order."""
EXIT = (
    Feature("valid", "local", 0, 1, "1 where the exit may be taken; all else is 0 where it may not"),
    Feature("cost", "local", -FAR, FAR, "log of the cost of crossing the street now, in mean streets walked freely"),
    Feature("slowness", "local", -FAR, FAR, "log of that cost over the time to walk the street freely"),
    Feature("length", "local", -1, FAR, "length over that of the mean street, less 1"),
    Feature("progress", "local", -FAR, FAR, "metres nearer to the destination for each metre of the street"),
    Feature("onward", "local", 0, FAR, "straight line from its end to the destination, in 10 mean streets"),
    Feature(
        "estimate", "local", -FAR, FAR, "the level's estimate of the cost to the destination, less the least one, / 3"
    ),
    Feature("back", "local", 0, 1, "1 on the street that the walker came by"),
    Feature("recency", "local", 0, 1, "1 less a ninth for each step since its end was left; 0 after 8"),
    Feature("expected", "map", -FAR, FAR, "log of the expected cost of crossing the street, in mean streets"),
    Feature("cost_ratio", "map", -FAR, FAR, "log of the cost now over the expected cost"),
    Feature("to_go", "map", -FAR, FAR, "expected cost from its end on, less the least estimate, / 3"),
    Feature("density_ratio", "map", -FAR, FAR, "log of the density now over the expected one", interpolated=True),
    Feature(
        "scaled", "map", -FAR, FAR, "how much larger to_go is in crowds 1.5 times as dense, / 3", interpolated=True
    ),
    Feature("scaled_ratio", "map", -FAR, FAR, "that less the least, times the mean density_ratio", interpolated=True),
    Feature("snapshot", "live", -FAR, FAR, "cost if crowds stay as they are, less the least estimate, / 3"),
    Feature("snapshot_ahead", "live", -FAR, FAR, "the same less the street's own estimate, / 3"),
    Feature("expected_ahead", "live", -FAR, FAR, "cost now and as expected from there on, less the estimate, / 3"),
)
"""Features of every exit, in their order."""


def seen_at(every: tuple[Feature, ...], level: Information, *, interpolated: bool) -> list[Feature]:
    """The features among some that a level sees, on maps whose crowds are interpolated, or are not."""
    known = LEVELS[: LEVELS.index(level) + 1]
    return [each for each in every if each.level in known and (interpolated or not each.interpolated)]


def feature_table(level: Information, exits: int, *, interpolated: bool) -> list[Feature]:
    """The numbers of a feature vector.

    Parameters
    ----------
    level, exits
        What walkers know, and how many exits the map's crossings have at most.
    interpolated
        Whether crowds are interpolated between sensors.

    Returns
    -------
    list[Feature]
        Those of the walker, then those of exit 0, 1, …, each named ``exit_0_cost``.
    """
    here, each = (seen_at(every, level, interpolated=interpolated) for every in (STATE, EXIT))
    return here + [one._replace(name=f"exit_{number}_{one.name}") for number in range(exits) for one in each]


class Encoder(eqx.Module):
    """Turns observations into what is shown of them."""

    middle: Float[Array, "2"]
    """Position that becomes 0, m."""
    extent: Float[Array, "2"]
    """Half the width and height of the map, m."""
    metres: Float[Array, ""]
    """Length of the mean street, m."""
    seconds: Float[Array, ""]
    """Time to walk it freely, s."""
    low: Float[Array, " feature"]
    high: Float[Array, " feature"]
    form: Form = eqx.field(static=True)
    nodes: int = eqx.field(static=True)
    free_speed: float = eqx.field(static=True)

    def __call__(self, seen: Observation) -> Float[Array, " feature"] | Int[Array, ""]:
        """Encode what one walker sees."""
        if self.form == "node":
            return seen.node
        if self.form == "one-hot":
            return jax.nn.one_hot(seen.node, self.nodes)
        numbers, local, estimate = [(seen.position - self.middle) / self.extent], seen.local, seen.estimate
        if local is not None and estimate is not None:
            state, exits = features(seen, local, estimate, self.metres, self.seconds, self.free_speed)
            # From level map on the mean density ratio comes last, as in the table.
            numbers += [state, jnp.concatenate([seen.valid[:, None], exits], axis=1).ravel()]
        return jnp.clip(jnp.concatenate(numbers), self.low, self.high)


def encoder(form: Form, params: EnvParams, *, interpolated: bool) -> Encoder:
    """Make the encoder of an environment.

    Parameters
    ----------
    form
        What is shown.
    params
        The environment, with its streets.
    interpolated
        Whether its crowds are interpolated between sensors.

    Returns
    -------
    Encoder
        For observations of the environment's level.
    """
    network = params.network
    low, high = network.position.min(axis=0), network.position.max(axis=0)
    table = feature_table(params.level, network.exits, interpolated=interpolated)
    return Encoder(
        middle=(low + high) / 2,
        extent=jnp.maximum((high - low) / 2, 1.0),
        metres=jnp.mean(network.length),
        seconds=jnp.mean(network.length) / params.free_speed,
        low=jnp.array([one.low for one in table], jnp.float32),
        high=jnp.array([one.high for one in table], jnp.float32),
        form=form,
        nodes=network.nodes,
        free_speed=params.free_speed,
    )
