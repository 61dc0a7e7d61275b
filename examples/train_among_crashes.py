"""Recorded crashes as a Gymnasium environment of highway-env: the ego is yours, the others do what they did.

Any agent that speaks Gymnasium can be put here; this one brakes at random moments.
"""

import gymnasium

import regents_cosim.envs  # noqa: F401  registers the environments
from regents_cosim.cases.shipped import suite_folder

env = gymnasium.make(
    "regents/HighwayReplay-v0",
    config={"suite": str(suite_folder("quickstart")), "action": {"type": "DiscreteMetaAction"}},
)
env.action_space.seed(0)
crashed = 0
for episode in range(10):
    observation, info = env.reset(seed=episode)  # the seed draws a case
    ended, total = False, 0.0
    while not ended:
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total, ended = total + reward, terminated or truncated
    crashed += info["crashed"]
    print(f"{info['case']}: reward {total:.1f}, {'crashed' if info['crashed'] else 'got through'}")
print(f"{crashed} of 10 crashed")
