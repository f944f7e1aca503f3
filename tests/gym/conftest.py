"""A small congested grid, and environments on it."""

import pytest

import sidestep
from sidestep.gym import Task, WalkEnv, make_task
from sidestep.scenarios.model import Scenario


@pytest.fixture(scope="session")
def small() -> Scenario:
    return sidestep.scenario("paper-congested", side=3, crowded_nodes=1)


@pytest.fixture(scope="session")
def task(small: Scenario) -> Task:
    return make_task(small, futures=3)


@pytest.fixture
def env(small: Scenario) -> WalkEnv:
    return WalkEnv(small, futures=3)
