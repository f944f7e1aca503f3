"""An environment whose crowds change while walkers walk."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.environment.types import EnvParams
from sidestep.network.grid import grid_network
from sidestep.walking.speed_field import speed_field


@pytest.fixture(scope="session")
def make_busy(make_params) -> Callable[..., EnvParams]:
    """A 3 x 3 grid with two crowds whose speeds change every 300 s."""

    def make(horizon: float) -> EnvParams:
        rng = np.random.default_rng(5)
        network = grid_network(3, rng)
        speed = rng.uniform(0.3, 2, (2, network.segments, 4))
        return make_params(network, speed_field(jnp.asarray(speed, jnp.float32), 300.0), horizon=horizon)

    return make
