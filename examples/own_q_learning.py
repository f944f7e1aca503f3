"""Learn a congested map by Q-learning with a table of one's own, and print how the learned walk went."""

import gymnasium
import numpy as np

env = gymnasium.make("sidestep.gym:sidestep/PaperGrid-v0", observation="node", walks="anywhere")
values = np.zeros((36, 4))
node, info = env.reset(seed=0)
for _ in range(6_000):
    exits = np.flatnonzero(info["action_mask"])
    best = exits[values[node, exits].argmax()]
    action = best if env.np_random.random() < 0.9 else env.np_random.choice(exits)
    after, reward, terminated, truncated, told = env.step(action)
    onward = 0.0 if terminated else values[after, told["action_mask"] == 1].max()
    values[node, action] += 0.5 * (float(reward) + onward - values[node, action])
    node, info = env.reset() if terminated or truncated else (after, told)

test = gymnasium.make("sidestep/PaperGrid-v0", observation="node", purpose="test")
node, info = test.reset(options={"future": 0})
done = False
while not done:
    node, reward, terminated, truncated, info = test.step(np.where(info["action_mask"], values[node], -np.inf).argmax())
    done = terminated or truncated
print(f"{info['seconds'] / 60:.0f} min, {'arrived' if terminated else 'did not arrive'}")
