"""The gymnasium environments, as their users handle them."""

import copy
import hashlib
import os
import pickle
import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pygame
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from scenes import absent, scene
from shipped_cases import QUICKSTART, crash_on

from regents_cosim.envs import HighwayReplayEnv, InjectScenario
from regents_cosim.errors import RegentsError
from regents_cosim.saving import SuiteWriter, save_unlisted

ID = "regents/HighwayReplay-v0"
META = {"action": {"type": "DiscreteMetaAction", "target_speeds": [0, 6, 12]}}


def make(**config) -> HighwayReplayEnv:
    return gymnasium.make(ID, config=config, disable_env_checker=True).unwrapped


def crossing_paths():
    """The ego runs into a slower vehicle at step 45, unless it changes to the left."""
    return scene((0.0, 0.0, 12.0), (40.0, 0.0, 4.0), (150.0, 3.2, 12.0), name="slow_ahead")


def test_gymnasium_s_own_checks_pass():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # highway-env's observations have no bounds
        check_env(make(case=crash_on("multilane")))


EPISODE = """
import hashlib, gymnasium, numpy as np, regents_cosim.envs
env = gymnasium.make("regents/HighwayReplay-v0", disable_env_checker=True)
digest = hashlib.sha256()
observation, info = env.reset(seed=7)
env.action_space.seed(7)
for _ in range(20):
    digest.update(observation.tobytes() + info["case"].encode())
    observation, reward, _, _, info = env.step(env.action_space.sample())
    digest.update(np.float64(reward).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_the_same_seed_gives_the_same_episode_in_any_process(capsys):
    exec(compile(EPISODE, "episode", "exec"), {})
    here = capsys.readouterr().out.strip()
    there = subprocess.run([sys.executable, "-c", EPISODE], capture_output=True, text=True, check=True).stdout.strip()
    assert here.splitlines()[-1] == there.splitlines()[-1]


def test_cases_suites_and_seeds_choose_what_is_played():
    env = make()
    folder = crash_on("merge")
    assert env.reset(options={"case": folder})[1]["case"] == folder.name
    drawn = {env.reset(seed=seed, options={"suite": QUICKSTART})[1]["case"] for seed in range(8)}
    assert len(drawn) > 2
    assert env.reset(seed=3)[1]["case"] == env.reset(seed=3)[1]["case"]


def test_an_episode_ends_with_the_case():
    env = make(case=scene((0.0, 0.0, 10.0), (100.0, 3.2, 10.0), steps=21), policy_frequency=5)
    total, truncated = 0.0, False
    while not truncated:
        _, reward, terminated, truncated, info = env.step(np.zeros(2, np.float32))
        total += reward
        assert not terminated
        assert set(info["rewards"]) == {"collision_reward", "progress_reward"}
    assert info["step"] == 20
    assert total == pytest.approx(1.0, abs=0.05)  # it keeps its speed and so goes where it went


@pytest.mark.parametrize("mode", ["track", "actions"])
def test_an_episode_ends_with_a_crash(mode):
    env = make(case=crossing_paths(), mode=mode)
    terminated = False
    while not terminated:
        _, _, terminated, truncated, info = env.step(np.zeros(2, np.float32))
        assert not truncated
    assert (info["step"], info["crashed"], info["contact"]) == (45, True, "car01")
    assert info["rewards"]["collision_reward"] == 1.0


def test_a_contact_between_two_decisions_is_told():
    env = make(case=scene((0.0, 0.0, 12.0), (-17.0, 0.0, 40.0)), policy_frequency=1)
    _, _, terminated, _, info = env.step(np.zeros(2, np.float32))
    assert env.road.contacts[-1][0] < info["step"], "it is over by then"
    assert (terminated, info["contact"]) == (True, "car01")


def test_left_is_left():
    env = make(case=crossing_paths(), **META)
    info = {}
    env.step(0)  # LANE_LEFT
    for _ in range(60):
        _, _, terminated, _, info = env.step(1)
        assert not terminated
    assert -env.vehicle.position[1] == pytest.approx(3.2, abs=0.2)  # one lane further north
    assert info["contact"] is None


@pytest.mark.parametrize("observation", ["OccupancyGrid", "LidarObservation", "TimeToCollision"])
def test_other_observations(observation):
    env = make(case=crossing_paths(), observation={"type": observation}, **META)
    seen, _ = env.reset(seed=0)
    assert env.observation_space.contains(seen)
    assert np.any(seen)


def test_wrong_words_are_explained():
    with pytest.raises(RegentsError, match=r"unknown configuration key 'modus', did you mean mode\?"):
        make(modus="track")
    with pytest.raises(RegentsError, match="mode 'tracks', expected one of track, actions"):
        make(mode="tracks")
    with pytest.raises(RegentsError, match=r"unknown option 'cases', did you mean case\?"):
        make().reset(options={"cases": QUICKSTART})
    with pytest.raises(RegentsError, match="policy_frequency 3 Hz, expected a divisor of 10 Hz"):
        make(policy_frequency=3)
    with pytest.raises(RegentsError, match="not both"):
        make().reset(options={"case": crash_on("merge"), "suite": QUICKSTART})


def test_pictures_need_no_screen():
    env = gymnasium.make(ID, render_mode="rgb_array", config={"case": crossing_paths()}, disable_env_checker=True)
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (600, 600, 3)
    assert picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 3  # road, lines, vehicles
    env.close()
    env.close()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is no Wayland")
def test_without_a_display_pictures_are_drawn_without_a_word():
    program = f"""
