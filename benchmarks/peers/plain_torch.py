"""A masked double DQN in one file of PyTorch, in the style of CleanRL: everything that happens stands in one loop."""

from itertools import pairwise

import numpy as np
import torch
from problem import Problem, Walkers
from protocol import OnCheck
from torch import nn
from torch.nn.functional import mse_loss


def learn(problem: Problem, seed: int, on_check: OnCheck) -> None:
    """Learn, and report after every so many transitions."""
    torch.set_num_threads(1)  # serves networks this small best
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    task, walkers = problem.task, Walkers(problem, seed)
    fast = task.walkers > 1  # else the paper's settings
    learning_rate, target_rate, target_period = (3e-3, 0.05, 1) if fast else (1e-4, 1.0, 200)
    features = torch.as_tensor(problem.features)
    barred = torch.where(torch.as_tensor(problem.valid), 0.0, -torch.inf)

    def new_network() -> nn.Sequential:
        widths = [features.shape[1], *task.hidden]
        hidden = [part for pair in pairwise(widths) for part in (nn.Linear(*pair), nn.ReLU())]
        return nn.Sequential(*hidden, nn.Linear(widths[-1], problem.exits))

    network, target = new_network(), new_network().requires_grad_(requires_grad=False)
    target.load_state_dict(network.state_dict())
    weights, target_weights = list(network.parameters()), list(target.parameters())
    if fast:
        optimiser = torch.optim.Adam(weights, lr=learning_rate, foreach=True)
    else:
        optimiser = torch.optim.RMSprop(weights, lr=learning_rate, alpha=0.9, eps=1e-10, foreach=True)

    # A ring of packed transitions: crossings instead of what the network is told about them.
    before, action, after = (np.zeros(task.replay, np.int64) for _ in range(3))
    reward, discount = (np.zeros(task.replay, np.float32) for _ in range(2))
    node, updates = walkers.reset(), 0

    for iteration in range(task.iterations):
        epsilon = max(1 - 0.95 * iteration / (0.3 * task.iterations), 0.05) if fast else 0.1
        with torch.no_grad():
            values = network(features[node]) + barred[node]
        noise = np.where(problem.valid[node], rng.random((task.walkers, problem.exits)), -1)
        at_random = rng.random(task.walkers) < epsilon
        taken = np.where(at_random, noise.argmax(axis=1), values.argmax(dim=1).numpy())
        there, earned, terminated, _, onward = walkers.step(taken)

        done = (iteration + 1) * task.walkers
        place = np.arange(done - task.walkers, done) % task.replay
        before[place], action[place], after[place], reward[place] = node, taken, there, earned
        discount[place] = np.where(terminated, 0.0, task.gamma)
        node = onward

        if done >= task.batch:
            drawn = rng.integers(min(done, task.replay), size=task.batch)
            next_node = after[drawn]
            with torch.no_grad():
                told = features[next_node]
                best = (network(told) + barred[next_node]).argmax(dim=1, keepdim=True)
                ahead = target(told).gather(1, best)[:, 0]
                goal = torch.as_tensor(reward[drawn]) + torch.as_tensor(discount[drawn]) * ahead
            value = network(features[before[drawn]]).gather(1, torch.as_tensor(action[drawn])[:, None])[:, 0]
            optimiser.zero_grad()
            mse_loss(value, goal).backward()
            for group in optimiser.param_groups:
                group["lr"] = learning_rate * (1 - iteration / task.iterations) if fast else learning_rate
            optimiser.step()
            updates += 1
            if updates % target_period == 0:
                with torch.no_grad():
                    torch._foreach_lerp_(target_weights, weights, target_rate)  # one call for all layers

        if done % task.check_every == 0:
            with torch.no_grad():
                on_check(done, updates, problem.greedy(network(features).numpy()))
