"""The planner protocol, and the one way in which all planners walk."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, NamedTuple, Protocol, TypeGuard, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PyTree

from sidestep.arguments import COUNT, checked, instance
from sidestep.environment.cost_to_go import check_known
from sidestep.environment.dynamics import random_exit
from sidestep.environment.rollout import Decide, Past, Remember, UnderWay, Walk, depart, ended, walk, walk_on
from sidestep.environment.types import EnvParams, Information, Instance, Level, Observation, SeeSlot
from sidestep.errors import SidestepError
from sidestep.programs import over_devices, program
from sidestep.walking.crossing_time import slot_at

Made = TypeVar("Made")


class Plan(eqx.Module):
    """Everything that a planner works out before walks begin."""

    shared: PyTree
    """Arrays that all walks share, such as the parameters of a network; None where there are none."""

    own: PyTree
    """Arrays of each walk; every leaf has a leading axis of walks."""


DecideByPlan = Callable[[Any, Any, Observation, Key[Array, ""]], Int[Array, ""]]
"""Choose an exit, given ``plan.shared``, this walk's row of ``plan.own``, the observation and a random key."""

RememberByPlan = Callable[[Any, Any, Observation], Float[Array, ""]]
"""What to remember of a node, given ``plan.shared``, this walk's row of ``plan.own`` and the observation from there."""


@runtime_checkable
class Planner(Protocol):
    """Anything that decides at every crossing which exit to take.

    A planner is a class with four attributes and one method. It keeps no state: ``plan`` returns all that it works out
    before the walks begin, and ``decide`` is a pure JAX function of one walker, which ``jax.vmap`` and ``jax.jit`` turn
    into a compiled program for many. Exits are the segments that leave a node, in the order of ``network.exit_node``
    and ``network.exit_segment``; ``observation.valid`` says which of them may be taken.

    See Also
    --------
    sidestep.planners.registry.register_planner : Makes a planner known by its name.

    Examples
    --------
    A planner that always heads for the node nearest to the destination:

    >>> import jax.numpy as jnp
    >>> import sidestep
    >>> from sidestep.planners.base import Plan
    >>> class StraightLine:
    ...     '''Take the exit that ends nearest to the destination.'''
    ...
    ...     name = "straight-line"
    ...     level = "map"  # it looks the exits up on a map,
    ...     observes = "position"  # and needs to see nothing but its node on the way
    ...
    ...     @staticmethod
    ...     def decide(shared, own, observation, key):
    ...         return jnp.argmin(jnp.where(observation.valid, own[observation.node], jnp.inf))
    ...
    ...     def plan(self, params, instances):
    ...         position, exit_node = params.network.position, params.network.exit_node
    ...         away = position[exit_node] - position[instances.destination][:, None, None]
    ...         return Plan(shared=None, own=jnp.linalg.norm(away, axis=-1))  # metres, [walk, node, exit]

    It walks beside the others once it is registered:

    >>> _ = sidestep.register_planner(StraightLine)
    >>> problem = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> chosen = sidestep.choose_planners(problem, ["straight-line"])
    >>> found = sidestep.compare(problem, chosen.factories, maps=[0], walks=5)
    >>> list(found.records)
    ['shortest-path', 'expected', 'clairvoyant', 'straight-line']
    """

    name: ClassVar[str]
    """The name on command lines and in tables: lower case with hyphens."""

    decide: ClassVar[DecideByPlan]
    """The decision: a function without side effects, the same object for all instances of the class.

    It is static, so planners with the same ``decide`` share one compiled program.
    """

    @property
    def level(self) -> Level:
        """The level of knowledge: what the planner may use, here and in :meth:`plan`; others of it are its peers."""

    @property
    def observes(self) -> Information:
        """The level of the observations that ``decide`` uses; often lower than ``level``, since fewer are faster."""

    def plan(self, params: EnvParams, instances: Instance, /) -> Plan:
        """Prepare walks.

        Parameters
        ----------
        params
            The environment. A planner may use the parts that its level knows: ``network`` and ``expected`` from
            ``map`` on, ``futures`` in hindsight only.
        instances
            Origins, destinations, departures and futures, with a leading axis of walks.

        Returns
        -------
        Plan
            What ``decide`` is given.
        """


