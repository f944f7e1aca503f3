"""A deep Q-network in one file of JAX: the yardstick for Sidestep's own training.

It is what people write who want one problem learned fast: tables of one map instead of an environment, one compiled
program, NumPy for what happens once, no library beside JAX, and a ring of five numbers a transition. It learns the same
walks from the same rewards as Sidestep's level ``position``.

    python plain_jax.py learn MAP.npz                          # until a greedy walk is within 1 % of the best
    python plain_jax.py step MAP.npz --prioritised             # µs of a step with its gradient step, paper sizes

``learn`` and ``step`` print one line of JSON and import nothing but JAX and NumPy. ``learn`` has one-hot crossings,
γ = 1, double Q-learning, Adam; ``step`` has the paper's two inputs, dueling heads, RMSProp, one walker, batch 32.
"""

import argparse
import json
import os
import resource
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

IMPORTED = time.time()


@dataclass(frozen=True)
class Settings:
    """How to learn; static, so that each is a constant of the compiled program."""

    walkers: int
    batch: int
    capacity: int
    gamma: float
    one_hot: bool
    double: bool
    dueling: bool
    prioritised: bool
    beta: float
    unit: float
    updates: int
    epsilon: tuple[float, float]
    """At the beginning, and from ``epsilon_share`` of the updates on."""
    epsilon_share: float
    rate: tuple[float, float]
    """Of learning, at the beginning and at the end."""
    rule: str
    target_period: int
    target_rate: float
    anywhere: float
    """Share of the updates in which walks begin anywhere."""
    hidden: tuple[int, ...] = (50, 50)
    alpha: float = 0.6
    floor: float = 0.01

    @property
    def fanout(self) -> int:
        """Children of a node of the sum tree, which has three levels."""
        return int(np.ceil(round(self.capacity ** (1 / 3), 6)))


# --- The map --------------------------------------------------------------------------------------------------------


def read(path: Path) -> tuple[dict[str, Any], float]:
    """The tables of one map from what ``Problem.save`` of problem.py wrote, and the minutes of its best walk."""
    with np.load(path) as file:
        given = {name: file[name] for name in file.files}
    position, speed = given["position"], np.asarray(given["speed"], np.float32)
    speed = speed if speed.ndim == 3 else speed[None]  # [future, segment, slot]
    ahead = np.cumsum(speed.astype(float) * given["slot_seconds"], axis=2)
    weights = [given[name] for name in ("unit_seconds", "progress", "bonus")]
    tables = {
        "exit_node": given["exit_node"].astype(np.int32),
        "exit_segment": given["exit_segment"].astype(np.int32),
        "valid": given["exit_node"] >= 0,
        "length": given["length"],
        "scaled": (position - position.min(axis=0)) / np.ptp(position, axis=0),
        "far": np.linalg.norm(position - position[given["destination"]], axis=1),
        "speed": speed,
        "covered": np.concatenate([np.zeros_like(ahead[:, :, :1]), ahead[:, :, :-1]], axis=2),
        "origin": given["origin"].astype(np.int32),
        "destination": given["destination"].astype(np.int32),
        "slot_seconds": given["slot_seconds"],
        "horizon": given["horizon"],
        "weights": np.array(weights),
    }
    as_float32 = {name: table.astype(np.float32) for name, table in tables.items() if table.dtype == np.float64}
    return tables | as_float32, float(given["optimum"])


def crossing(speed: Any, covered: Any, length: Any, clock: Any, slot_seconds: Any) -> Any:
    """Seconds to cross a street through the slots that it takes, each at its own speed."""
    last = speed.shape[0] - 1
    now = jnp.clip((clock / slot_seconds).astype(jnp.int32), 0, last)
    end = covered[now] + speed[now] * (clock - now * slot_seconds) + length
    then = jnp.clip(jnp.sum(covered <= end) - 1, now, last)
    return then * slot_seconds + (end - covered[then]) / speed[then] - clock


