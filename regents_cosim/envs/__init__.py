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

for _name, _env in {"HighwayReplay": HighwayReplayEnv, "SumoReplay": SumoReplayEnv}.items():
    gymnasium.register(f"regents/{_name}-v0", entry_point=f"{_env.__module__}:{_env.__name__}")
