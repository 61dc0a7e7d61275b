"""A planner that searches a tree in a copy of highway-env: optimistic planning (Hren and Munos 2008) of rl-agents.

Its source, github.com/eleurent/rl-agents, lies on PYTHONPATH (PyPI has another package of that name).
`regents evaluate shipped:standard --planner highway:tree_search.py:Search`
"""

import logging
from typing import ClassVar

import gymnasium
from rl_agents.agents.tree_search.deterministic import DeterministicPlannerAgent

logging.getLogger("rl_agents").setLevel(logging.ERROR)
FASTEST = 30.0


class Rewarded(gymnasium.Wrapper):
    """Rewards in [0, 1], as the search needs them: 0 for a crash, else more for more speed."""

    def step(self, action):
        """What the environment answers, with this reward."""
        seen, _, over, cut, info = self.env.step(action)
        reward = 0.0 if info["crashed"] else 0.5 + 0.5 * min(max(info["speed"], 0.0) / FASTEST, 1.0)
        return seen, reward, over, cut, info


class Search:
    """Decides once a second, after trying 50 actions in a copy of the environment."""

    config: ClassVar = {
        "action": {"type": "DiscreteMetaAction", "target_speeds": [0, 5, 10, 15, 20, 25, 30]},
        "observation": {"type": "AttributesObservation", "attributes": []},
        "policy_frequency": 1,
    }

    def act(self, observation, env):
        """The first action of the best sequence that it finds."""
        env.config["simulation_frequency"] = 5  # coarser, and twice as fast
        agent = DeterministicPlannerAgent(Rewarded(env), {"budget": 50, "gamma": 0.9})
        agent.seed(0)
        return int(agent.act(observation))
