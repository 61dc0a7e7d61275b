"""A driving policy trained with stable-baselines3 in highway-env, as a system under test.

pip install '.[sb3]'
python tests/support/highway_dqn.py                 # trains for a few minutes, writes highway_dqn.zip beside this file
regents record --from highway:highway-fast-v0 --policy tests/support/highway_dqn.py:Trained -o cases/
regents attack cases/ --method regents --planner highway:tests/support/highway_dqn.py:Trained -o suite/
regents evaluate suite/ --in highway --planner highway:tests/support/highway_dqn.py:Trained
"""

import argparse
import warnings
from pathlib import Path

import gymnasium
import highway_env  # noqa: F401  registers the environments
from stable_baselines3 import DQN

MODEL = Path(__file__).with_suffix(".zip")
# What the policy was trained with, so it gets the same wherever it drives.
CONFIG = {
    "observation": {"type": "Kinematics"},
    "action": {"type": "DiscreteMetaAction"},
    "policy_frequency": 1,
}


class Trained:
    """The trained policy: looks and decides once a second."""

    config = CONFIG

    def __init__(self, model: Path = MODEL) -> None:
        self._model = DQN.load(model, device="cpu")

    def act(self, observation):
        """A meta-action."""
        return int(self._model.predict(observation, deterministic=True)[0])


def train(steps: int, model: Path = MODEL) -> None:
    """Settings of highway-env's own example of DQN."""
    env = gymnasium.make("highway-fast-v0", config=CONFIG)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        learner = DQN(
            "MlpPolicy",
            env,
            policy_kwargs={"net_arch": [256, 256]},
            learning_rate=5e-4,
            buffer_size=15_000,
            learning_starts=min(200, steps // 2),
            batch_size=32,
            gamma=0.8,
            train_freq=1,
            target_update_interval=50,
            seed=0,
            device="cpu",
        )
        learner.learn(steps)
    learner.save(model)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=10_000)
    train(parser.parse_args().steps)
