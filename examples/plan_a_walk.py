"""Train a walker on a congested map and print its route beside the best possible one."""

import jax

from sidestep import PRESETS, draw_map, instances, make_environment, routes, scenario, train_darp
from sidestep.planners.time_dependent import Clairvoyant

problem = scenario("paper-congested")
scenario_map = draw_map(problem, seed=0)
darp = train_darp(PRESETS["default"], problem, scenario_map)

futures = make_environment(problem, scenario_map, "test", futures=1)  # a future that training never met
walk = instances(problem, scenario_map, futures, walks=1)
for planner in (darp, Clairvoyant()):
    route = routes(planner, futures, walk, jax.random.key(0), trace=50)[0]
    print(f"{planner.name}: {route.seconds / 60:.0f} min over {' '.join(map(str, route.nodes))}")