@runtime_checkable
class Remembering(Planner, Protocol):
    """A planner that remembers one number of each node that its walk leaves, and finds them in its observations."""

    remember: ClassVar[RememberByPlan]
    """What it remembers of a node before it leaves it: like ``decide`` a function without side effects, and static."""


class PlanningAhead(Planner, Protocol):
    """A planner that knows how far ahead it looks, and so does without expected times that come later."""

    def plan_within(self, params: EnvParams, instances: Instance, /) -> Plan | None:
        """Prepare walks where expected times are known up to some clock, and NaN from then on.

        Parameters
        ----------
        params, instances
            As in :meth:`plan`.

        Returns
        -------
        Plan or None
            What :meth:`plan` makes where all of them are known; None where they are too few for that.
        """


def plans_ahead(planner: Planner) -> TypeGuard[PlanningAhead]:
    """Whether a planner says how far its own plans look; those of a class that changes ``plan`` may look farther."""
    methods = (name for each in type(planner).__mro__ for name in ("plan_within", "plan") if name in vars(each))
    return next(methods, None) == "plan_within"


class WalkError(SidestepError):
    """Walks that nobody can walk: no planner, no environment, or none that fits."""


@dataclass(frozen=True)
class Route:
    """One whole walk, as numbers for people."""

    segments: tuple[int, ...]
    """The segments that were walked, one after the other."""

    nodes: tuple[int, ...]
    """The origin, and the node at which each segment ends."""

    clocks: tuple[float, ...]
    """Seconds since the scenario's start at which each node is reached; the first is the departure."""

    seconds: float
    """Travel time; the horizon where the walk did not arrive."""

    arrived: bool
    """Whether the walk reached its destination by the horizon."""

    cost: float = math.nan
    """By the objective, in s."""

    remembered: tuple[float, ...] = ()
    """What a planner that remembers nodes remembers of all but the last; empty for others."""


def keep_to_plan(
    _shared: None, own: Bool[Array, "node exit"] | Int[Array, " step"], observation: Observation, key: Key[Array, ""]
) -> Int[Array, ""]:
    """Take the exit planned for this step or, of a table, one that it allows at this node.

    Returns
    -------
    Int[Array, ""]
        Where the table allows several exits, one of them at random; where it allows none, any valid one.
    """
    if own.ndim == 1:
        return own[jnp.minimum(observation.steps, own.shape[0] - 1)]
    here = own[observation.node]
    return random_exit(jnp.where(here.any(), here, observation.valid), jax.random.uniform(key))


class Planned:
    """What planners have in common that keep to a plan, whatever they meet on the way."""

    observes: ClassVar[Information] = "position"
    decide: ClassVar[DecideByPlan] = staticmethod(keep_to_plan)


@dataclass(frozen=True)
class _Named:
    """A decision by its place in the source: as text, by which a compiled program may be found again."""

    module: str
    name: str

    @staticmethod
    def of(decide: Any) -> Any:
        """The place of a decision; itself if it has none of its own."""
        named = _Named(getattr(decide, "__module__", ""), getattr(decide, "__qualname__", ""))
        # Those of others may change while their names stay.
        return named if named.module.startswith("sidestep.") and named() is decide else decide

    def __call__(self) -> DecideByPlan | None:
        """The decision."""
        return getattr(sys.modules.get(self.module), self.name, None)


def _rules(
    decide: "DecideByPlan | _Named", remember: "RememberByPlan | _Named | None", plan: Plan, own: PyTree
) -> tuple[Decide, Remember | None]:
    """What one walker decides and remembers by."""
    choose: Any = decide() if isinstance(decide, _Named) else decide
    keep: Any = remember() if isinstance(remember, _Named) else remember
    return partial(choose, plan.shared, own), None if keep is None else partial(keep, plan.shared, own)


