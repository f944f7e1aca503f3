"""Plan several routes through central Helsinki with one router, and print how long they may take."""

import sidestep

router = sidestep.Router("helsinki")
station, market, park = "60.1719,24.9414", "60.1675,24.9530", "60.1640,24.9480"
for origin, destination in ((station, market), (market, park), (park, station)):
    plan = router.plan(origin, destination, depart="2025-05-24T17:30", futures=50)
    print(f"{plan.metres:,.0f} m, {plan.expected_minutes:.0f} min, 90 % within {plan.p90_minutes:.0f} min")
print(plan.synthetic)
