"""Geng, Liu, Wang, Liu: Deep Reinforcement Learning Based Dynamic Route Planning for Minimizing Travel Time (2020).

Draws the paper's two figures (unblocked and congested streets) and sets its numbers beside ours. Each map is 5 x 5
blocks with lengths U(100 m, 1 km) and volumes U(200, 1000); in the congested condition the segments at four nodes hold
N(5000, √1000) people instead. Walks go from corner to corner and depart at clock 0.

Both conditions are run with two kinds of flow: ``arima`` draws the model's noise for every walk, so that nobody knows
the crowds beforehand; ``forecast`` uses the model's predictions alone, which is what the paper's text describes.

Deviations from the paper, and what it leaves open:

- Reward and objective (eqs. 13 and 14) use d/(x0 ρ), which is faster the more crowded it is. We use eq. 4,
  c = d^0.2 p^0.8 / x0.
- w_r (φ(t) - φ(t-1)) rewards walking away from the destination. We use w_r (φ(t-1) - φ(t)).
- The indicator of arriving is on s_t; ours is paid by the step that arrives.
- Algorithm 1 swaps its branches. We bootstrap unless the episode terminated. A walk cut off at the horizon is
  truncated, not terminated, and bootstraps.
- RMSProp divides by g + σ (eq. 22). We divide by √g + σ, which is the standard non-centred form that the text names;
  its α is 0.9 and σ 1e-10 (TensorFlow 1.15's defaults).
- γ = 0.95 on costs that are summed up to the end makes walking to and fro on a cheap street for ever worth more than
  a long way to the destination. The ``paper`` preset keeps it and is reported with its arrival rate; ``default`` has
  γ = 1.
- The replay is called prioritised, but algorithm 1 samples a plain batch. We use proportional prioritisation (α = 0.6)
  with importance weights (β = 0.4 in the ``paper`` preset, 1 in ``default``) on a sum tree.
- Invalid actions: the paper chooses another. We mask them in behaviour, in the target's maximum and in the dueling
  mean, and the environment replaces them.
- Not given: ε (0.1, fixed), K (200 steps), the number of episodes (50 rounds of 1,000 steps), t_max (the horizon),
  origin and destination (opposite corners), σ and the ARIMA's d (0: only then can the step be changed exactly), how
  many nodes are crowded (4; never origin or destination).
- A "round" of training, never defined, is a fixed number of environment steps followed by 10 greedy walks.
- "Variance of 1000" is taken literally: the standard deviation is √1000.
- -67 and -75 have no unit. They are minutes: our maps give the same size.
- x = x0 ρ^-0.8 exceeds free speed for ρ < 1 and gives zero time without people. It is kept literally, with at least one
  person on a segment.
- Eq. 4 keeps the density of the moment of entry. Here the density follows the crossing (rule ``integrated``), without
  which leaving later could mean arriving earlier and no bound would be one. ``--rule entry`` gives the paper's.
- "Random selection" is run twice: ``random-walk`` over valid exits and ``random-progress``, a random path of fewest
  segments. Neither gives the 216 minutes that the paper's 65.3 % implies.
- A* is Dijkstra here: the result is the same, and on random lengths straight lines are no admissible heuristic.
- Shanghai Zoo's counts are not published. The model is fitted to 45 Queen Street, Auckland, 2024 (CC BY 4.0, Heart of
  the City): hourly ARIMA(1, 0, 0), changed exactly to slots of five minutes. Its unit, persons an hour at one sensor,
  is read as persons on a segment, as the paper must have done.
- "5 x 5 grid" with 36 nodes and 60 edges: 6 x 6 nodes, 60 streets, 120 directed segments, each with its own volume.
- The state is the position alone, though flows change, so no walker of this level can adapt on the way. The reference
  row ``expected`` is the best that can be planned beforehand.
- ``default`` is our own preset: the same dueling network and prioritised replay, told the crossing one-hot beside x
  and y, with double Q-learning, 64 walkers side by side, a larger replay, Adam, starts from anywhere in the first half,
  a thousand futures, steps in proportion to exp(Q / temperature), so that nearly equal paths are walked alike, and the
  mean network of the last quarter of rounds as its result.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from sidestep import plotting
from sidestep.agent.checkpoint import read_metadata
from sidestep.agent.presets import PRESETS
from sidestep.errors import SidestepError
from sidestep.evaluation.compare import Comparison, Results
from sidestep.evaluation.metrics import join_records
from sidestep.experiments import report
from sidestep.experiments.folders import study_folder
from sidestep.experiments.pool import Ended
from sidestep.experiments.study import Job, Study, make_study
from sidestep.experiments.sweep import Swept, machines, sweep_on
from sidestep.files import write_text
from sidestep.planners.learned import Darp
from sidestep.scenarios.model import Flows
from sidestep.walking.crossing_time import CrossingRule

CONDITIONS = {"unblocked": "paper-unblocked", "congested": "paper-congested"}
FLOWS: tuple[Flows, ...] = ("arima", "forecast")
PLANNERS = ("random-walk", "random-progress", "shortest-path", "expected", "clairvoyant")
"""The planners that the paper has, and those that bound it."""

LITERAL = "darp-paper"
"""The row of the ``paper`` preset."""

NAMES = {"darp-default": Darp.name, "darp-paper": LITERAL}
"""What the agents are called here, by what a sweep's tables call them."""

JOBS = "jobs"
"""Folder of the trainings and walks, within that of the results."""

LINES = ("clairvoyant", "expected", "shortest-path", "random-progress")
"""Planners that are level lines in the figures."""


