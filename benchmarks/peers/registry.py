"""Who takes part, in which environment, and why others do not."""

from dataclasses import dataclass

PROJECT = "project"
"""The project's own environment."""
NEVER = "none"
"""The state of processes of peers that never compile."""
RUNNING = "running"
"""The state of processes that have learned another map before."""
MANY = 60_000
"""Steps at the paper's sizes of a peer whose whole training is compiled."""


@dataclass(frozen=True)
class Peer:
    """A learner of a library."""

    name: str
    environment: str
    """Its pinned requirements are ``requirements/NAME.txt``."""
    runner: str
    """Module of ``runners/``."""
    algorithm: str
    masks: bool
    """Whether it learns with the mask of exits that exist; all are judged with it."""
    jax: bool
    """Whether it compiles programs, which the next process may find again."""
    paper_steps: int = 3_000
    """Steps to measure at the paper's sizes; 0 for learners that do not make one gradient step a step."""

    @property
    def states(self) -> tuple[str, ...]:
        """States in which a map is learned, as far as they make a difference."""
        return ("cold", "warm", RUNNING) if self.jax else (NEVER, RUNNING)


SIDESTEP = Peer("Sidestep", PROJECT, "sidestep", "DARP", masks=True, jax=True, paper_steps=MANY)
PEERS = (
    SIDESTEP,
    Peer("plain JAX file, uniform replay", PROJECT, "plain_jax", "uniform", masks=True, jax=True, paper_steps=MANY),
    Peer("plain JAX file, prioritised", PROJECT, "plain_jax", "prioritised", masks=True, jax=True, paper_steps=MANY),
    Peer("plain PyTorch file", "plain-torch", "plain_torch", "DQN", masks=True, jax=False),
    Peer("tianshou DQN", "tianshou", "tianshou", "DQN", masks=True, jax=False),
    Peer("torchrl DQN", "torchrl", "torchrl", "DQN", masks=True, jax=False),
    Peer(
        "sb3-contrib MaskablePPO", "stable-baselines3", "stable_baselines3", "MaskablePPO",
        masks=True, jax=False, paper_steps=0,
    ),
    Peer("Stable-Baselines3 DQN", "stable-baselines3", "stable_baselines3", "DQN", masks=False, jax=False),
    Peer("sb3-contrib QR-DQN", "stable-baselines3", "stable_baselines3", "QRDQN", masks=False, jax=False),
    Peer("sbx DQN", "sbx", "sbx", "DQN", masks=False, jax=True),
    Peer("rejax DQN", "rejax", "rejax", "DQN", masks=False, jax=True, paper_steps=MANY),
    Peer("rejax IQN", "rejax", "rejax", "IQN", masks=False, jax=True),
    Peer("rejax PQN", "rejax", "rejax", "PQN", masks=False, jax=True, paper_steps=0),
)  # fmt: skip

ABSENT = {
    "CleanRL": "its releases on the package index need Python below 3.11; the two plain files are in its style",
    "Stoix, purejaxrl, purejaxql": "are not on the package index",
    "LeanRL": "the package `leanrl` on the index is something else",
}
"""Who is absent, and why."""
