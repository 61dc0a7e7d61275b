"""The environment in a real SUMO, as its users handle it."""

import os
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from crossing_scenes import LANE_Y, STEPS, scenario, straight
from gymnasium.utils.env_checker import check_env
from scenes import scene
from shipped_cases import QUICKSTART, crash_on

from regents_cosim.cases.files import load_case
from regents_cosim.envs import SumoReplayEnv
from regents_cosim.errors import RegentsError, SumoError
from regents_cosim.norms.limits import ACCEL_LIMIT, CURVATURE_LIMIT
from regents_cosim.replays.replay import replay
from regents_cosim.scenario.collisions import first_contact

ID = "regents/SumoReplay-v0"
NOTHING = np.zeros(2, np.float32)


def make(**config) -> SumoReplayEnv:
    return gymnasium.make(ID, config=config, disable_env_checker=True).unwrapped


@pytest.fixture(scope="module")
def env():
    """One process of SUMO's for the tests that do not harm it."""
    made = make()
    yield made
    made.close()


def meeting():
    """The ego runs into one who stands in its lane."""
    ego = straight("ego", -60.0, LANE_Y, 0.0, 10.0)
    others = [straight(f"b{i}", -20.0 + 8.0 * i, 5.1, np.pi, 5.0) for i in range(10)]
    return scenario(ego, straight("a", -50.0, LANE_Y, 0.0, 0.0), *others)


