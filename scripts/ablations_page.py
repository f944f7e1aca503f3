"""Train with one thing changed at a time, compare, and write docs/ablations.md.

Usage: python scripts/ablations_page.py FOLDER

The trainings are those of examples/studies/ablations.toml. What is in FOLDER already is not done again.
"""

import sys
from pathlib import Path
from typing import Any

from trainings import DOCS, SEEDS, SEEDS_IN_WORDS, swept

from sidestep.evaluation.metrics import percent
from sidestep.evaluation.trainings import mean_row
from sidestep.experiments.sweep import Swept
from sidestep.files import write_text

DEFAULT = "darp-default"
LEVELS = {"local": "greedy-local", "map": "greedy-map"}  # and the planner that an untrained agent is
OPTIONS = {  # of `train`, by variant
    "no-dueling": "--no-dueling",
    "no-double": "--no-double",
    "prioritised": "--alpha 0.6",
    "one-step": "--n-step 1",
    "six-steps": "--n-step 6",
    "no-potential": "--no-potential",
    "gamma-0.99": "--gamma 0.99",
    "dqn": "--preset dqn",
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
    found = swept("ablations", folder)
    page, models, steps = "", 0, []
    for level, untrained in LEVELS.items():
        jobs = {found.labels[job.name]: job.agent for job in found.study.jobs if job.agent is not None}
        agents = {label: agent for label, agent in jobs.items() if agent.config.level == level}
        plain = next(agent for agent in agents.values() if not agent.variant)
        steps.append(f"{plain.config.n_step} at level `{level}`")
        names = {label: f"darp-{agent.variant or 'default'}" for label, agent in agents.items()}
        page += f"\n## Level `{level}`\n\n{table(over(found, names, untrained))}"
        models += len(SEEDS) * len(agents)
    head = PAGE.format(
        models=models,
        walks=found.study.jobs[0].walks,
        steps=" and ".join(steps),
        seeds=SEEDS_IN_WORDS,
        freedom=len(SEEDS) - 1,
    )
    write_text(DOCS / "ablations.md", head + page)


def over(found: Swept, agents: dict[str, str], untrained: str) -> dict[str, list[dict[str, Any]]]:
    """The rows of a level's agents, under the page's names, for each seed, by what they are set against."""
    (comparisons,) = found.comparisons.values()
    shown = {"expected": "expected", untrained: untrained, **agents}
    rows: dict[str, list[dict[str, Any]]] = {}
    for baseline, said in ((label, name) for label, name in shown.items() if name in ("expected", DEFAULT)):
        results = [each.to_json(baseline=baseline)["planners"] for each in comparisons]
        rows[said] = [{name: planners[label] for label, name in shown.items()} for planners in results]
    return rows


def table(over: dict[str, list[dict[str, Any]]]) -> str:
    """One level: its agents and planners, against ``expected`` and ``darp-default``."""
    text = "| agent | options of `train` | minutes | over `expected` | 95 % | over the clairvoyant "
    text += "| over `darp-default` | 95 % | each seed |\n|---|---|--:|--:|--:|--:|--:|--:|--:|\n"
    for name in over["expected"][0]:
        option = OPTIONS.get(name.removeprefix("darp-"), "")
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


if __name__ == "__main__":
    main(Path(sys.argv[1]))
