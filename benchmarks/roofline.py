"""How far environment steps and training iterations are from what this machine can do: operations, bytes and kernels.

Usage: python benchmarks/roofline.py [--cores N] [--json]

Operations are XLA's count of the program as written, kernels those of the compiled one. Bytes are those that have to
move: what the program is given and what it returns, but of tables and the replay only what is looked up and written.
Loops inside a step count once. JAX chooses the device; on a GPU give --cores all that compiling may use.
"""

import argparse
import json
import os
import re
import statistics
from dataclasses import replace
from functools import partial
from time import perf_counter, process_time

import steps

TURNS = 7
LARGE, CACHED = 2**26, 2**16
"""Numbers of four bytes in an array that no cache holds, and in one that the second level does."""
SIDE = 2_048
"""Of the matrices that are multiplied."""
WALKERS = 1_000
PRESETS = {"default": 2_560, "paper": 1_000}
"""Those that train on ``paper-congested``, and the environment steps of a round, test walks left out."""


def now():
    """The clock: on one core the processor's, on which other work does not count."""
    import jax

    return process_time() if jax.default_backend() == "cpu" and len(os.sched_getaffinity(0)) == 1 else perf_counter()


def seconds(run, *arguments, times=1):
    """Median time of one of so many repetitions inside a call, compiled before."""
    import jax

    jax.block_until_ready(run(*arguments))
    found = []
    for _ in range(TURNS):
        began = now()
        jax.block_until_ready(run(*arguments))
        found.append((now() - began) / times)
    return statistics.median(found)


def repeated(body, times):
    """A compiled loop."""
    import jax

    return jax.jit(lambda start: jax.lax.scan(lambda carry, _: (body(carry), None), start, None, length=times)[0])


def machine():
    """What the device can do: operations, bytes, and how long one kernel in a loop and one call from Python take."""
    import jax
    import jax.numpy as jnp

    def kernels(number):
        """A loop whose body is so many kernels, which shapes of their own keep apart; a large array keeps it a loop."""
        small = [jnp.zeros(16 + each) for each in range(number)]
        loop = repeated(lambda carry: (carry[0].at[carry[1]].set(1.0), carry[1] + 1, *_halved(carry[2:])), 1_000)
        return seconds(loop, (jnp.zeros(CACHED), jnp.int32(0), *small), times=1_000)

    square = jnp.full((SIDE, SIDE), 1e-3)
    product = seconds(repeated(lambda a: a @ square, 4), square, times=4)
    streamed = seconds(repeated(lambda a: a + 1.0, 8), jnp.zeros(LARGE), times=8)
    cached = seconds(repeated(lambda a: a + 1.0, 4_000), jnp.zeros(CACHED), times=4_000)
    return {
        "device": jax.devices()[0].device_kind,
        "gflop_s": 2 * SIDE**3 / product / 1e9,
        "stream_gb_s": 8 * LARGE / streamed / 1e9,
        "cached_gb_s": 8 * CACHED / cached / 1e9,
        "kernel_us": 1e6 * (kernels(60) - kernels(20)) / 40,
        "call_us": 1e6 * seconds(jax.jit(lambda a: a + 1.0), jnp.float32(0)),
    }


def _halved(arrays):
    return [each * 0.5 + 1.0 for each in arrays]


def counted(run, *arguments, moved):
    """Operations, bytes and kernels of one call of a function; ``moved`` are the arguments and results that count."""
    import jax

    lowered = jax.jit(run).lower(*arguments)
    inside = _outer(lowered.compile())
    looked_up = _looked_up(jax.make_jaxpr(run)(*arguments).jaxpr)
    return {
        "flop": lowered.cost_analysis()["flops"],
        "bytes": sum(leaf.nbytes for leaf in jax.tree.leaves(moved) if hasattr(leaf, "nbytes")) + looked_up,
        "kernels": len(re.findall(r" (?:fusion|dot|convolution|custom-call|copy|sort)\(", inside)),
    }


def _looked_up(jaxpr):
    """Bytes that are read from tables, or written into them."""
    from jax.extend.core import jaxprs_in_params

    total = 0
    for equation in jaxpr.eqns:
        name = equation.primitive.name
        if name in ("gather", "dynamic_slice"):
            total += _bytes(equation.outvars[0])
        elif name.startswith("scatter") or name == "dynamic_update_slice":
            total += _bytes(equation.invars[1 if name == "dynamic_update_slice" else 2])
        total += sum(map(_looked_up, jaxprs_in_params(equation.params)))
    return total