@pytest.mark.slow
def test_gymnasium_s_own_checks_pass():
    made = make(case=crash_on("merge"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # positions have no bounds
        check_env(made, skip_render_check=False)
    made.close()


EPISODE = """
import hashlib, gymnasium, numpy as np, regents_cosim.envs
env = gymnasium.make("regents/SumoReplay-v0", config={"background": "reactive"}, disable_env_checker=True)
digest = hashlib.sha256()
observation, info = env.reset(seed=7)
env.action_space.seed(7)
for _ in range(20):
    digest.update(b"".join(values.tobytes() for values in observation.values()) + info["case"].encode())
    observation, reward, _, _, info = env.step(env.action_space.sample())
    digest.update(np.float64(reward).tobytes())
env.close()
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_the_same_seed_gives_the_same_episode_in_any_process(capsys):
    for _ in range(2):
        exec(compile(EPISODE, "episode", "exec"), {})
    here = capsys.readouterr().out.split()
    there = subprocess.run([sys.executable, "-c", EPISODE], capture_output=True, text=True, check=True).stdout.split()
    assert {*here, *there} == {here[0]}


WEAVER = """
import numpy as np
from regents_cosim import Control

class Weaver:
    def reset(self, scene):
        pass

    def act(self, observation):
        accel, curvature = np.float32([np.sin(observation.step), 0.1 * np.cos(0.3 * observation.step)])
        return Control(float(accel) * {accel}, float(curvature) * {curvature})
"""


@pytest.mark.slow
def test_the_same_controls_lead_where_a_planner_s_do(tmp_path):
    case = load_case(crash_on("grid"))
    path = tmp_path / "weaver.py"
    path.write_text(WEAVER.format(accel=ACCEL_LIMIT, curvature=CURVATURE_LIMIT))
    env = make(case=case)
    env.reset(seed=0)
    driven = replay(case, planner=f"{path}:Weaver").replayed.tracks
    for step in range(case.tracks.steps - 1):
        push = np.float32([np.sin(step), 0.1 * np.cos(0.3 * step)])
        _, _, terminated, _, _ = env.step(push)
        if terminated:
            break
    seen, at = env.seen, step + 1
    env.close()
    assert at > 20
    np.testing.assert_allclose(seen.x, driven.x[:, at], atol=1e-6)
    np.testing.assert_allclose(seen.y, driven.y[:, at], atol=1e-6)


@pytest.mark.slow
def test_among_live_traffic_others_react_to_the_ego():
    """It stops where the case has it drive on; who is behind stops too, and is not where the case has it."""
    ego, behind = straight("ego", -60.0, LANE_Y, 0.0, 10.0), straight("behind", -80.0, LANE_Y, 0.0, 10.0)
    case, ends = scenario(ego, behind), {}
    for background in ("log", "reactive"):
        env = make(case=case, background=background)
        env.reset(seed=0)
        over = False
        while not over:
            _, _, terminated, truncated, info = env.step(np.array([-1.0, 0.0]))
            over = terminated or truncated
        ends[background] = env.seen.x[1], info["crashed"]
        env.close()
    assert ends["reactive"][0] < ends["log"][0] - 1.0
    assert not ends["reactive"][1]


def test_an_episode_ends_with_the_case(env):
    case = scenario(straight("ego", -100.0, LANE_Y, 0.0, 10.0), straight("a", -60.0, 5.1, np.pi, 9.0))
    env.reset(options={"case": case})
    total, truncated = 0.0, False
    while not truncated:
        _, reward, terminated, truncated, info = env.step(NOTHING)
        total += reward
        assert not terminated
        assert set(info["rewards"]) == {"collision_reward", "progress_reward"}
    assert info["step"] == STEPS - 1
    assert info["speed"] == pytest.approx(10.0)
    assert total == pytest.approx(1.0, abs=0.01)  # it keeps its speed and so goes where it went
    with pytest.raises(RegentsError, match="the episode is over, expected a reset"):
        env.step(NOTHING)


def test_an_episode_ends_with_the_contact_that_our_boxes_see(env):
    case = meeting()
    agent, step = first_contact(case.agents, case.tracks)
    env.reset(options={"case": case})
    terminated = False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(NOTHING)
        assert not truncated
    assert (info["step"], info["crashed"], info["contact"]) == (step, True, case.agents[agent].id)
    assert info["rewards"]["collision_reward"] == 1.0
    assert reward < -0.9


def test_what_is_observed(env):
    case = meeting()
    seen, _ = env.reset(options={"case": case})
    assert env.observation_space.contains(seen)
    assert seen["ego"] == pytest.approx([0.0, 0.0, 0.0, 10.0])
    assert seen["others"][0] == pytest.approx([10.0, 0.0, -10.0, 0.0, 1.0, 0.0, 4.6, 1.8], abs=1e-5)
    assert seen["present"].tolist() == [1] * 8  # of eleven
    assert seen["others"][1, 4:6] == pytest.approx([-1.0, 0.0], abs=1e-6)
    away = np.hypot(*seen["others"][:, :2].T)
    assert (np.diff(away) >= 0).all()
    assert seen["target"] == pytest.approx([200.0, 0.0])
    turned, *_ = env.step(np.array([1.0, 1.0]))
    assert turned["ego"][2] > 0.0  # positive turns left
    assert turned["ego"][3] == pytest.approx(10.0 + 0.1 * ACCEL_LIMIT)
    assert turned["others"][0, 1] < 0.0  # and leaves the other to the right
    assert turned["time"] == pytest.approx([1 / (STEPS - 1)])
    alone, _ = env.reset(options={"case": scenario(straight("ego", -60.0, LANE_Y, 0.0, 10.0))})
    assert not alone["present"].any()
    assert not alone["others"].any()


def test_cases_suites_and_seeds_choose_what_is_played(env):
    folder = crash_on("merge")
    assert env.reset(options={"case": folder})[1]["case"] == folder.name
    drawn = {env.reset(seed=seed, options={"suite": QUICKSTART})[1]["case"] for seed in range(8)}
    assert len(drawn) > 2
    assert env.reset(seed=3)[1]["case"] == env.reset(seed=3)[1]["case"]
    assert env.reset(seed=3)[0]["others"].tobytes() == env.reset(seed=3)[0]["others"].tobytes()


def test_wrong_words_are_explained(env):
    with pytest.raises(RegentsError, match=r"unknown configuration key 'backround', did you mean background\?"):
        make(backround="log")
    with pytest.raises(RegentsError, match="background 'still', expected one of log, reactive, live"):
        make(background="still")
    with pytest.raises(RegentsError, match="neighbours 0, expected a whole number above 0"):
        make(neighbours=0)
    with pytest.raises(RegentsError, match=r"unknown option 'cases', did you mean case\?"):
        env.reset(options={"cases": QUICKSTART})
    env.reset(seed=0)
    for action in ([0.0], [np.nan, 0.0]):
        with pytest.raises(RegentsError, match="expected two finite numbers"):
            env.step(np.array(action))
    with pytest.raises(RegentsError, match="expected a reset"):
        make().step(NOTHING)


def test_a_case_that_sumo_cannot_play_is_said_and_the_next_one_can(env):
    made = scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0))
    with pytest.raises(SumoError, match=r"SUMO refused"):
        env.reset(options={"case": replace(made, road=replace(made.road, sumo_net=b"no gzip"))})
    with pytest.raises(RegentsError, match="expected a reset"):
        env.step(NOTHING)
    env.reset(options={"case": meeting()})
    env.step(NOTHING)


@pytest.mark.slow
def test_a_sumo_that_dies_is_said_and_the_next_reset_starts_another():
    made = make(case=meeting())
    made.reset(seed=0)
    os.kill(made._session.worker._process.pid, signal.SIGSEGV)
    with pytest.raises(SumoError, match=r"SUMO's process died in a step \(exit code -11\); the next reset starts"):
        made.step(NOTHING)
    with pytest.raises(RegentsError, match="expected a reset"):
        made.step(NOTHING)
    made.reset(seed=0)
    made.step(NOTHING)
    made.close()


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks into /proc")
def test_nobody_is_left_behind():
    made = make(case=meeting())
    made.close()  # before it began
    made.reset(seed=0)
    pid = made._session.worker._process.pid
    assert alive(pid)
    made.close()
    made.close()
    assert not alive(pid)
    code = f"""
import os, signal
import gymnasium, regents_cosim.envs
env = gymnasium.make({ID!r}, disable_env_checker=True).unwrapped
env.reset(seed=0)
print(env._session.worker._process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    orphan = int(killed.stdout)
    for _ in range(100):
        if not alive(orphan):
            break
        signal.sigtimedwait([], 0.1)
    assert not alive(orphan)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["", "raise ValueError('of the user')"])
def test_who_does_not_close_it_need_not_wait_at_the_end(ending):
    code = f"""
import gymnasium, regents_cosim.envs
env = gymnasium.make({ID!r}, disable_env_checker=True)
env.reset(seed=0)
{ending}
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == (1 if ending else 0)
    assert done.stderr.count("Traceback") == (1 if ending else 0)


@pytest.mark.slow
def test_pictures_need_no_screen():
    made = gymnasium.make(ID, render_mode="rgb_array", config={"case": meeting(), "screen_width": 400}).unwrapped
    made.reset(seed=0)
    first = made.render()
    assert (first.shape, first.dtype) == ((600, 400, 3), np.uint8)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 10  # road, lines, vehicles
    for _ in range(5):
        made.step(NOTHING)
    assert (made.render() != first).any()
    made.close()
    with pytest.raises(RegentsError, match="render_mode 'human', expected None or rgb_array"):
        SumoReplayEnv(render_mode="human")


@pytest.mark.slow
def test_vector_environments():
    both = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="sync", config={"suite": str(QUICKSTART)})
    observation, _ = both.reset(seed=[1, 2])
    assert observation["others"].shape == (2, 8, 8)
    both.step(both.action_space.sample())
    both.close()
