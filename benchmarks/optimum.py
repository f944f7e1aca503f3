"""How often a training does not end at the best plan, on many maps and with many random streams.

Several agents learn each map; they differ in nothing but the random stream of their training. All of them then walk
beside ``expected``, the best plan made beforehand, through the same crowds, which none of them met in training. A
training is off where its walks take more than 0.3 % longer in the mean. Where crowds come as forecast all walks are
alike, and one is enough.
"""

import argparse
import json
import multiprocessing
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from time import perf_counter

import jax
import numpy as np

from sidestep.agent.policy import deployed
from sidestep.agent.presets import PRESETS, preset_for
from sidestep.agent.train import training_rounds
from sidestep.cli.options import start_jax
from sidestep.evaluation.compare import compare
from sidestep.planners.learned import Darp
from sidestep.planners.registry import find_planner
from sidestep.scenarios.builtin import scenario
from sidestep.scenarios.maps import ScenarioMap, draw_map
from sidestep.scenarios.model import Scenario

OFF, FAR_OFF = 0.3, 1.0
"""Per cent that walks take longer than those of `expected`."""

HORIZON = 3 * 3600.0
"""Of the walks that judge, in s: the best take an hour, and futures that reach less far are drawn sooner."""

BEST = "expected"


@dataclass(frozen=True)
class Training:
    """One training, and how it ended."""

    seed: int
    index: int
    """Number of the map."""
    key: int
    """Random stream of the training on that map; 0 is that of `sidestep train`."""
    over: float
    """Per cent that walks take longer than those of `expected`; 1,000 and more where the agent never arrives."""
    seconds: float


def learned(preset: str, problem: Scenario, scenario_map: ScenarioMap) -> tuple[Darp, float]:
    """Train an agent on a map with the map's random stream, and say how many seconds it took."""
    config = preset_for(problem, preset)
    began = perf_counter()
    *_, (state, _) = training_rounds(config, problem, scenario_map)
    q_network = jax.block_until_ready(state.learner.q_network if config.keep == "last" else state.kept)
    seconds = perf_counter() - began
    return Darp(deployed(config, q_network, problem.reward.unit_seconds), np.zeros((0, 0))), seconds


def judged(preset: str, problem: Scenario, keys: int, walks: int, drawn: tuple[int, int]) -> list[Training]:
    """Train on one map with several random streams, and walk it beside the best plan."""
    seed, index = drawn
    here = draw_map(problem, seed, index)
    streams = [here.key, *(jax.random.fold_in(here.key, 1_000 + key) for key in range(1, keys))]
    agents = [learned(preset, problem, replace(here, key=stream)) for stream in streams]
    planners = {f"{key}": lambda *_, darp=darp: darp for key, (darp, _) in enumerate(agents)}
    walked = compare(
        problem.changed(horizon=HORIZON),
        planners | {BEST: lambda *_: find_planner(BEST)},
        maps=[index],
        walks=walks if problem.flows == "arima" else 1,
        seed=seed,
    ).records
    best = walked[BEST].minutes.mean()
    over = {name: 100 * (walked[name].minutes.mean() / best - 1) for name in planners}
    return [Training(seed, index, key, over[f"{key}"], seconds) for key, (_, seconds) in enumerate(agents)]


def summed_up(trainings: list[Training]) -> str:
    """Say how many trainings are off, and which is worst."""
    over = np.array([each.over for each in trainings])
    maps = {(each.seed, each.index) for each in trainings}
    worst = max(trainings, key=lambda each: each.over)
    return (
        f"{len(trainings)} trainings on {len(maps)} maps: {np.sum(over > OFF)} off, {np.sum(over > FAR_OFF)} by more "
        f"than {FAR_OFF:g} points; worst {worst.over:.2f} (seed {worst.seed}, map {worst.index}, key {worst.key}); "
        f"{np.median([each.seconds for each in trainings]):.2f} s a training"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="default", choices=[*PRESETS])
    parser.add_argument("--scenario", nargs="+", default=["paper-unblocked", "paper-congested"])
    parser.add_argument("--flows", nargs="+", default=["forecast", "arima"], choices=["forecast", "arima"])
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--maps", type=int, default=1, help="of each seed, from number 0 on")
    parser.add_argument("--keys", type=int, default=3, help="random streams of training on each map")
    parser.add_argument("--walks", type=int, default=2_000, help="that judge an agent where crowds have noise")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print every training")
    given = parser.parse_args()
    drawn = list(product(range(given.seed, given.seed + given.seeds), range(given.maps)))
    found: dict[str, list[Training]] = {}
    # Processes of their own: threads would share one interpreter, and small programs leave it little to wait for.
    with multiprocessing.get_context("spawn").Pool(given.processes, start_jax) as pool:
        for name, flows in product(given.scenario, given.flows):
            one = partial(judged, given.preset, scenario(name, flows=flows), given.keys, given.walks)
            trainings = [each for batch in pool.imap(one, drawn) for each in batch]
            found[f"{name}, {flows}"] = trainings
            if not given.json:
                print(f"{name}, {flows}: {summed_up(trainings)}", flush=True)
    if given.json:
        print(json.dumps({name: [asdict(each) for each in trainings] for name, trainings in found.items()}))


if __name__ == "__main__":
    main()
