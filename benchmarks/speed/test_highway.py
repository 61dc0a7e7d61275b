"""Steps of the replay environment beside highway-env's own with as many IDM vehicles on the same road, in one run."""

import time

import gymnasium
import numpy as np
import pytest
from highway_env.vehicle.behavior import IDMVehicle

import regents_cosim.envs  # noqa: F401
from regents_cosim.cases.shipped import network_config
from regents_cosim.replays.highway.gym import HighwayReplayEnv
from regents_cosim.replays.replay import Mode
from regents_cosim.sources.record import record

STEPS = 60
ROUNDS = 3
SOURCES = ["highway:merge-v1", "highway:intersection-v2", "highway:highway-v0", "crossing", "multilane"]


class Plain(HighwayReplayEnv):
    """The road of a case in plain highway-env, with IDM vehicles that begin where the case has its agents."""

    def _reset(self) -> None:
        super()._reset()
        road = self.road
        road.__class__ = road.__class__.__mro__[1]  # highway-env's own, which handles every pair
        others = road.vehicles[1:]
        road.vehicles[1:] = [
            IDMVehicle(road, v.position, v.heading, v.speed, target_speed=max(v.speed, 5.0)) for v in others
        ]

    def _info(self, obs, action=None):
        return {"action": action}

    def _is_truncated(self) -> bool:
        return False


def seconds(env: HighwayReplayEnv) -> float:
    env.reset(seed=0)
    start = time.perf_counter()
    for _ in range(STEPS):
        env.step(np.zeros(2, np.float32))
    return time.perf_counter() - start


@pytest.mark.parametrize("mode", ["track", "actions"])
@pytest.mark.parametrize("source", SOURCES)
def test_steps_beside_highway_env_s_own(benchmark, source: str, mode: Mode) -> None:
    case = record(source if ":" in source else network_config(source), count=1)[0]
    gymnasium.spec("regents/HighwayReplay-v0")
    replayed, plain = (kind({"case": case, "mode": mode}) for kind in (HighwayReplayEnv, Plain))
    mine, theirs = [], []
    for _ in range(ROUNDS):  # alternating, so that a slow moment of the machine meets both
        mine.append(seconds(replayed))
        theirs.append(seconds(plain))
    benchmark.pedantic(seconds, args=(replayed,), rounds=1)
    ratio = min(theirs) / min(mine)
    benchmark.extra_info |= {"steps_per_s": STEPS / min(mine), "plain_steps_per_s": STEPS / min(theirs), "ratio": ratio}
    print(
        f"\n{source}, {mode}: {STEPS / min(mine):.0f} steps/s, highway-env's own {STEPS / min(theirs):.0f}, "
        f"ratio {ratio:.2f} "
        f"with {len(replayed.road.vehicles)} vehicles on {len(replayed.road.network.lanes_list())} lanes"
    )
    assert replayed.road.moment == STEPS