def _side_by_side(one: Callable[..., Made], plan: Plan, *each: PyTree, alike: bool) -> Made:
    """One walker's function of its row of the plan, of all walkers, who are divided among devices."""
    walkers = jax.tree.leaves(each)[0].shape[0]
    if alike:  # one table for all walks, not a copy for each
        own = jax.tree.map(lambda leaf: leaf[0], plan.own)
        return over_devices(jax.vmap(partial(one, own)), walkers, tuple(0 for _ in each))(*each)
    return over_devices(jax.vmap(one), walkers, (0, *(0 for _ in each)))(plan.own, *each)


@program("decide", "remember", "trace", "level", "alike", spread=True)
def _walk_all(
    decide: "DecideByPlan | _Named",
    remember: "RememberByPlan | _Named | None",
    params: EnvParams,
    plan: Plan,
    instances: Instance,
    key: Key[Array, ""],
    trace: int,
    level: Information,
    past: Past | None,
    *,
    alike: bool,
) -> Walk:
    params = replace(params, level=level)

    def one(own: PyTree, instance: Instance, key: Key[Array, ""]) -> Walk:
        choose, keep = _rules(decide, remember, plan, own)
        return walk(params, choose, instance, key, trace, past, keep)

    return _side_by_side(one, plan, instances, jax.random.split(key, instances.origin.shape[0]), alike=alike)


class _Standing(NamedTuple):
    """Walks under way, and where they go on."""

    walks: UnderWay
    ended: Walk
    """What they are once they are over."""
    slot: Int[Array, ""]
    """The earliest in which a walker is."""
    wanted: Bool[Array, " future"]
    """Whether one is there in each of the futures."""

    @staticmethod
    def of(params: EnvParams, walks: UnderWay) -> "_Standing":
        speeds, future = params.futures.speeds, walks.state.instance.future
        slots = slot_at(walks.state.clock, speeds.slot_seconds, speeds.slots)
        slot = jnp.min(jnp.where(walks.over, speeds.slots, slots))
        wanted = jnp.zeros(speeds.count, bool).at[future].max(~walks.over & (slots == slot))
        return _Standing(walks, jax.vmap(partial(ended, params))(walks), slot, wanted)


@program("trace", "remembers")
def _depart(params: EnvParams, instances: Instance, past: Past | None, *, trace: int, remembers: bool) -> _Standing:
    params = replace(params, level="position")  # nothing is seen yet
    begun = jax.vmap(lambda instance: depart(params, instance, trace, past, remembers=remembers))(instances)
    return _Standing.of(params, begun)


@program("decide", "remember", "level", "alike", spread=True)
def _walk_slot(
    decide: "DecideByPlan | _Named",
    remember: "RememberByPlan | _Named | None",
    params: EnvParams,
    plan: Plan,
    walks: UnderWay,
    slot: Int[Array, ""],
    key: Key[Array, ""],
    level: Information,
    *,
    alike: bool,
) -> _Standing:
    params = replace(params, level=level)

    def one(own: PyTree, under_way: UnderWay, key: Key[Array, ""]) -> UnderWay:
        choose, keep = _rules(decide, remember, plan, own)
        return walk_on(params, choose, under_way, key, keep, slot)

    keys = jax.random.split(key, len(walks.over))
    return _Standing.of(params, _side_by_side(one, plan, walks, keys, alike=alike))


