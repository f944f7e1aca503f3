"""DQN of torchrl, with masks, in PyTorch: its collector, replay, loss and target update."""

import torch
from problem import Problem, Walkers
from protocol import OnCheck
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictSequential
from torchrl.collectors import Collector
from torchrl.data import Binary, Categorical, Composite, LazyTensorStorage, TensorDictReplayBuffer, Unbounded
from torchrl.envs import EnvBase
from torchrl.modules import MLP, EGreedyModule, QValueActor
from torchrl.objectives import DQNLoss, HardUpdate, SoftUpdate

PACKAGES = ("torchrl", "tensordict", "torch", "numpy")


class VecWalkers(EnvBase):
    """All walkers step in one call of NumPy."""

    def __init__(self, problem: Problem, seed: int) -> None:
        count, inputs = problem.task.walkers, problem.features.shape[1]
        super().__init__(device="cpu", batch_size=[count])
        self.walkers = Walkers(problem, seed)
        self.features, self.valid = torch.as_tensor(problem.features), torch.as_tensor(problem.valid)
        self.observation_spec = Composite(
            observation=Unbounded((count, inputs)),
            action_mask=Binary(problem.exits, shape=(count, problem.exits), dtype=torch.bool),
            shape=(count,),
        )
        self.action_spec = Categorical(problem.exits, shape=(count,))
        self.reward_spec = Unbounded((count, 1))
        over = {
            name: Categorical(2, shape=(count, 1), dtype=torch.bool) for name in ("done", "terminated", "truncated")
        }
        self.full_done_spec = Composite(**over, shape=(count,))

    def _reset(self, tensordict: TensorDictBase | None = None, **_: object) -> TensorDictBase:
        if tensordict is None or "_reset" not in tensordict:
            self.walkers.reset()
        return self.seen(self.walkers.node)  # those whose episode is over have begun another

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        there, reward, terminated, truncated, _ = self.walkers.step(tensordict["action"].numpy())
        found = self.seen(there)
        found["reward"] = torch.as_tensor(reward)[:, None]
        for name, over in (("terminated", terminated), ("truncated", truncated), ("done", terminated | truncated)):
            found[name] = torch.as_tensor(over)[:, None]
        return found

    def _set_seed(self, seed: int | None) -> None:
        """Walkers have theirs."""

    def seen(self, node: object) -> TensorDictBase:
        """What walkers see at crossings."""
        return TensorDict({"observation": self.features[node], "action_mask": self.valid[node]}, self.batch_size)


def learn(_algorithm: str, problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn with double DQN."""
    torch.set_num_threads(1)  # serves networks this small best
    torch.manual_seed(seed)
    task, walkers = problem.task, VecWalkers(problem, seed)
    one = task.walkers == 1
    network = MLP(problem.features.shape[1], problem.exits, num_cells=list(task.hidden), activation_class=torch.nn.ReLU)
    exits = Categorical(problem.exits)
    actor = QValueActor(network, in_keys=["observation"], spec=exits, action_mask_key="action_mask")
    start, end, fall = (0.1, 0.1, 1) if one else (1.0, 0.05, int(0.3 * task.transitions))
    explore = EGreedyModule(exits, start, end, fall, action_mask_key="action_mask")
    collector = Collector(
        walkers,
        TensorDictSequential(actor, explore),
        frames_per_batch=task.walkers,
        total_frames=task.transitions,
    )
    replay = TensorDictReplayBuffer(storage=LazyTensorStorage(task.replay), batch_size=task.batch)
    loss = DQNLoss(actor, action_space="categorical", double_dqn=not one, delay_value=True)
    loss.make_value_estimator(gamma=task.gamma)
    target = HardUpdate(loss, value_network_update_interval=200) if one else SoftUpdate(loss, tau=0.05)
    if one:
        optimiser = torch.optim.RMSprop(network.parameters(), lr=1e-4, alpha=0.9, eps=1e-10)
        rates = torch.optim.lr_scheduler.ConstantLR(optimiser, 1.0)
    else:
        optimiser = torch.optim.Adam(network.parameters(), lr=3e-3)
        rates = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 1e-3, task.iterations)
    done = updates = 0
    for steps in collector:
        replay.extend(steps.reshape(-1))
        explore.step(task.walkers)
        done += task.walkers
        if done >= task.batch:
            loss(replay.sample())["loss"].backward()
            optimiser.step()
            optimiser.zero_grad()
            rates.step()
            target.step()
            updates += 1
        if done % task.check_every == 0:
            with torch.no_grad():
                on_check(done, updates, problem.greedy(network(walkers.features).numpy()))
    collector.shutdown()