import gymnasium, regents_cosim.envs
env = gymnasium.make("{ID}", render_mode="rgb_array", disable_env_checker=True)
env.reset(seed=0)
print(env.render().std() > 5.0)
"""
    displays = ("SDL_VIDEODRIVER", "XDG_RUNTIME_DIR", "DISPLAY", "WAYLAND_DISPLAY")
    bare = {name: value for name, value in os.environ.items() if name not in displays}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=bare, check=True)
    assert done.stdout.splitlines()[-1] == "True"
    assert done.stderr == ""


@pytest.mark.parametrize(("driver", "drawn"), [("dummy", False), ("offscreen", True)])
def test_the_window_opens_and_closes(monkeypatch, driver, drawn):
    """Both drivers of SDL's need no display; with `dummy` highway-env opens its window but draws nothing."""
    pygame.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", driver)
    env = gymnasium.make(ID, render_mode="human", config={"case": crossing_paths()}, disable_env_checker=True)
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    seen = pygame.surfarray.array3d(pygame.display.get_surface())
    assert pygame.display.get_driver() == driver
    assert seen.shape == (600, 600, 3)
    assert (len(np.unique(seen.reshape(-1, 3), axis=0)) > 3) == drawn
    assert env.render() is None
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_vector_environments():
    both = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="sync", config={"suite": str(QUICKSTART)})
    observation, info = both.reset(seed=[1, 2])
    assert observation.shape == (2, 5, 5)
    assert info["case"][0] == make(suite=QUICKSTART).reset(seed=1)[1]["case"]
    both.step(both.action_space.sample())
    both.close()


@pytest.mark.slow
def test_vector_environments_in_processes(tmp_path):
    folder = save_unlisted(crossing_paths(), tmp_path)
    both = gymnasium.make_vec(
        ID,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},  # JAX, which the tests have loaded, does not survive a fork
        config={"case": str(folder)},
    )
    observation, info = both.reset(seed=1)
    assert info["case"].tolist() == ["slow_ahead"] * 2
    assert hashlib.sha256(observation[0].tobytes()).digest() == hashlib.sha256(observation[1].tobytes()).digest()
    both.close()


# --- injection --------------------------------------------------------------------------------


def cut_in():
    """On merge-v1's road, which begins at x = y = 0: an adversary stands in the ego's lane, somebody drives ahead."""
    made = scene((30.0, -4.0, 30.0), (120.0, -4.0, 0.0), (300.0, 0.0, 20.0), steps=81, name="in_the_way")
    ego, adversary, other = made.agents
    return replace(made, agents=(ego, replace(adversary, role="adversary"), other))


def test_a_camera_does_not_see_which_vehicle_was_injected():
    camera = {
        "type": "GrayscaleObservation",
        "observation_shape": (20, 20),
        "stack_size": 1,
        "weights": [0.3, 0.6, 0.1],
    }
    env = gymnasium.make("merge-v1", config={"observation": camera}, disable_env_checker=True)
    injected = InjectScenario(env, case=cut_in())
    injected.reset(seed=0)
    assert [vehicle.color for vehicle in injected.injected] == [(100, 200, 255)], "as highway-env's own traffic"


