"""What a walker is told: its planner decides at the next crossing, and the rest of the route follows from there."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from sidestep.planners.base import Planner, Route
from sidestep.routing.clocks import TownClock
from sidestep.routing.directions import Leg, compass_word, crowding_word, directions, mean_density, turn_word
from sidestep.routing.facts import End
from sidestep.routing.following import cut
from sidestep.routing.located import Located
from sidestep.routing.onward import Onward, Standing
from sidestep.routing.plan import RoutePlan
from sidestep.routing.sighted import as_arrays, is_seen
from sidestep.routing.under_way import Decision, NextTurn, Sighting, WalkUnderWay
from sidestep.routing.walks import Walks

AT_CROSSING = 15.0
"""Metres behind a crossing, and at most half of the street, up to which a walker may still decide there."""

LEAST_GAIN = 5.0
"""Seconds, or cost by the objective, that another route must save for a walker to change one that is kept to."""


@dataclass(frozen=True)
class News:
    """What has happened since the last decision."""

    left: bool = False
    """The walker left its route."""

    counts: bool = False
    """There may be new counts."""

    seen: tuple[Sighting, ...] = ()
    """Crowds that the walker sees now."""

    away: float | None = None
    """Metres from the position to the street."""


THERE = Decision(
    next=None,
    plan=None,
    seconds=0.0,
    p50=0.0,
    p90=0.0,
    arrives=None,
    changed=False,
    why=None,
    arrived=True,
    seen=False,
    left_route=False,
    metres_away=None,
)


def arrived_at(walk: WalkUnderWay, located: Located, away: float | None) -> tuple[WalkUnderWay, Decision]:
    """The end of a walk."""
    clock, nodes = walk.clock, (*walk.nodes, *located.ends_of(walk.segments)[0])
    walk = replace(walk, arrived=True, segments=(), along=0.0, nodes=nodes, sightings=())
    walk = replace(walk, arrival=clock, p50=clock, p90=clock)
    return walk, replace(THERE, metres_away=away)


def standing_of(walk: WalkUnderWay, located: Located) -> Standing:
    """Where the walker decides next."""
    clock, before = walk.clock - walk.crowds_from, walk.nodes[::-1]
    remembered = walk.remembered[: len(before)][::-1]
    if not walk.segments:
        return Standing(located.ends[0].node, clock, before, remembered, inside=walk.rerouted)
    (segment, *_), ((tail, *_), (head, *_)) = walk.segments, located.ends_of(walk.segments)
    length = located.metres_of([segment])[0]
    if walk.along <= min(AT_CROSSING, length / 2):
        ago = walk.along / located.scenario.walker.free_speed
        return Standing(tail, clock, before, remembered, ago=ago, inside=walk.rerouted and tail == located.ends[0].node)
    remembered = walk.remembered[: len(before) + 1][::-1]
    return Standing(head, clock, (tail, *before), remembered, segment, 1 - walk.along / length)


def decided(walk: WalkUnderWay, located: Located, planner: Planner, news: News) -> tuple[WalkUnderWay, Decision]:
    """Let the planner decide at the next crossing."""
    standing = standing_of(walk, located)
    before = walk.segments[standing.segment is not None :] if walk.segments else None
    if before is None and standing.node == located.ends[1].node:
        return arrived_at(walk, located, news.away)
    onward = Onward(located, planner, walk.futures, standing, as_arrays(walk, located))
    route, gain = _chosen(onward, planner, before)
    on_way = walk.segments[:1] if standing.segment is not None else ()
    # Or the walker has to go the few metres back to the crossing.
    goes_on = bool(on_way) or (walk.segments != () and route.segments[:1] == walk.segments[:1])
    rest = _Rest(onward, route, walk.along if goes_on else 0.0, 0.0 if goes_on else standing.ago)
    walks = rest.walks(planner, walk.futures)
    plan = rest.plan(walks, _position(walk, located, news.away))
    seconds, times = rest.seconds, walks.times
    changed = news.left or (before is not None and route.segments != before)
    why = _why(onward, planner, news, before or (), plan, gain) if changed else None
    turn = _next_turn(walk, located, standing, route, plan.legs[0].metres if on_way else 0.0)
    walk = replace(
        walk,
        segments=(*on_way, *route.segments),
        remembered=(*walk.remembered[: len(walk.nodes) + len(on_way)], *route.remembered),
        along=rest.along,
        arrival=walk.clock + seconds if route.arrived else None,
        p50=walk.clock + 60 * times.median_minutes,
        p90=walk.clock + 60 * times.p90_minutes,
    )
    return walk, Decision(
        next=turn,
        plan=plan,
        seconds=seconds,
        p50=60 * times.median_minutes,
        p90=60 * times.p90_minutes,
        arrives=_arrives(walk, located),
        changed=changed,
        why=why,
        arrived=False,
        seen=is_seen(walk, located, standing.node),
        left_route=news.left,
        metres_away=news.away,
    )


def _chosen(onward: Onward, planner: Planner, before: tuple[int, ...] | None) -> tuple[Route, float]:
    """Choose the route, and say how many seconds it is faster than the one before."""
    route = onward.expected_route(planner)
    if before is None or route.segments == before:
        return route, 0.0
    kept = onward.judged(before)
    better = route.arrived and route.cost <= kept.cost - LEAST_GAIN
    if planner.observes == "position" and kept.arrived and not better:
        return kept, 0.0
    return route, kept.seconds - route.seconds


@dataclass(frozen=True)
class _Rest:
    """The rest of a walk from the position on."""

    onward: Onward
    route: Route
    """From the next crossing on."""
    along: float
    """Metres of the first segment that the walker is beyond."""
    back: float
    """Seconds back to the crossing."""

    @property
    def until_node(self) -> float:
        """Seconds until the walker is at the crossing; below zero where it is beyond."""
        return float(self.onward.until_node[0]) + self.back

    @property
    def seconds(self) -> float:
        """Until the walk arrives if crowds are as expected."""
        return max(self.until_node + self.route.seconds, 0.0)

    def walks(self, planner: Planner, futures: int) -> Walks:
        """Walk through futures.

        Forecasts in every future take long, so planners that see all counts keep to the route there.

        Parameters
        ----------
        planner
            Who decides.
        futures
            How many to simulate.

        Returns
        -------
        Walks
            Their times from now on.
        """
        decides = planner.level == "hindsight" or planner.observes in {"local", "map"}
        walker = planner if decides else self.onward.keeping(self.route.segments)
        walks = self.onward.walk(walker, futures)
        return replace(walks, planner=planner, minutes=np.maximum(walks.minutes + self.back / 60, 0.0))

    def plan(self, walks: Walks, position: End) -> RoutePlan:
        """Say everything of it, as of other routes."""
        onward = self.onward
        plan, segment = onward.described(self.route, walks, None, {}), onward.standing.segment
        legs, nodes, minutes = plan.legs, plan.nodes, plan.minutes
        more = self.until_node / 60
        if segment is not None:
            legs, nodes, minutes = [self._first(segment), *legs], [None, *nodes], [0.0, *(more + at for at in minutes)]
        elif self.along:
            legs, nodes = [self._beyond(legs[0]), *legs[1:]], [None, *nodes[1:]]
            minutes = [0.0, *(more + at for at in minutes[1:])]
        return replace(
            plan,
            origin=position,
            nodes=nodes,
            minutes=minutes,
            legs=legs,
            steps=None if plan.steps is None else directions(legs),
            metres=sum(leg.metres for leg in legs),
            expected_minutes=self.seconds / 60,
            mean_density=mean_density(legs),
            crowding=crowding_word(mean_density(legs)),
            exposure=sum(leg.exposure for leg in legs),
        )

    def _first(self, segment: int) -> Leg:
        """What is left of the segment that the walker is on."""
        onward, standing = self.onward, self.onward.standing
        slot_seconds, slots = onward.alone.futures.speeds.slot_seconds, onward.density.shape[1]
        density = float(onward.density[segment, min(int(standing.clock // slot_seconds), slots - 1)])
        leg = Leg(
            segment=segment,
            metres=onward.located.metres_of([segment])[0] * standing.part,
            minutes=self.until_node / 60,
            density=density,
            exposure=density * self.until_node,
            too_dense=False,
        )
        (leg,), *_ = onward.located.on_map([leg], onward.density[:, 0])
        return leg if leg.coordinates is None else replace(leg, coordinates=cut(leg.coordinates, standing.part))

    def _beyond(self, leg: Leg) -> Leg:
        """The first leg without the metres that are behind the walker."""
        part = 1 - self.along / leg.metres
        minutes = max(leg.minutes + self.until_node / 60, 0.0)
        exposure = leg.exposure * (minutes / leg.minutes)
        course = None if leg.coordinates is None else cut(leg.coordinates, part)
        return replace(leg, metres=leg.metres * part, minutes=minutes, exposure=exposure, coordinates=course)


def _point(located: Located, segment: int, along: float) -> Float[np.ndarray, "2"]:
    """X and y in m of a place some metres along a segment."""
    line = located.line(segment)
    passed = np.append(0.0, np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum())
    at = passed[-1] * along / located.metres_of([segment])[0]
    return np.array([np.interp(at, passed, column) for column in line.T])


def _position(walk: WalkUnderWay, located: Located, away: float | None) -> End:
    """Where the walker is, on the street."""
    if not walk.segments:
        return located.named_ends[0]
    (segment, *_), ((tail, *_), _) = walk.segments, located.ends_of(walk.segments)
    degrees = located.in_degrees(_point(located, segment, walk.along))
    node = located.named(tail) if walk.along == 0 else None
    if degrees is None:
        return End(node, f"{walk.along:.0f} m beyond node {tail}")
    longitude, latitude = degrees.tolist()
    return End(node, f"{latitude:.5f},{longitude:.5f}", latitude, longitude, away or 0.0)


def _next_turn(walk: WalkUnderWay, located: Located, standing: Standing, route: Route, metres: float) -> NextTurn:
    """What to do at the next crossing."""
    node = standing.node
    degrees = located.in_degrees(np.asarray(located.scenario_map.network.position)[node].astype(np.float64))
    longitude, latitude = (None, None) if degrees is None else degrees.tolist()
    segment = standing.segment
    if segment is None and walk.segments and walk.nodes:  # the last one on the way here
        exits = located.exits(walk.nodes[-1])
        segment = next((one for one, head in zip(exits, located.ends_of(exits)[1], strict=True) if head == node), None)
    before = None if segment is None else located.bearings(segment)[1]
    if not route.segments:
        onto, turn, bearing = walk.segments[0], "arrive", before or 0.0
    else:
        onto = route.segments[0]
        bearing = located.bearings(onto)[0]
        turn = f"head {compass_word(bearing)}" if before is None else turn_word(before, bearing)
    return NextTurn(
        turn=turn,
        metres=metres,
        node=located.named(node),
        latitude=latitude,
        longitude=longitude,
        segment=onto if route.segments else None,
        street=located.street_name(onto),
        bearing=bearing,
        bearing_before=before,
    )


def _arrives(walk: WalkUnderWay, located: Located) -> str | None:
    """The time of the arrival."""
    if walk.arrival is None:
        return None
    facts = located.start.facts(round(walk.arrival - walk.crowds_from))
    untimed = isinstance(located.start, TownClock) and not located.start.timed
    return None if untimed else facts.get("departure") or facts["departs"]


def _why(onward: Onward, planner: Planner, news: News, before: tuple[int, ...], plan: RoutePlan, gain: float) -> str:
    """Say in a sentence why the route is another one."""
    if news.left:
        return "left the route"
    saved = f"{gain / 60:.0f} min" if gain >= 60 else f"{gain:.0f} s"
    located, saves = onward.located, gain >= 1
    street = located.street_numbers
    seen = {each.street: each.density for each in news.seen}
    there = {seen[number]: segment for segment in before if (number := int(street[segment])) in seen}
    if there:
        densest = max(there)
        crowd = f"a crowd of {densest:.1f} persons/m² ahead on {located.street_name(there[densest])}"
        return f"{crowd}: {saved} longer that way" if saves else crowd
    onto = next((leg.segment for leg in plan.legs if street[leg.segment] in seen), None)
    if onto is not None and saves:
        crowd = f"only {seen[street[onto]]:.1f} persons/m² on {located.street_name(onto)}"
        return f"{crowd}: {saved} faster that way"
    if news.counts:
        return f"new counts make {plan.by_way_of} {saved} faster" if saves else "new counts lead another way"
    if saves:
        return f"{plan.by_way_of} is {saved} faster by now"
    return f"{planner.name} decides anew at every crossing"