def step_walker(tables: Any, state: Any, action: Any) -> tuple[Any, Any, Any, Any]:
    """One walker to the next crossing; its state there, the reward, and whether it arrived, or is out of time."""
    node, clock, future = state
    segment, onto = tables["exit_segment"][node, action], tables["exit_node"][node, action]
    row = (tables[name][future, segment] for name in ("speed", "covered"))
    seconds = crossing(*row, tables["length"][segment], clock, tables["slot_seconds"])
    unit, progress, bonus = tables["weights"]
    arrived = onto == tables["destination"]
    reward = progress * (tables["far"][node] - tables["far"][onto]) - seconds / unit + bonus * arrived
    return (onto, clock + seconds, future), reward, arrived, ~arrived & (clock + seconds >= tables["horizon"])


# --- The network ----------------------------------------------------------------------------------------------------


def initial(settings: Settings, tables: dict[str, Any], seed: int) -> Any:
    """Weights and biases uniform in ±1/√inputs."""
    rng, exits = np.random.default_rng(seed), tables["exit_node"].shape[1]
    widths = (tables["inputs"].shape[1], *settings.hidden, exits + settings.dueling)
    drawn = [(rng.uniform(-1, 1, (o, i + 1)) / np.sqrt(i)).astype(np.float32) for i, o in pairwise(widths)]
    return [(layer[:, 1:].copy(), layer[:, 0].copy()) for layer in drawn]


def q_values(settings: Settings, params: Any, inputs: Any, valid: Any) -> Any:
    """Q of every exit of one crossing; those of exits that do not exist are minus infinity."""
    *hidden, last = params
    features = inputs
    for weight, bias in hidden:
        features = jax.nn.relu(weight @ features + bias)
    values = last[0] @ features + last[1]
    if settings.dueling:
        advantage = values[1:]
        values = values[0] + advantage - jnp.sum(advantage, where=valid) / jnp.sum(valid)
    return jnp.where(valid, settings.unit * values, -jnp.inf)


def descend(settings: Settings, params: Any, moments: Any, gradient: Any, count: Any) -> tuple[Any, Any]:
    """A step of Adam or RMSProp."""
    first, last = settings.rate
    rate = first + (last - first) * jnp.minimum(count / settings.updates, 1.0)
    if settings.rule == "rmsprop":
        moments = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g * g, moments, gradient)
        change = jax.tree.map(lambda m, g: g / (jnp.sqrt(m) + 1e-10), moments, gradient)
    else:
        mean, square = moments
        mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, mean, gradient)
        square = jax.tree.map(lambda m, g: 0.999 * m + 0.001 * g * g, square, gradient)
        one, two = 1 - 0.9 ** (count + 1.0), 1 - 0.999 ** (count + 1.0)
        change = jax.tree.map(lambda m, s: (m / one) / (jnp.sqrt(s / two) + 1e-8), mean, square)
        moments = (mean, square)
    return jax.tree.map(lambda p, c: p - rate * c, params, change), moments


# --- Replay: a ring of five numbers a transition, and a sum tree of three levels ------------------------------------


def tree_set(tree: Any, leaf: Any, value: Any) -> Any:
    """Give leaves new values, and their ancestors new sums."""
    levels, fanout = list(tree), tree[-1].shape[1]
    for depth in (2, 1, 0):
        block, child = leaf // fanout, leaf % fanout
        levels[depth] = levels[depth].at[block, child].set(value)
        leaf, value = block, jnp.sum(levels[depth][block], axis=1)
    return tuple(levels)


def tree_find(tree: Any, uniform: Any) -> tuple[Any, Any]:
    """Leaves in proportion to their values, one from each of equal strata of the total, and their shares."""
    fanout, count = tree[-1].shape[1], uniform.shape[0]
    ones = jnp.triu(jnp.ones((fanout, fanout)))  # a product is faster than a cumulative sum
    total = jnp.sum(tree[0])
    mass, block = (jnp.arange(count) + uniform) / count * total, jnp.zeros(count, jnp.int32)
    for level in tree:
        rows = level[block]
        up_to = rows @ ones
        mass = jnp.minimum(mass, up_to[:, -1] * (1 - 1e-6))
        child = jnp.argmax(up_to > mass[:, None], axis=1).astype(jnp.int32)
        here = jnp.take_along_axis(rows, child[:, None], 1)[:, 0]
        mass = mass - (jnp.take_along_axis(up_to, child[:, None], 1)[:, 0] - here)
        block = block * fanout + child
    return block, here / total


