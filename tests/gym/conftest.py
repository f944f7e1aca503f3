"""A small congested grid, and environments on it."""

from collections.abc import Callable

import pytest

import sidestep
from sidestep.gym import Task, WalkEnv, make_task
from sidestep.network.formats import save_town
from sidestep.network.town import Town
from sidestep.scenarios.model import RewardSpec, Scenario
from sidestep.scenarios.places import Venue


@pytest.fixture(scope="session")
def small() -> Scenario:
    return sidestep.scenario("paper-congested", side=3, crowded_nodes=1)


@pytest.fixture(scope="session")
def quarter(block: Callable[..., Town], tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """A town of 16 crossings, whose walks lead from anywhere to anywhere."""
    file = str(tmp_path_factory.mktemp("quarter") / "town.npz")
    save_town(block(), file)
    rewards = RewardSpec(progress=0.0, bonus=0.0)
    return Scenario(name="quarter", place=Venue(streets=file), law="weidmann", horizon=3600.0, reward=rewards)


@pytest.fixture(scope="session")
def task(small: Scenario) -> Task:
    return make_task(small, futures=3)


@pytest.fixture
def env(small: Scenario) -> WalkEnv:
    return WalkEnv(small, futures=3)
