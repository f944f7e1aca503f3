"""Write docs/reproduction.md and its pictures from the folder that `sidestep reproduce` filled.

Usage: python scripts/reproduction_page.py FOLDER
"""

import json
import shutil
import sys
from pathlib import Path

from sidestep.evaluation.metrics import markdown_table
from sidestep.experiments.paper import LITERAL
from sidestep.files import write_text

DOCS = Path(__file__).parents[1] / "docs"
TITLES = {
    "unblocked_forecast": "Unblocked streets, forecasts only (the paper's flows)",
    "congested_forecast": "Congested streets, forecasts only (the paper's flows)",
    "unblocked": "Unblocked streets, with the ARIMA model's noise",
    "congested": "Congested streets, with the ARIMA model's noise",
}
HEAD = """# The paper, reproduced

This page sets the paper's figures and numbers beside ours, and says which of its claims hold.

```sh
sidestep reproduce --maps {maps} --seed {seed} --out reproduction   # also writes report.html and results.json
python scripts/reproduction_page.py reproduction               # this page
```

{maps} maps in each condition, {walks} walks on each map. `darp` (the preset `default`) is trained anew on every map,
`darp-paper` (the paper's settings as printed) on the first {literal}. All planners walk the same maps through the same
crowds, which training never met. Minutes are means with 95 % bootstrap intervals over maps; a walk that does not arrive
counts as 24 hours. *Saved* is against `shortest-path`; *over the clairvoyant* is the distance to the lower bound, the
time of a planner that knows the future. `expected` is the best plan that can be made beforehand. The docstring of
[`experiments/paper.py`](../src/sidestep/experiments/paper.py) lists what we had to decide or correct.
[`benchmarks/optimum.py`](../benchmarks/README.md#optimumpy-does-a-training-end-at-the-best-plan) counts how often `darp` does
not end at the best plan.

The first command takes 3 minutes on two cores (176 s; 223 s where nothing has been compiled yet). `--workers` and `--scheduler` spread it as
a [sweep](sweeps.md), and `--quick` is a small run of everything.

## What holds

| the paper | here | verdict | why |
|---|---|---|---|
"""


def main(folder: Path) -> None:
    """Write the page."""
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    first = results["unblocked"]
    literal = first["planners"][LITERAL]["maps"]
    page = HEAD.format(maps=first["maps"], walks=first["walks"], seed=first["seed"], literal=literal)
    for claim in results["claims"]:
        page += f"| {claim['paper']} | {claim['ours']} | **{claim['verdict']}** | {claim['why']} |\n"
    (DOCS / "images").mkdir(exist_ok=True)
    for key, title in TITLES.items():
        page += f"\n## {title}\n\n" + markdown_table(results[key]["planners"], results[key]["maps"])
        picture = f"{key.replace('_', '-')}.png"
        shutil.copy(folder / picture, DOCS / "images" / picture)
        page += f"\n![Learning curves: {title}](images/{picture})\n"
    write_text(DOCS / "reproduction.md", page)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