# --- Training -------------------------------------------------------------------------------------------------------


def iterate(settings: Settings, tables: Any, carry: Any, draws: Any) -> tuple[Any, Any]:
    """A step of every walker, and a gradient step."""
    params, target, moments, ring, tree, highest, walkers, count = carry
    walker_draws, batch_draws = draws[: -settings.batch].reshape(settings.walkers, 4), draws[-settings.batch :]
    started, ended = settings.epsilon
    fallen = jnp.minimum(count / (settings.updates * settings.epsilon_share), 1.0)
    epsilon = started + fallen * (ended - started)
    nodes, futures = tables["far"].shape[0], tables["speed"].shape[0]

    def act(state: Any, draw: Any) -> tuple[Any, Any]:
        valid = tables["valid"][state[0]]
        greedy = jnp.argmax(q_values(settings, params, tables["inputs"][state[0]], valid))
        number = jnp.minimum((draw[1] * jnp.sum(valid)).astype(jnp.int32), jnp.sum(valid) - 1)
        action = jnp.where(draw[0] < epsilon, jnp.argmax(jnp.cumsum(valid) > number), greedy)
        after, reward, arrived, out_of_time = step_walker(tables, state, action)
        row = jnp.stack([state[0], action, reward, settings.gamma * (1.0 - arrived), after[0]])
        anywhere = (draw[2] * (nodes - 1)).astype(jnp.int32)
        anywhere += anywhere >= tables["destination"]
        origin = jnp.where(count < settings.anywhere * settings.updates, anywhere, tables["origin"])
        begun = (origin, jnp.float32(0), (draw[3] * futures).astype(jnp.int32))
        return jax.tree.map(partial(jnp.where, arrived | out_of_time), begun, after), row

    walkers, rows = jax.vmap(act)(walkers, walker_draws)
    first = count * settings.walkers % settings.capacity
    ring = jax.lax.dynamic_update_slice_in_dim(ring, rows, first, 0)
    size = jnp.minimum((count + 1) * settings.walkers, settings.capacity)
    if settings.prioritised:
        tree = tree_set(tree, first + jnp.arange(settings.walkers), jnp.broadcast_to(highest, settings.walkers))
        place, share = tree_find(tree, batch_draws)
        weight = (size * share) ** -settings.beta
        weight = weight / jnp.max(weight)
    else:
        place, weight = (batch_draws * size).astype(jnp.int32), 1.0
    batch = ring[place]
    node, action, onto = (batch[:, column].astype(jnp.int32) for column in (0, 1, 4))
    inputs, valid = tables["inputs"], tables["valid"]

    q = jax.vmap(partial(q_values, settings), in_axes=(None, 0, 0))
    after = q(target, inputs[onto], valid[onto])
    if settings.double:
        chosen = jnp.argmax(q(params, inputs[onto], valid[onto]), axis=1)
        value = jnp.take_along_axis(after, chosen[:, None], 1)[:, 0]
    else:
        value = jnp.max(after, axis=1)
    aim = batch[:, 2] + batch[:, 3] * value

    def loss(params: Any) -> tuple[Any, Any]:
        values = q(params, inputs[node], valid[node])
        error = aim - jnp.sum(jnp.where(jnp.arange(values.shape[1]) == action[:, None], values, 0.0), axis=1)
        return jnp.mean(weight * error**2), error

    gradient, error = jax.grad(loss, has_aux=True)(params)
    if settings.prioritised:
        priority = (jnp.abs(error) + settings.floor) ** settings.alpha
        highest, tree = jnp.maximum(highest, jnp.max(priority)), tree_set(tree, place, priority)
    params, moments = descend(settings, params, moments, gradient, count)
    move = settings.target_rate * ((count + 1) % settings.target_period == 0)
    target = jax.tree.map(lambda new, old: old + move * (new - old), params, target)
    return (params, target, moments, ring, tree, highest, walkers, count + 1), None