@dataclass(frozen=True)
class Plan:
    """How much to run."""

    maps: int = 100
    """Number of maps in each condition."""

    rounds: int = PRESETS["default"].rounds
    """Rounds of training by the ``default`` preset, on each map."""

    literal_maps: int = 20
    """Number of maps, the first ones, that the ``paper`` preset learns: it takes 50,000 small steps on each."""

    literal_rounds: int = PRESETS["paper"].rounds
    """Rounds of training by the ``paper`` preset."""

    walks: int = 20
    """Number of walks on each map."""

    seed: int = 0

    def study(self, rule: CrossingRule) -> Study:
        """What is trained and walked; a :class:`StudyError` where that is more than a study may have."""
        learners = (("default", self.rounds, self.maps), ("paper", self.literal_rounds, self.literal_maps))
        grids = {
            preset: {"presets": preset, "settings": {"rounds": rounds}, "maps": tuple(range(min(maps, self.maps)))}
            for preset, rounds, maps in learners
        }
        common = {
            "scenarios": tuple(CONDITIONS.values()),
            "changes": {"flows": FLOWS, "rule": rule},
            "seeds": self.seed,
            "planners": PLANNERS,
            "walks": self.walks,
        }
        return make_study("reproduction", {**common, "grids": grids})


QUICK = Plan(maps=2, literal_maps=1, literal_rounds=5, walks=5)
"""A small run of everything."""


@dataclass(frozen=True)
class Reproduction:
    """All results, in the shape of ``results.json``."""

    compared: dict[str, Results]
    """By condition: ``unblocked``, ``congested``, ``unblocked_forecast`` and ``congested_forecast``."""

    claims: list[report.Claim]
    """What the paper says, and whether it holds."""

    curves: dict[str, dict[str, list[float]]]
    """Minutes of greedy test walks after every round, by condition and preset: means over maps."""

    def to_json(self) -> dict[str, object]:
        """Sum up in the shape of ``results.json``."""
        return {**self.compared, "claims": [asdict(claim) for claim in self.claims], "curves": self.curves}


def reproduce(
    plan: Plan,
    out: Path,
    workers: int,
    on_jobs: Callable[[int], Callable[[Ended], None]],
    rule: CrossingRule = "integrated",
    scheduler: str | None = None,
) -> Reproduction:
    """Run everything that is not done yet, and write ``results.json``, the figures and ``report.html``.

    Parameters
    ----------
    plan
        How much to run.
    out
        Folder to write to. What is trained and walked is in ``jobs`` there; once stopped, the same call goes on.
    workers, on_jobs, scheduler
        As for :func:`~sidestep.experiments.sweep.sweep`.
    rule
        How crossing times follow from densities.

    Returns
    -------
    Reproduction
        Everything that was written.

    Raises
    ------
    SidestepError
        A training or its walks failed, and all that a sweep refuses.
    """
    study, folder = plan.study(rule), out / JOBS
    with machines(workers, scheduler) as run:
        study_folder(out)
        swept = sweep_on(run, study, folder, on_jobs)
    for job, error in swept.failed.items():
        more = f" ({len(swept.failed)} jobs failed)" if len(swept.failed) > 1 else ""
        raise SidestepError(f"{folder / job}: {error}{more}; the same command tries again")
    compared: dict[str, Results] = {}
    learned: dict[str, dict[str, plotting.Curve]] = {}
    for flows, (name, scenario_name) in product(FLOWS, CONDITIONS.items()):
        key = name if flows == "arima" else f"{name}_{flows}"
        jobs = [job for job in study.jobs if (job.scenario.name, job.scenario.flows) == (scenario_name, flows)]
        compared[key] = _joined(swept.comparisons[jobs[0].problem]).to_json()
        learned[key] = _curves(jobs, swept, folder)
    pictures = {key: out / f"{key.replace('_', '-')}.png" for key in compared}
    for key, picture in pictures.items():
        _draw(key, compared[key], learned[key], picture)
    claims = report.claims(compared, plan.literal_rounds * PRESETS["paper"].round_steps)
    curves = {
        key: {name: curve.minutes.mean(axis=0).tolist() for name, curve in found.items()}
        for key, found in learned.items()
    }
    results = Reproduction(compared, claims, curves)
    write_text(out / "results.json", json.dumps(results.to_json(), indent=2) + "\n")
    write_text(out / "report.html", report.html(compared, claims, pictures))
    return results


def _joined(comparisons: list[Comparison]) -> Comparison:
    """One comparison of those on single maps."""
    maps = tuple(number for each in comparisons for number in each.map_numbers)
    records = {
        NAMES.get(name, name): join_records(
            [each.records[name] for each in comparisons if name in each.records], np.concatenate
        )
        for name in (*PLANNERS, *NAMES)
    }
    return replace(comparisons[0], map_numbers=maps, records=records)


def _curves(jobs: list[Job], swept: Swept, folder: Path) -> dict[str, plotting.Curve]:
    """The learning curves of both presets, from the trainings of one condition."""
    minutes: dict[str, list[np.ndarray]] = {name: [] for name in NAMES.values()}
    round_steps = {}
    for job in jobs:
        if job.agent is not None:
            name = NAMES[swept.labels[job.name]]
            minutes[name].append(np.asarray(read_metadata(folder / job.name).curve).mean(axis=1))
            round_steps[name] = job.agent.config.round_steps
    return {name: plotting.Curve(np.stack(found), round_steps[name]) for name, found in minutes.items()}


def _draw(key: str, compared: Results, curves: dict[str, plotting.Curve], path: Path) -> None:
    flows = "ARIMA noise" if compared["flows"] == "arima" else "forecast only"
    title = f"{key.partition('_')[0].capitalize()} streets ({flows}), {compared['maps']} maps"
    lines = {name: compared["planners"][name]["mean_minutes"] for name in LINES}
    plotting.save(plotting.learning_curves(title, curves, lines), path)