def walk_plan(
    planner: Planner,
    params: EnvParams,
    plan: Plan,
    instances: Instance,
    key: Key[Array, ""],
    trace: int = 0,
    past: Past | None = None,
    see: SeeSlot | None = None,
) -> Walk:
    """Walk all instances by a plan.

    Parameters
    ----------
    planner
        The planner that made the plan.
    params
        The environment, of the level that the planner observes or a higher one.
    plan, instances
        The plan, and the walks that it is for: as many as it is of or, where it is of one walk, any number.
    key
        Source of all random numbers. The same key gives every planner the same ones.
    trace
        Number of segments to remember of each walk.
    past
        What all walkers bring along where their walks go on from others.
    see
        Gives the environment that walkers decide in slot by slot, as they get there. By default they decide in
        ``params``.

    Returns
    -------
    Walk
        How each walk went; every leaf has a leading axis of walks.

    Raises
    ------
    KnowledgeError
        Walks about which the environment's level knows nothing.
    """
    numbers = {leaf.shape[0] for leaf in jax.tree.leaves(plan.own)}
    alike = numbers == {1} and instances.origin.shape[0] > 1
    decide, level = _Named.of(planner.decide), planner.observes
    remember = _Named.of(planner.remember) if isinstance(planner, Remembering) else None
    if see is None:
        check_known(params, instances, planner.observes)
        return _walk_all(decide, remember, params, plan, instances, key, trace, level, past, alike=alike)
    now = _depart(params, instances, past, trace=trace, remembers=remember is not None)
    while (wanted := np.asarray(now.wanted)).any():
        there = see(int(now.slot), wanted)
        check_known(there, instances, planner.observes)
        now = _walk_slot(decide, remember, there, plan, now.walks, now.slot, key, level, alike=alike)
    return now.ended


@checked(
    WalkError,
    planner=instance(Planner, "a planner, such as sidestep.find_planner('expected')"),
    params=instance(EnvParams, "an environment, such as sidestep.make_environment(scenario, scenario_map, 'test', 1)"),
    instances=instance(Instance, "walks, such as sidestep.instances(scenario, scenario_map, params, walks=1)"),
    key=instance(jax.Array, "a random key, such as jax.random.key(0)"),
    trace=COUNT,
)
def routes(planner: Planner, params: EnvParams, instances: Instance, key: Key[Array, ""], trace: int) -> list[Route]:
    """Plan and walk all instances, and list where each walk went.

    Parameters
    ----------
    planner
        Any planner.
    params, instances
        The environment, and the walks to do in it.
    key
        Source of all random numbers.
    trace
        Most segments of a route; the rest of longer walks is not listed.

    Returns
    -------
    list of Route
        One for each instance.

    Raises
    ------
    WalkError
        Anything but a planner, an environment, walks, a key and a number of 1 or more; the parameter is its field.
    KnowledgeError
        Walks about which the environment's level knows nothing.

    Examples
    --------
    >>> import jax
    >>> import sidestep
    >>> problem = sidestep.scenario("paper-congested", side=3, crowded_nodes=1)
    >>> scenario_map = sidestep.draw_map(problem, seed=0)
    >>> params = sidestep.make_environment(problem, scenario_map, "test", futures=1)
    >>> walks = sidestep.instances(problem, scenario_map, params, walks=1)
    >>> clairvoyant = sidestep.find_planner("clairvoyant")
    >>> [route] = sidestep.routes(clairvoyant, params, walks, jax.random.key(0), trace=20)
    >>> route.nodes[0], route.nodes[-1], route.arrived
    (0, 8, True)
    """
    return routes_along(planner, params, planner.plan(params, instances), instances, key, trace)


def routes_along(
    planner: Planner,
    params: EnvParams,
    plan: Plan,
    instances: Instance,
    key: Key[Array, ""],
    trace: int,
    past: Past | None = None,
    see: SeeSlot | None = None,
) -> list[Route]:
    """:func:`routes` of walks by a plan that was made before; ``past`` and ``see`` are those of :func:`walk_plan`.

    Returns
    -------
    list of Route
        One for each instance.
    """
    walked = walk_plan(planner, params, plan, instances, key, trace, past, see)
    begins, head, walked = jax.device_get((instances, params.network.head, walked))
    found = []
    for walk_number, steps in enumerate(walked.steps.tolist()):
        segments, clocks = (each[walk_number, :steps] for each in (walked.segments, walked.clocks))
        nodes = (int(begins.origin[walk_number]), *head[segments].tolist())
        at = (float(begins.departure[walk_number]), *clocks.tolist())
        seconds, arrived = float(walked.seconds[walk_number]), bool(walked.arrived[walk_number])
        cost = float(walked.cost[walk_number])
        kept = tuple(walked.remembered[walk_number, :steps].tolist())
        found.append(Route(tuple(segments.tolist()), nodes, at, seconds, arrived, cost, kept))
    return found
