"""Train a policy in ordinary traffic, let it go on learning among adversaries, and ask whether it got any better.

A policy learns by DQN on highway-env's `highway-fast-v0`. Then it goes on twice, each time for twice as long: in
ordinary traffic, and attacked in every second episode. Of each stretch the best of a few moments is kept, as other
episodes of its own kinds show it. At the end all three drive on held-out seeds, in ordinary traffic and
attacked. Needs `pip install '.[sb3]'`, and takes about an hour of one core; `--steps 240 --episodes 5`
shows the same in a minute and a half.
"""

import argparse
import copy
import math
import warnings

import gymnasium
import highway_env  # noqa: F401  registers the environments
from stable_baselines3 import DQN

from regents_cosim.envs import LiveAdversary
from regents_cosim.evaluation.statistics import wilson

CHECKED, HELD_OUT = 50_000, 500_000  # first seeds of episodes that choose a moment, and of held-out episodes
MOMENTS = 6  # moments of a stretch of training, of which one is kept
LONGER = 2  # a policy that continues takes this many times the steps of the first stretch
LEAST_RANDOM = 0.05  # of all actions
# The environment's own speeds, 20 to 30 m/s, leave hardly a way out of an attack (docs/how-to/highway-env.md). A policy
# that may stop can learn one.
ACTION = {"type": "DiscreteMetaAction", "target_speeds": [0, 5, 10, 15, 20, 25, 30]}


def ordinary() -> gymnasium.Env:
    """The environment with speeds down to a stop."""
    return gymnasium.make("highway-fast-v0", disable_env_checker=True, config={"action": ACTION})


def attacked(every: int = 1) -> gymnasium.Env:
    """The environment with an adversary in one of `every` episodes."""
    return LiveAdversary(ordinary(), every=every, replan_s=1.0)


def learner(env: gymnasium.Env, steps: int, seed: int, before: DQN | None = None) -> DQN:
    """DQN as in highway-env's own example, but for a longer view, more memory, and smaller and steadier steps.

    With the discount of that example, 0.8 a second, a crash in five seconds counts a third. A policy must slow down
    about then to get out of an attack, and does not learn it. Rewards of three steps at once, and a target that
    follows slowly, let trainings differ less. One that goes on from `before` acts at random no more than that did last.
    """
    made = DQN(
        "MlpPolicy", env, policy_kwargs={"net_arch": [256, 256]}, learning_rate=2e-4, buffer_size=30_000,
        learning_starts=min(200, steps // 2), batch_size=64, gamma=0.95, n_steps=3, train_freq=1, tau=0.01,
        target_update_interval=1, exploration_initial_eps=1.0 if before is None else LEAST_RANDOM,
        exploration_final_eps=LEAST_RANDOM, seed=seed, device="cpu",
    )  # fmt: skip
    if before is not None:
        made.set_parameters(before.get_parameters())
    return made


def train(policy: DQN, checks: list[gymnasium.Env], steps: int, episodes: int) -> DQN:
    """Train for so many steps, and keep the moment with the fewest crashes in `episodes` of each of `checks`.

    DQN forgets and relearns, so that its last moment need not be its best.
    """
    best, kept = (math.inf, 0.0), policy.get_parameters()
    for moment in range(MOMENTS):
        policy.learn(steps // MOMENTS, reset_num_timesteps=moment == 0)
        hits, _, rewards = zip(*(crashes(policy, check, episodes, CHECKED) for check in checks), strict=True)
        if (sum(hits), -sum(rewards)) < best:
            best, kept = (sum(hits), -sum(rewards)), copy.deepcopy(policy.get_parameters())
    policy.set_parameters(kept)
    return policy


def crashes(policy: DQN, env: gymnasium.Env, episodes: int, first: int = HELD_OUT) -> tuple[int, int, float]:
    """The numbers of episodes with a crash and with an attack, and the mean reward."""
    crashed = begun = 0
    total = 0.0
    for seed in range(first, first + episodes):
        observation, info = env.reset(seed=seed)
        over = False
        while not over:
            action, _ = policy.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, info = env.step(int(action))
            total, over = total + float(reward), terminated or truncated
        crashed, begun = crashed + bool(info["crashed"]), begun + (info.get("attacks", 0) > 0)
    return crashed, begun, total / episodes


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=12_000, help="steps of the first stretch of training")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")  # warnings of highway-env about its observations
    before = None
    print("trained    driven     crashes (95 % interval)  attacked  mean reward")
    for trained, learns_in, checks, steps in (
        ("ordinary", ordinary(), [ordinary()], asked.steps),
        ("longer", ordinary(), [ordinary()], LONGER * asked.steps),
        ("attacked", attacked(every=2), [ordinary(), attacked()], LONGER * asked.steps),
    ):
        policy = learner(learns_in, steps, asked.seed, before)
        policy = train(policy, checks, steps, max(asked.episodes // 5, 1))
        before = before or policy
        for driven, env in (("ordinary", ordinary()), ("attacked", attacked())):
            hits, begun, reward = crashes(policy, env, asked.episodes)
            low, high = (100.0 * share for share in wilson(hits, asked.episodes))
            said = f"{hits:3} = {100 * hits / asked.episodes:3.0f} % ({low:3.0f} to {high:3.0f})"
            print(f"{trained:9}  {driven:9}  {said}  {begun:7}  {reward:11.1f}", flush=True)
