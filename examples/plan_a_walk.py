"""Train a walker on a congested map, and print its route beside the best possible one."""

import sidestep

problem = sidestep.scenario("paper-congested")
run = sidestep.train(problem, sidestep.preset("default"))
router = sidestep.Router(problem)
for planner in (sidestep.trained_darp(run.model), "clairvoyant"):
    plan = router.plan(0, 35, planner=planner)
    print(f"{plan.planner}: {plan.median_minutes:.0f} min over {' '.join(map(str, plan.nodes))}")
