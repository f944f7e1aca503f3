"""Train with one thing changed at a time, compare, and write docs/ablations.md.

Usage: python scripts/ablations_page.py FOLDER

Models and comparisons that are in FOLDER already are not made again.
"""

import sys
from functools import partial
from pathlib import Path
from typing import Any

from trainings import DOCS, SEEDS, SEEDS_IN_WORDS, kept, trained

from sidestep.agent.presets import preset_for
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import percent
from sidestep.evaluation.trainings import mean_row
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN

SCENARIO = "rush-16"
DEFAULT = "darp-default"
LEVELS = {"local": "greedy-local", "map": "greedy-map"}  # and the planner that an untrained agent is
AT_MAP = ("default", "no-dueling", "prioritised", "one-step")  # what is tried there
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {  # the option of `train`, and the setting that it changes
    "default": ("", {}),
    "no-dueling": ("--no-dueling", {"dueling": False}),
    "no-double": ("--no-double", {"double": False}),
    "prioritised": ("--alpha 0.6", {"alpha": 0.6}),
    "one-step": ("--n-step 1", {"n_step": 1}),
    "six-steps": ("--n-step 6", {"n_step": 6}),
    "no-potential": ("--no-potential", {"potential": False}),
    "gamma-0.99": ("--gamma 0.99", {"gamma": 0.99}),
    "dqn": ("--preset dqn", {"dueling": False, "double": False, "alpha": 0.0}),
}
PAGE = """# Ablations

This page says what each part of the learning algorithm is worth, by leaving out or changing one at a time.

```sh
python scripts/ablations_page.py ablations   # trains {models} agents in the folder ablations/, writes this page
```

Each agent was trained three times, with seeds {seeds}, and walks {walks} held-out walks each time, corner to corner on the map
of that seed of `rush-16`, at two [levels of knowledge](levels.md). With a seed, all agents walk the same walks. Numbers are means
over the seeds. The columns over `expected` and over `darp-default` are paired differences in minutes, below zero where faster,
with 95 % intervals over the seeds (Student's, with {freedom} degrees of freedom); *over the clairvoyant* is the *gap*: how much
longer the agent takes than the clairvoyant, in per cent. The last column has the three differences from `darp-default`, one
for each seed; \\* where the 95 % interval over that seed's walks does not contain zero.

- `default`: n-step returns (n is {steps}), dueling, double, uniform replay, Q as a correction to the level's own estimate.
- `no-potential`: Q is learned from nothing (`--no-potential`); the estimate remains one of the inputs.
- `dqn`: no dueling heads, no double Q-learning, uniform replay (`--preset dqn`).

Dueling heads, double Q-learning and priorities make no difference that three trainings could tell from chance, and plain `dqn`
does as well. Returns of six steps cost half a minute at level `local`, where exploration spoils them. Starting from the level's
estimate, and not discounting, may be worth 0.2 minutes each. At level `map` training gains 0.9 minutes over the untrained walker
(`greedy-map`), and returns of one step do as well as those of six.
"""


def main(folder: Path) -> None:
    """Train, compare, write."""
    page, results = "", {}
    for level, untrained in LEVELS.items():
        results[level] = kept(folder / f"{level}.json", partial(run, folder, level, untrained))
        page += f"\n## Level `{level}`\n\n{table(results[level]['over'])}"
    walks, models = results["local"]["walks"], 0
    for found in results.values():
        models += len(SEEDS) * sum(name.startswith("darp") for name in found["over"]["expected"][0])
    steps = " and ".join(f"{results[level]['steps']} at level `{level}`" for level in LEVELS)
    head = PAGE.format(models=models, walks=walks, steps=steps, seeds=SEEDS_IN_WORDS, freedom=len(SEEDS) - 1)
    write_text(DOCS / "ablations.md", head + page)


def table(over: dict[str, list[dict[str, Any]]]) -> str:
    """One level: its agents and planners, against ``expected`` and ``darp-default``."""
    text = "| agent | options of `train` | minutes | over `expected` | 95 % | over the clairvoyant "
    text += "| over `darp-default` | 95 % | each seed |\n|---|---|--:|--:|--:|--:|--:|--:|--:|\n"
    for name in over["expected"][0]:
        option = VARIANTS.get(name.removeprefix("darp-"), ("",))[0]
        row, paired = (mean_row([found[name] for found in over[baseline]]) for baseline in ("expected", DEFAULT))
        text += (
            f"| {name} | {option and f'`{option}`'} | {row['mean_minutes']:.1f} | {row['difference_minutes']:+.2f} | "
        )
        text += "{:+.2f} to {:+.2f}".format(*row["difference_ci95"]) + f" | {percent(row['gap'], 2)} | "
        text += f"{paired['difference_minutes']:+.2f} | " + "{:+.2f} to {:+.2f}".format(*paired["difference_ci95"])
        text += f" | {', '.join(map(marked, [found[name] for found in over[DEFAULT]]))} |\n"
    return text


def marked(row: dict[str, Any]) -> str:
    """A difference, with a star where its interval over walks does not contain zero."""
    low, high = row["difference_ci95"]
    return f"{row['difference_minutes']:+.2f}{'' if low <= 0 <= high else '*'}"


def run(folder: Path, level: str, untrained: str) -> dict[str, Any]:
    """One level: all variants in one comparison for each seed; rows by what they are set against."""
    problem, over = BUILT_IN[SCENARIO], {"expected": [], DEFAULT: []}
    default = preset_for(problem, "default", level)  # type: ignore[arg-type]
    for seed in SEEDS:
        models = []
        for name, (_, changes) in VARIANTS.items():
            config = default.changed(**changes)
            if (name != "default" and config == default) or (level == "map" and name not in AT_MAP):
                continue
            models.append(folder / f"seed-{seed}" / level / name)
            trained(models[-1], problem, config, seed)
        chosen = choose_planners(problem, [untrained], models=models, seed=seed)
        compared = compare(problem, chosen.factories, maps=[0], walks=problem.walks, seed=seed)
        for baseline, rows in over.items():
            found = compared.to_json(baseline=baseline)["planners"]
            rows.append(
                {name: found[name] for name in found if name.startswith("darp") or name in (untrained, "expected")}
            )
    return {"walks": problem.walks, "steps": default.n_step, "over": over}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
