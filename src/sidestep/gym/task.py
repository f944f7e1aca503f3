"""The functional core for JAX users: one walker, its walks and what it is shown, as pure functions on a PyTree."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, UInt32

from sidestep.environment.dynamics import reset, step
from sidestep.environment.observation import observe
from sidestep.environment.types import EnvParams, EnvState, Instance, Observation, Outcome
from sidestep.evaluation.compare import most_at_once, nodes_of_part
from sidestep.gym.features import Encoder, encoder
from sidestep.gym.options import TOWN_DESTINATIONS, EnvError, TaskOptions, read_options
from sidestep.programs import on_device
from sidestep.scenarios.episodes import DRAWS, InstanceSampler, check_paths, destinations_of, instances, sampler
from sidestep.scenarios.futures import make_environment
from sidestep.scenarios.maps import ScenarioMap, draw_map, draw_training_map


class Task(eqx.Module):
    """Walks to be learned. ``jax.vmap`` its methods over many walkers, and ``jax.lax.scan`` them over steps.

    Examples
    --------
    >>> import jax
    >>> from sidestep.gym import make_task
    >>> task = make_task("paper-congested", futures=2)
    >>> state = task.start(jax.random.key(0))
    >>> task.observe(state).valid.tolist()
    [True, False, True, False]
    >>> state, outcome = task.step(state, jax.numpy.int32(2))
    >>> int(state.node), bool(outcome.terminated), outcome.reward < 0
    (1, False, Array(True, dtype=bool))
    """

    params: EnvParams
    """Streets, crowds, rules, and what walkers know."""
    sampler: InstanceSampler
    """The walks, drawn from four uniform numbers each."""
    encoder: Encoder
    destinations: Int[Array, "destination part"]
    """A node of each part of the map for each destination."""
    tests: Instance
    """The walks of ``sidestep compare`` with as many walks as futures, through crowds to test on; none to learn on."""
    parts: tuple[int, ...] = eqx.field(static=True)
    """Nodes of each part of the map; training on several maps at once walks maps side by side."""

    @property
    def exits(self) -> int:
        """Number of actions."""
        return self.params.network.exits

    def start(self, key: Key[Array, ""] | UInt32[Array, "2"]) -> EnvState:
        """Begin a walk that is drawn at random."""
        return self.begin(self.sampler.sample(jax.random.uniform(key, (DRAWS,))))

    def begin(self, instance: Instance) -> EnvState:
        """Begin a certain walk."""
        state, _ = reset(self.params, instance)  # the compiler leaves out what is not used
        return state

    def step(self, state: EnvState, action: Int[Array, ""]) -> tuple[EnvState, Outcome]:
        """Walk to the next crossing; see :func:`sidestep.environment.dynamics.step`. It does not begin anew."""
        return step(self.params, state, action)

    def observe(self, state: EnvState) -> Observation:
        """See what the level sees; ``valid`` is the mask of actions."""
        return observe(self.params, state)

    def encode(self, observation: Observation) -> Float[Array, " feature"] | Int[Array, ""]:
        """Turn an observation into what is shown of it: features, or the crossing."""
        return self.encoder(observation)

    def mask(self, state: EnvState) -> Bool[Array, " exit"]:
        """Which exits may be taken."""
        return self.params.network.exits_to(state.instance.destination, state.node)


def make_task(scenario: object, **options: Any) -> Task:
    """The walks of a scenario for learners of one's own.

    Parameters
    ----------
    scenario
        A scenario, its name or its file.
    **options
        Fields of :class:`sidestep.gym.options.TaskOptions`: those of ``gymnasium.make`` except for masks and pictures.

    Returns
    -------
    Task
        A PyTree of arrays.

    Raises
    ------
    SidestepError
        Unknown and wrong options, with their field, and files that cannot be read or do not fit.

    Examples
    --------
    >>> from sidestep.gym import make_task
    >>> task = make_task("rush-16", level="local", futures=4)
    >>> task.exits, task.encoder.low.shape
    (4, (44,))
    """
    return task_of(read_options(TaskOptions, scenario, options))


def task_of(options: TaskOptions) -> Task:
    """The walks that options describe.

    Parameters
    ----------
    options
        Checked.

    Returns
    -------
    Task
        A PyTree of arrays.

    Raises
    ------
    EnvError
        Several destinations for walkers who do not know theirs.
    SidestepError
        Other options that do not fit the map, and files that cannot be read or do not fit.
    """
    scenario, level = options.scenario, options.shown_level
    draw = draw_training_map if options.purpose == "learn" else draw_map
    here = draw(scenario, options.map_seed, options.map_index)
    check_paths(here)
    _check_walks(options, here)
    compared, nodes = _compared(options, here)
    destinations = destinations_of(here, _destinations(options, here)) if nodes is None else nodes
    if len(destinations) > 1 and level == "position":
        raise EnvError(
            "destinations must be 1 at level position: the walker does not know its own", field="destinations"
        )
    params = make_environment(
        scenario,
        here,
        options.purpose,
        options.futures,
        level=level,
        destinations=destinations,
        samples=None if level in ("map", "live") else 0,  # below, nobody knows what is expected
    )
    anywhere, interpolated = options.from_anywhere, scenario.place.interpolated
    walks = sampler(scenario, here, params, options.futures, destinations=destinations, anywhere=anywhere)
    shown = encoder(options.observation, params, interpolated=interpolated)
    tests = instances(scenario, here, params, options.futures, destinations=nodes) if compared else _nothing()
    task = Task(params, walks, shown, jnp.asarray(destinations, jnp.int32), tests, here.parts)
    return jax.tree.map(lambda leaf: jax.device_put(leaf) if isinstance(leaf, np.ndarray) else leaf, task)


def _compared(options: TaskOptions, here: ScenarioMap) -> tuple[bool, Int[np.ndarray, "destination part"] | None]:
    """Whether the walks are those of a comparison, and where these go; None for walks from corner to corner."""
    scenario, destinations = options.scenario, options.destinations
    known = options.shown_level != "position" or not scenario.place.anywhere or destinations is not None
    if options.purpose == "learn" or not known or options.futures > most_at_once(scenario, here, destinations):
        return False, None
    return True, nodes_of_part(scenario, here, options.futures, destinations)


def _nothing() -> Instance:
    whole, real = on_device(np.empty(0), np.int32), on_device(np.empty(0))
    return Instance(whole, whole, real, whole)


def _check_walks(options: TaskOptions, here: ScenarioMap) -> None:
    if options.walks == "scenario" and options.scenario.place.anywhere and not (here.origins or here.destinations):
        said = f"walks of {options.scenario.name} begin anywhere: the scenario has no origins nor destinations"
        raise EnvError(f"walks must be 'anywhere', since {said}", field="walks")


def _destinations(options: TaskOptions, here: ScenarioMap) -> int:
    if options.destinations is not None:
        return options.destinations
    if not options.scenario.place.anywhere or options.shown_level == "position":
        return 1
    there = len(here.destinations) or here.network.nodes - 2
    return max(min(TOWN_DESTINATIONS, options.futures, there), 1)