def _bytes(variable):
    return variable.aval.size * variable.aval.dtype.itemsize


def _outer(compiled):
    """The text of a program without the insides of its fused kernels."""
    text = compiled.as_text()
    return "\n".join(part for part in text.split("\n\n") if not re.match(r"%(fused|wrapped)", part))


def environment_steps(params, walks):
    """Counts and time of a step of all walkers."""
    import jax
    import jax.numpy as jnp

    from sidestep.environment.dynamics import step
    from sidestep.environment.observation import observe

    def one(params, state, number):
        after, outcome = step(params, state, number)
        return after, observe(params, after), outcome.reward, outcome.terminated, outcome.truncated

    run, walking, _ = steps.stepping(params, walks, WALKERS)
    every, exits = jax.vmap(one, (None, 0, 0)), jnp.zeros(WALKERS, jnp.int32)
    moved = walking[0], exits, jax.eval_shape(every, params, walking[0], exits)
    counts = counted(every, params, walking[0], exits, moved=_sized(moved))
    return counts | {"seconds": seconds(run, walking, jax.random.key(0), times=steps.STEPS)}


def _sized(tree):
    """Arrays for shapes, so that they have sizes."""
    import jax
    import numpy as np

    return jax.tree.map(lambda leaf: np.empty(leaf.shape, leaf.dtype), tree)


def training_iteration(name):
    """Counts and time of a step of all walkers with its gradient step, on ``paper-congested``."""
    import jax
    import jax.numpy as jnp

    from sidestep.agent.acting import ACTING_DRAWS
    from sidestep.agent.presets import preset
    from sidestep.agent.train import _between_moves, _iterate, prepare, train_round, uniform_draws
    from sidestep.scenarios.builtin import scenario
    from sidestep.scenarios.maps import draw_map

    problem = scenario("paper-congested")
    config = preset(name)
    where, _, state = prepare(config, problem, draw_map(problem, 0), uniform_draws(config, [0], 0, start=True))
    draws = jnp.zeros(config.walkers * ACTING_DRAWS + config.batch)
    moved = replace(state, replay=None, kept=None)
    if config.span == 1:
        iteration, draws = partial(_between_moves, config, where), draws[None]
    else:  # the target network seldom moves
        iteration = partial(_iterate, config, where, where.evaluated(config, state.learner.target))
    counts = counted(iteration, state, draws, moved=(moved, moved, draws))
    times = []
    for rounds in (1, 5):  # the difference leaves out the test walks
        longer = config.changed(round_steps=rounds * PRESETS[name])
        of_round = uniform_draws(longer, [0], 0)
        train_round.prepare(longer, where, state, of_round)
        found = []
        for _ in range(TURNS):
            copied = jax.block_until_ready(jax.tree.map(jnp.copy, state))
            began = now()
            jax.block_until_ready(train_round(longer, where, copied, of_round))
            found.append(now() - began)
        times.append(statistics.median(found))
    return counts | {"seconds": (times[1] - times[0]) / (4 * PRESETS[name] / config.walkers)}


def beside(limits, counts):
    """Counts with the times that operations, bytes and kernels would take alone."""
    least = {
        "flop_us": counts["flop"] / limits["gflop_s"] / 1e3,
        "stream_us": counts["bytes"] / limits["stream_gb_s"] / 1e3,
        "cached_us": counts["bytes"] / limits["cached_gb_s"] / 1e3,
        "kernels_us": counts["kernels"] * limits["kernel_us"],
    }
    return counts | least | {"measured_us": 1e6 * counts["seconds"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    steps.on_cores(options.cores)
    limits = machine()
    rows = {}
    for name in ("paper-congested", "rush-16"):
        params, walks = steps.environment(name, WALKERS)
        for level in steps.LEVELS[name]:
            counts = environment_steps(replace(params, level=level), walks)
            rows[f"{WALKERS:,} steps, {name}, {level}"] = beside(limits, counts)
    for name in PRESETS:
        rows[f"iteration of {name}"] = beside(limits, training_iteration(name))
    if options.json:
        print(json.dumps({"machine": limits, "programs": rows}, indent=2))
        return
    print(", ".join(f"{key} {value:.3g}" if key != "device" else value for key, value in limits.items()))
    columns = ("flop", "bytes", "kernels", "flop_us", "stream_us", "cached_us", "kernels_us", "measured_us")
    print(f"{'':38}" + "".join(f"{column:>12}" for column in columns))
    for name, row in rows.items():
        print(f"{name:38}" + "".join(f"{row[column]:12,.5g}" for column in columns))


if __name__ == "__main__":
    main()
