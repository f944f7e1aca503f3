"""A server with a trained model offers what ``sidestep route --model`` does, and refuses the same."""

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from sidestep.agent.presets import preset_for
from sidestep.agent.runs import train
from sidestep.errors import SidestepError
from sidestep.planners.learned import ModelError
from sidestep.routing.router import Router
from sidestep.scenarios.model import read_objective
from sidestep.scenarios.reader import find_scenario
from sidestep.scenarios.walkers import read_walkers
from sidestep.server.app import make_app
from sidestep.server.settings import Settings

ORIGIN, DESTINATION = [0.0001, 0.0001], [0.0026, 0.0026]
ROUTE = "/route/v1/foot/0.0001,0.0001;0.0026,0.0026"


@pytest.fixture(scope="module")
def model(small_town: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario, folder = find_scenario(str(small_town)), tmp_path_factory.mktemp("trained") / "model"
    tiny = preset_for(scenario, "default", "map").changed(rounds=2, round_steps=256, walkers=8, batch=16, capacity=256)
    train(scenario, tiny.changed(hidden=(4,), test_walks=2, fresh_futures=0), out=folder)
    return folder


@pytest.fixture(scope="module")
def client(small_town: Path, model: Path, test_client, prepared, tmp_path_factory) -> Iterator[httpx.Client]:
    store = tmp_path_factory.mktemp("served") / "store.db"
    settings = Settings(scenario=str(small_town), model=str(model), store=str(store), requests_per_second=1e6)
    with test_client(make_app(settings), base_url="http://127.0.0.1") as served:
        prepared(served)
        yield served


@pytest.fixture(scope="module")
def refused(small_town: Path, model: Path) -> Callable[[dict[str, str]], bool]:
    """Whether no router is made with the model, as on the command line."""

    def ask(asked: dict[str, str]) -> bool:
        scenario, changes = find_scenario(str(small_town)), {}
        if "walker" in asked:
            (changes["walker"],) = read_walkers(asked["walker"], scenario.walker)
        if "objective" in asked:
            changes["objective"] = read_objective(asked["objective"])
        try:
            Router(scenario.changed(**changes), model=model)
        except ModelError:
            return True
        return False

    return ask


def begin(client: httpx.Client, asked: dict[str, str]) -> httpx.Response:
    return client.post("/walks", json={"origin": ORIGIN, "destination": DESTINATION, **asked})


@pytest.mark.parametrize("planner", [{}, {"planner": "darp"}])
@pytest.mark.parametrize(
    ("asked", "field"),
    [
        ({}, None),
        ({"walker": "adult", "objective": "time"}, None),
        ({"walker": "older"}, "walker"),
        ({"objective": "exposure=1"}, "objective"),
        ({"walker": "older", "objective": "exposure=1"}, "walker"),
    ],
)
def test_the_model_plans_for_whom_it_learned(
    client: httpx.Client, refused, asked: dict[str, str], field: str | None, planner: dict[str, str]
) -> None:
    assert refused(asked) is (field is not None)
    route, walk = client.get(ROUTE, params=asked | planner), begin(client, asked | planner)
    if field is None:
        assert (route.status_code, walk.status_code) == (200, 201), (route.text, walk.text)
        assert (route.json()["routes"][0]["planner"], walk.json()["route"]["planner"]) == ("darp", "darp")
        there: dict[str, Any] = {"location": DESTINATION}
        assert client.post(f"/walks/{walk.json()['id']}/position", json=there).json()["arrived"]
    else:
        assert (route.status_code, route.json()["code"]) == (400, "InvalidValue")
        assert (walk.status_code, walk.json()["field"]) == (400, field)


@pytest.mark.parametrize("asked", [{"walker": "older"}, {"objective": "exposure=1"}])
@pytest.mark.parametrize("planner", ["expected", "snapshot"])
def test_other_planners_plan_for_anybody(client: httpx.Client, asked: dict[str, str], planner: str) -> None:
    """The command line plans that without the model."""
    route, walk = client.get(ROUTE, params={**asked, "planner": planner}), begin(client, {**asked, "planner": planner})
    assert (route.status_code, walk.status_code) == (200, 201), (route.text, walk.text)
    assert (route.json()["routes"][0]["planner"], walk.json()["route"]["planner"]) == (planner, planner)


def test_a_model_for_somebody_else_is_refused_as_the_server_starts(
    small_town: Path, model: Path, tmp_path: Path
) -> None:
    for file in small_town.parent.iterdir():
        (tmp_path / file.name).symlink_to(file)
    older = tmp_path / "older.toml"
    older.write_text(f'{small_town.read_text()}\n[walker]\nkind = "older"\n')
    app = make_app(Settings(scenario=str(older), model=str(model), store=str(tmp_path / "store.db")))

    async def start() -> None:
        async with app.router.lifespan_context(app):
            pass

    with pytest.raises(SidestepError) as caught:
        asyncio.run(start())
    assert caught.value.field == "model"
