"""What somebody writes who uses the library with a type checker; mypy checks it, nothing runs it."""

from pathlib import Path
from typing import assert_type

import jax

import sidestep
import sidestep.gym

problem = sidestep.scenario("paper-congested")
assert_type(problem, sidestep.Scenario)
assert_type(sidestep.load_scenario(Path("my-town/scenario.toml")), sidestep.Scenario)
scenario_map = sidestep.draw_map(problem, seed=0)
scenario_map = sidestep.draw_training_map(problem, seed=0)

config = sidestep.preset("default", "position")
assert_type(config, sidestep.TrainConfig)
assert_type(sidestep.PRESETS, dict[str, sidestep.TrainConfig])
run = sidestep.train(problem, config, seed=0)
darp = sidestep.trained_darp(run.model)
assert_type(darp, sidestep.Darp)
darp = sidestep.trained_darp(sidestep.load_model(Path("model")))

params = sidestep.make_environment(problem, scenario_map, "test", futures=1)
walks = sidestep.instances(problem, scenario_map, params, walks=1)
route = sidestep.routes(darp, params, walks, jax.random.key(0), trace=50)[0]
assert_type(route.seconds, float)

planner = sidestep.find_planner("greedy-map")
sidestep.register_planner(planner)
lineup = sidestep.choose_planners(problem, ["greedy-map"])
comparison = sidestep.compare(problem, lineup.factories, maps=[0], walks=10)
assert_type(comparison.to_json()["planners"]["expected"]["mean_minutes"], float)
assert_type(comparison.to_json()["planners"]["expected"]["saving_vs_shortest_path"], float | None)
comparison.to_frame().groupby("planner")["minutes"].mean()

try:
    router = sidestep.Router("helsinki")
    plan = router.plan((60.1719, 24.9414), (60.1640, 24.9480), depart="2025-05-24T17:30")
    assert_type(plan, sidestep.RoutePlan)
    plan = sidestep.plan_route("helsinki", sidestep.RouteRequest(origin=1, destination=2))
except sidestep.SidestepError as error:
    assert_type(error.field, str | None)

task = sidestep.gym.make_task("rush-16", level="local")
state, outcome = task.step(task.start(jax.random.key(0)), jax.numpy.int32(0))
assert_type(task, sidestep.gym.Task)

town = sidestep.load_town(Path("town.npz"))
town = sidestep.load_helsinki()
town, report = sidestep.import_osm(Path("town.osm.pbf"))
network = sidestep.road_network(town.place, [0], [1], [10.0])
assert_type(network, sidestep.RoadNetwork)
