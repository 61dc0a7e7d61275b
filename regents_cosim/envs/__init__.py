"""Gymnasium environments; importing this module registers them.

```python
import gymnasium
import regents_cosim.envs

env = gymnasium.make("regents/HighwayReplay-v0", config={"suite": "suite"})  # or {"case": "suite/CASE"}
observation, info = env.reset(seed=0)
env = gymnasium.make("regents/SumoReplay-v0", config={"suite": "suite"})
```
"""

import gymnasium

from regents_cosim.envs.inject import InjectScenario as InjectScenario
from regents_cosim.envs.live_adversary import LiveAdversary as LiveAdversary
from regents_cosim.envs.sumo_replay import SumoReplayEnv as SumoReplayEnv
from regents_cosim.replays.highway.gym import HighwayReplayEnv as HighwayReplayEnv

gymnasium.register("regents/HighwayReplay-v0", entry_point="regents_cosim.replays.highway.gym:HighwayReplayEnv")
gymnasium.register("regents/SumoReplay-v0", entry_point="regents_cosim.envs.sumo_replay:SumoReplayEnv")
