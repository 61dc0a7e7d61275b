"""A planner that searches a tree in a copy of highway-env: optimistic planning (Hren and Munos 2008) of rl-agents.

Its source, github.com/eleurent/rl-agents, lies on PYTHONPATH (PyPI has another package of that name), and needs
`pip install numba seaborn`.
`regents evaluate shipped:standard --planner highway:tree_search.py:Search`
"""

import logging
from typing import Any, ClassVar

import gymnasium

OWN_SETTINGS = {"budget": 75, "gamma": 0.7}  # of rl-agents for highway-env (scripts/configs/HighwayEnv)
FASTEST = 30.0  # where the lane has no limit [m/s]
COLLISION, SPEED = 1.0, 0.4  # the weights of highway-env's own reward


class Rewarded(gymnasium.Wrapper):
    """highway-env's reward in [0, 1], as the search needs it, for speed up to the limit of the lane."""

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """What the environment answers, with this reward."""
        seen, _, over, cut, info = self.env.step(action)
        ego = self.env.unwrapped.vehicle
        reward = SPEED * worth(ego.speed, min(FASTEST, ego.lane.speed_limit)) - COLLISION * info["crashed"]
        return seen, ego.on_road * (reward + COLLISION) / (SPEED + COLLISION), over, cut, info


def worth(speed: float, limit: float) -> float:
    """1 at the limit, less below it; nothing from a fifth above it."""
    share = speed / limit
    return min(max(min(share, 6.0 - 5.0 * share), 0.0), 1.0)


class Search:
    """Decides once a second, after trying 75 actions in a copy of the environment."""

    config: ClassVar = {
        "action": {"type": "DiscreteMetaAction", "target_speeds": [km_h / 3.6 for km_h in range(0, 120, 15)]},
        "observation": {"type": "AttributesObservation", "attributes": []},
        "policy_frequency": 1,
    }

    def __init__(self) -> None:
        from rl_agents.agents.tree_search.deterministic import DeterministicPlannerAgent

        logging.getLogger("rl_agents").setLevel(logging.ERROR)
        self.agent = DeterministicPlannerAgent

    def act(self, observation: Any, env: gymnasium.Env) -> int:
        """The first action of the best sequence that it finds."""
        env.config["simulation_frequency"] = 5  # coarser, and twice as fast
        agent = self.agent(Rewarded(env), OWN_SETTINGS)
        agent.seed(0)
        return int(agent.act(observation))