def test_a_recorded_adversary_is_put_into_another_environment():
    env = InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=cut_in())
    _, info = env.reset(seed=0)
    (injected,) = env.injected
    assert info["case"] == "in_the_way"
    assert injected in env.unwrapped.road.vehicles
    terminated = False
    while not terminated:
        _, _, terminated, _, info = env.step(1)
    assert info["crashed"]
    assert injected.crashed
    np.testing.assert_allclose(injected.position, [120.0, 4.0], atol=1e-9)  # nothing moved it


def test_gymnasium_s_own_checks_pass_with_an_injected_adversary(tmp_path):
    folder = save_unlisted(cut_in(), tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # highway-env's observations have no bounds
        check_env(InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=folder))


def test_its_spec_makes_the_same_environment(tmp_path):
    folder = save_unlisted(cut_in(), tmp_path)
    env = InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=folder, who="background")
    for spec in (env.spec, EnvSpec.from_json(env.spec.to_json()), pickle.loads(pickle.dumps(env.spec))):
        made = gymnasium.make(spec, disable_env_checker=True)
        assert made.reset(seed=0)[1]["case"] == "in_the_way"
        assert [vehicle.name for vehicle in made.injected] == ["car01", "car02"]


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_alone(again):
    """Planners that look ahead copy the environment that they are in."""
    env = InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=cut_in())
    env.reset(seed=0)
    other = again(env)
    ahead = [other.step(1)[0] for _ in range(2)]
    assert env.injected[0].time_s == 0.0
    np.testing.assert_array_equal([env.step(1)[0] for _ in range(2)], ahead)
    assert env.injected[0].time_s == other.injected[0].time_s == pytest.approx(2.0)


def test_two_adversaries_from_two_cases():
    other = replace(cut_in(), id="behind")
    env = InjectScenario(
        InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=cut_in()), case=other
    )
    env.reset(seed=0)
    env.step(1)
    assert [one.injected[0].time_s for one in (env, env.env)] == [pytest.approx(1.0)] * 2


def test_the_options_say_who_is_injected(tmp_path):
    folder = SuiteWriter(tmp_path, seed=0).add(cut_in())
    host = gymnasium.make("merge-v1", disable_env_checker=True)
    env = InjectScenario(host)
    assert "case" not in env.reset(seed=0)[1]
    assert env.injected == []
    for options in ({"case": folder}, {"suite": tmp_path, "config": {"duration": 20}}):
        assert env.reset(seed=0, options=options)[1]["case"] == "in_the_way"
        assert [vehicle.name for vehicle in env.injected] == ["car01"]
    assert env.unwrapped.config["duration"] == 20
    everybody = InjectScenario(host, suite=tmp_path, who="background")
    everybody.reset(seed=0)
    assert [vehicle.name for vehicle in everybody.injected] == ["car01", "car02"]


def test_between_two_steps_of_the_track_it_is_in_between():
    case = scene((0.0, 3.2, 10.0), (200.0, -4.0, 10.0), steps=31)
    env = InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=case, who="background")
    env.reset(seed=0)
    env.step(1)  # 15 frames of a fifteenth of a second
    assert env.injected[0].position[0] == pytest.approx(210.0)
    for _ in range(3):
        env.step(1)
    assert env.injected[0] not in env.unwrapped.road.vehicles  # its track has come to its end


def test_where_its_track_has_a_gap_it_is_not_there():
    case = absent(scene((0.0, 3.2, 10.0), (200.0, -4.0, 10.0), steps=41), (1, slice(5, 15)))
    env = InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=case, who="background")
    env.reset(seed=0)
    there = []
    for _ in range(3):  # one second each
        there.append(env.injected[0] in env.unwrapped.road.vehicles)
        env.step(1)
    assert there == [True, False, True]
    assert env.injected[0].position[0] == pytest.approx(230.0)


def test_injection_keeps_to_what_it_can_do():
    with pytest.raises(RegentsError, match="not an environment of highway-env"):
        InjectScenario(gymnasium.make("CartPole-v1"))
    env = InjectScenario(gymnasium.make("merge-v1", disable_env_checker=True), case=scene((0, 0, 1), (9, 0, 1)))
    with pytest.raises(RegentsError, match="has no adversary to inject"):
        env.reset(seed=0)
