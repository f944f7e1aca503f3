"""Learn a congested map by MaskablePPO; needs sb3-contrib, which brings Stable-Baselines3 and PyTorch."""

import gymnasium
import torch
from sb3_contrib import MaskablePPO

from sidestep.gym.sb3 import SB3VecEnv

torch.set_num_threads(1)  # the network is small
env = SB3VecEnv("paper-congested", num_envs=64, observation="one-hot")
model = MaskablePPO("MlpPolicy", env, n_steps=64, batch_size=512, gamma=1.0, ent_coef=0.01, learning_rate=1e-3, seed=0)
model.learn(100_000)

test = gymnasium.make("sidestep/PaperGrid-v0", observation="one-hot", purpose="test")
observation, info = test.reset(options={"future": 0})
terminated = truncated = False
while not (terminated or truncated):
    action, _ = model.predict(observation, action_masks=info["action_mask"], deterministic=True)
    observation, reward, terminated, truncated, info = test.step(action)
print(f"{info['seconds'] / 60:.0f} min, {'arrived' if terminated else 'did not arrive'}")
