"""Train a walker on a congested map and print its route beside the best possible one."""

import jax

from sidestep import PRESETS, draw_map, instances, make_environment, routes, scenario, train_darp
from sidestep.planners.time_dependent import Clairvoyant

problem = scenario("paper-congested")
place = draw_map(problem, seed=0)
darp = train_darp(PRESETS["default"], problem, place)

crowds = make_environment(problem, place, "test", crowds=1)  # a future that training never met
walk = instances(problem, place, crowds, walks=1)
for planner in (darp, Clairvoyant()):
    route = routes(planner, crowds, walk, jax.random.key(0), trace=50)[0]
    print(f"{planner.name}: {route.seconds / 60:.0f} min over {' '.join(map(str, route.nodes))}")
