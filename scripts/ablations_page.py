"""Train with one thing changed at a time, compare, and write docs/ablations.md.

Usage: python scripts/ablations_page.py FOLDER

Models and comparisons that are in FOLDER already are not made again.
"""

import json
import subprocess
import sys
from pathlib import Path

from sidestep.agent.presets import preset
from sidestep.evaluation.compare import compare
from sidestep.evaluation.metrics import percent
from sidestep.files import write_text
from sidestep.planners.registry import choose_planners
from sidestep.scenarios.builtin import BUILT_IN

DOCS = Path(__file__).parents[1] / "docs"
SCENARIO = "rush-16"
LEVELS = {"local": "greedy-local", "map": "greedy-map"}  # and the planner that an untrained agent is
AT_MAP = ("default", "no-dueling", "prioritised", "one-step")  # what is tried there
VARIANTS: dict[str, tuple[str, ...]] = {
    "default": (),
    "no-dueling": ("--no-dueling",),
    "no-double": ("--no-double",),
    "prioritised": ("--alpha", "0.6"),
    "one-step": ("--n-step", "1"),
    "six-steps": ("--n-step", "6"),
    "no-potential": ("--no-potential",),
    "gamma-0.99": ("--gamma", "0.99"),
    "dqn": ("--preset", "dqn"),
}
PAGE = """# Ablations

```sh
python scripts/ablations_page.py ablations   # trains {models} agents in the folder ablations/, writes this page
```

One thing changed at a time, on `rush-16` (map 0, seed 0): the agents walk the same {walks} held-out walks, corner to
corner; *over* are paired differences in minutes with 95 % intervals, below zero where faster. The intervals cover the
walks; each agent was trained once. Settings were chosen on this map; [levels.md](levels.md) judges them on another.

- `default`: n-step returns of {steps}, dueling, double, uniform replay, Q as a correction to the level's estimate.
- `no-potential`: Q is learned from nothing (`--no-potential`); the estimate remains one of the inputs.
- `dqn`: no dueling heads, no double Q-learning, uniform replay (`--preset dqn`).

What it shows, on this one map: dueling heads, double Q-learning and priorities make no difference that
these walks could tell from chance, and plain `dqn` does as well. Returns of six steps cost half a minute at level `local`,
where exploration spoils them. Beginning from the level's estimate and not discounting may be worth 0.2 minutes each. What
carries the agents is what they see and how they score it, street by street. At level `map` hardly any agent is told from
the untrained one here; on the map of levels.md the default gains more than a minute.
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
            options = " ".join(VARIANTS.get(name.removeprefix("darp-"), ())) if name.startswith("darp") else ""
            page += f"| {name} | {options and f'`{options}`'} | {row['minutes']:.1f} | "
            page += " | ".join(f"{each[0]:+.2f} | {each[1]:+.2f} to {each[2]:+.2f}" for each in row["over"])
            page += f" | {percent(row['gap'], 2)} |\n"
    first = results["local"]
    steps = " and ".join(f"{results[level]['steps']} at level `{level}`" for level in LEVELS)
    models = sum(name.startswith("darp") for found in results.values() for name in found["planners"])
    head = PAGE.format(models=models, walks=first["walks"], steps=steps)
    write_text(DOCS / "ablations.md", head + page)


def run(folder: Path, level: str, untrained: str) -> dict[str, object]:
    """One level: all variants in one comparison."""
    models, steps = [], 0
    default = preset("default", level).n_step  # type: ignore[arg-type]
    for name, options in VARIANTS.items():
        if options == ("--n-step", str(default)) or (level == "map" and name not in AT_MAP):
            continue
        model = folder / level / name
        if not (model / "trained.json").exists():
            command = [sys.executable, "-m", "sidestep", "train", SCENARIO, "--level", level, *options]
            done = subprocess.run([*command, "--out", str(model), "--json"], check=True, capture_output=True, text=True)
            write_text(model / "trained.json", done.stdout)
        if name == "default":
            steps = json.loads((model / "trained.json").read_text(encoding="utf-8"))["config"]["n_step"]
        models.append(model)
    problem = BUILT_IN[SCENARIO]
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
    return {"walks": problem.walks, "steps": steps, "planners": planners}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
