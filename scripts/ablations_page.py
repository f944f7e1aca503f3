"""Train with one thing changed at a time, compare, and write docs/ablations.md.

Usage: python scripts/ablations_page.py FOLDER

Models and comparisons that are in FOLDER already are not made again.
"""

import json
import sys
from pathlib import Path
from typing import Any

from keep_models import trained

from sidestep.agent.presets import preset_for
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import percent
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN

DOCS = Path(__file__).parents[1] / "docs"
SCENARIO = "rush-16"
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

All agents walk the same {walks} held-out walks, corner to corner on `rush-16` (map 0, seed 0), at two
[levels of knowledge](levels.md). The columns *over* are paired differences in minutes with 95 % intervals, below zero
where faster; *over the clairvoyant* is the *gap*: how much longer the agent takes than the clairvoyant, in per cent. The
intervals cover the walks; each agent was trained once. Settings were chosen on this map, and [levels.md](levels.md)
judges them on another.

- `default`: n-step returns (n is {steps}), dueling, double, uniform replay, Q as a correction to the level's own estimate.
- `no-potential`: Q is learned from nothing (`--no-potential`); the estimate remains one of the inputs.
- `dqn`: no dueling heads, no double Q-learning, uniform replay (`--preset dqn`).

On this one map, dueling heads, double Q-learning and priorities make no difference that these walks could tell from
chance, and plain `dqn` does as well. Returns of six steps cost half a minute at level `local`, where exploration spoils
them. Starting from the level's estimate, and not discounting, may be worth 0.2 minutes each. What carries the agents is
what they observe, and that they score it segment by segment. At level `map` hardly any agent differs from the untrained
one here; on the map of levels.md the default gains more than a minute.
"""


def main(folder: Path) -> None:
    """Train, compare, write."""
    page, results = "", {}
    for level, untrained in LEVELS.items():
        target = folder / f"{level}.json"
        if not target.exists():
            write_text(target, json.dumps(run(folder, level, untrained), indent=2) + "\n")
        results[level] = json.loads(target.read_text(encoding="utf-8"))
        page += f"\n## Level `{level}`\n\n"
        page += f"| agent | options of `train` | minutes | over `expected` | 95 % | over `{untrained}` | 95 % | over the clairvoyant |\n"
        page += "|---|---|--:|--:|--:|--:|--:|--:|\n"
        for name, row in results[level]["planners"].items():
            option = VARIANTS.get(name.removeprefix("darp-"), ("",))[0]
            page += f"| {name} | {option and f'`{option}`'} | {row['minutes']:.1f} | "
            page += " | ".join(f"{each[0]:+.2f} | {each[1]:+.2f} to {each[2]:+.2f}" for each in row["over"])
            page += f" | {percent(row['gap'], 2)} |\n"
    first = results["local"]
    steps = " and ".join(f"{results[level]['steps']} at level `{level}`" for level in LEVELS)
    models = sum(name.startswith("darp") for found in results.values() for name in found["planners"])
    head = PAGE.format(models=models, walks=first["walks"], steps=steps)
    write_text(DOCS / "ablations.md", head + page)


def run(folder: Path, level: str, untrained: str) -> dict[str, Any]:
    """One level: all variants in one comparison."""
    problem, models = BUILT_IN[SCENARIO], []
    default = preset_for(problem, "default", level)  # type: ignore[arg-type]
    for name, (_, changes) in VARIANTS.items():
        config = default.changed(**changes)
        if (name != "default" and config == default) or (level == "map" and name not in AT_MAP):
            continue
        models.append(folder / level / name)
        trained(models[-1], problem, config, seed=0)
    chosen = choose_planners(problem, [untrained], models=models)
    compared = compare(problem, chosen.factories, maps=[0], walks=problem.walks)
    baselines = [compared.to_json(baseline=baseline)["planners"] for baseline in ("expected", untrained)]
    planners = {
        name: {
            "minutes": baselines[0][name]["mean_minutes"],
            "gap": baselines[0][name]["gap"],
            "over": [[rows[name]["difference_minutes"], *rows[name]["difference_ci95"]] for rows in baselines],
        }
        for name in chosen.factories
        if name.startswith("darp") or name in (untrained, "expected")
    }
    return {"walks": problem.walks, "steps": default.n_step, "planners": planners}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