def several(settings: Settings, length: int, tables: Any, carry: Any, seed: Any) -> tuple[Any, Any]:
    """Iterate, then walk greedily from corner to corner; its minutes."""
    key = jax.random.fold_in(jax.random.key(seed), carry[-1])
    draws = jax.random.uniform(key, (length, settings.walkers * 4 + settings.batch))
    carry, _ = jax.lax.scan(partial(iterate, settings, tables), carry, draws)

    def onward(state: Any) -> Any:
        walker, _ = state
        node = walker[0]
        action = jnp.argmax(q_values(settings, carry[0], tables["inputs"][node], tables["valid"][node]))
        after, _, arrived, out_of_time = step_walker(tables, walker, action)
        return after, arrived | out_of_time

    begun = (tables["origin"], jnp.float32(0), jnp.int32(0))
    end, _ = jax.lax.while_loop(lambda state: ~state[1], onward, (begun, jnp.bool_(False)))
    return carry, end[1] / 60


def begin(settings: Settings, tables: dict[str, Any], seed: int) -> tuple[Any, Any]:
    """Tables with the network's inputs, and the state to begin with, in NumPy: nothing is compiled for them."""
    scaled = tables["scaled"]
    side = round(len(scaled) ** 0.5)
    inputs = np.hstack([scaled * 2 - 1, np.eye(len(scaled))]) if settings.one_hot else scaled * (side - 1)
    tables = tables | {"inputs": inputs.astype(np.float32)}
    params, fanout = initial(settings, tables, seed), settings.fanout
    zeros = jax.tree.map(np.zeros_like, params)
    tree = tuple(np.zeros((fanout**depth, fanout), np.float32) for depth in range(3)) if settings.prioritised else ()
    origins = np.full(settings.walkers, tables["origin"])
    if settings.anywhere:
        others = np.setdiff1d(np.arange(len(scaled)), [tables["destination"]])
        origins = np.random.default_rng(seed).choice(others, settings.walkers).astype(np.int32)
    carry = (
        params,
        jax.tree.map(np.copy, params),
        (zeros, jax.tree.map(np.copy, zeros)) if settings.rule == "adam" else zeros,
        np.zeros((settings.capacity, 5), np.float32),
        tree,
        np.float32(1),
        (origins, np.zeros(settings.walkers, np.float32), np.zeros(settings.walkers, np.int32)),
        np.int32(0),
    )
    return tables, carry


_compiled: dict[tuple[Any, ...], Any] = {}


def rounds(settings: Settings, tables: dict[str, Any], seed: int, length: int) -> Iterator[tuple[int, float]]:
    """Yield for every ``length`` updates their number so far and the minutes of the greedy walk.

    Before, it compiles what it needs, unless that was compiled for a map of this size.
    """
    tables, carry = begin(settings, tables, seed)
    same = settings, length, *((name, table.shape) for name, table in tables.items())
    if same not in _compiled:  # maps of one size share it
        one_round = jax.jit(partial(several, settings, length), donate_argnums=1)
        _compiled[same] = one_round.lower(tables, carry, seed).compile()
    tables = jax.device_put(tables)
    yield 0, np.inf
    while True:
        carry, minutes = _compiled[same](tables, carry, seed)
        yield int(carry[-1]), float(minutes)


def learn(settings: Settings, path: Path, seed: int, length: int, within: float) -> dict[str, Any]:
    """Learn until a greedy walk takes at most ``within`` times the best one's minutes, or all updates are done."""
    tables, best = read(path)
    began, compiled = time.time(), 0.0
    for updates, minutes in rounds(settings, tables, seed, length):
        compiled = compiled or time.time()
        if minutes <= within * best or updates >= settings.updates:
            break
    ended = time.time()
    return {
        "reached": minutes <= within * best,
        "seconds": ended - process_start(),
        "imports_seconds": began - process_start(),
        "compile_seconds": compiled - began,
        "learn_seconds": ended - compiled,
        "updates": updates,
        "transitions": updates * settings.walkers,
        "updates_per_second": updates / (ended - compiled),
        "transitions_per_second": updates * settings.walkers / (ended - compiled),
        "minutes": minutes,
        "best_minutes": best,
    }


def measure(settings: Settings, path: Path, seed: int, length: int, repeats: int) -> dict[str, Any]:
    """Microseconds of a step with its gradient step, wall and processor time: the least of some repeats, and each."""
    each = rounds(settings, read(path)[0], seed, length)
    next(each), next(each)
    wall, processor = [], []
    for _ in range(repeats):
        began = time.perf_counter(), time.process_time()
        next(each)
        wall.append(1e6 * (time.perf_counter() - began[0]) / length)
        processor.append(1e6 * (time.process_time() - began[1]) / length)
    return {"microseconds": min(wall), "processor_microseconds": min(processor), "wall": wall, "processor": processor}


def process_start() -> float:
    """When this process was started, by the system's clock, s; where the system does not tell, the first import."""
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        uptime = float(Path("/proc/uptime").read_text().split()[0])
    except OSError:
        return IMPORTED
    return time.time() - uptime + ticks / os.sysconf("SC_CLK_TCK")


LEARN = Settings(
    walkers=64, batch=256, capacity=51_200, gamma=1.0, one_hot=True, double=True, dueling=False, prioritised=False,
    beta=1.0, unit=10.0, updates=1_000, epsilon=(1.0, 0.05), epsilon_share=0.3, rate=(3e-3, 0.0), rule="adam",
    target_period=1, target_rate=0.05, anywhere=0.5,
)  # fmt: skip
PAPER = Settings(
    walkers=1, batch=32, capacity=10_000, gamma=0.95, one_hot=False, double=False, dueling=True, prioritised=False,
    beta=0.4, unit=1.0, updates=50_000, epsilon=(0.1, 0.1), epsilon_share=1.0, rate=(1e-4, 1e-4), rule="rmsprop",
    target_period=200, target_rate=1.0, anywhere=0.0,
)  # fmt: skip


def main() -> None:
    """Read the command line, and print one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    helps = {
        "learn": "learn until a greedy walk is good enough",
        "step": "time of a step with its gradient step, at the paper's sizes",
    }
    for name, said in helps.items():
        command = commands.add_parser(name, help=said)
        command.add_argument("map", type=Path, help="what Problem.save of problem.py wrote, .npz")
        command.add_argument("--seed", type=int, default=0)
        command.add_argument("--prioritised", action="store_true", help="prioritised replay; without, uniform")
        command.add_argument("--dueling", action=argparse.BooleanOptionalAction, help="as usual: step has it")
        command.add_argument("--walkers", type=int)
        command.add_argument("--batch", type=int)
        command.add_argument("--updates", type=int, help="gradient steps in all, over which ε and rates fall")
        if name == "learn":
            command.add_argument("--every", type=int, default=20, help="updates between greedy walks")
            command.add_argument("--within", type=float, default=1.01, help="times the minutes of the best walk")
        else:
            command.add_argument("--every", type=int, default=10_000, help="steps in one call")
            command.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    names = ("prioritised", "dueling", "walkers", "batch", "updates")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    settings = replace(LEARN if options.command == "learn" else PAPER, **given)
    if options.command == "learn":
        found = learn(settings, options.map, options.seed, options.every, options.within)
    else:
        found = measure(settings, options.map, options.seed, options.every, options.repeats)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(found | {"peak_mb": round(peak), "jax": jax.__version__, "settings": asdict(settings)}))


if __name__ == "__main__":
    main()
