"""An adversary in the live traffic of highway-env."""

import copy
import functools
import pickle
import warnings

import gymnasium
import highway_env  # noqa: F401  registers the environments
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shipped_cases import crash_on

from regents_cosim.envs import LiveAdversary
from regents_cosim.errors import RegentsError

IDLE, SLOWER = 1, 4


def plain(name="highway-fast-v0"):
    return gymnasium.make(name, disable_env_checker=True)


def episode(env, seed, actions=(IDLE,) * 12):
    """Observations and infos of an episode."""
    seen, told = zip(env.reset(seed=seed), strict=True)
    seen, told = list(seen), list(told)
    for action in actions:
        observation, _, terminated, truncated, info = env.step(action)
        seen.append(observation)
        told.append(info)
        if terminated or truncated:
            break
    return np.array(seen), told


def seed_of(env, attacked):
    """The first seed whose episode is attacked, or is not."""
    return next(seed for seed in range(20) if env.reset(seed=seed)[1]["attacked"] == attacked)


def test_episodes_that_are_not_attacked_are_as_they_were():
    env = LiveAdversary(plain(), every=3)
    seed = seed_of(env, attacked=False)
    mine, told = episode(env, seed)
    np.testing.assert_array_equal(mine, episode(plain(), seed)[0])
    assert not any(info["attacked"] or info["adversary"] or info["attacks"] for info in told)


def test_one_of_so_many_episodes_is_attacked():
    env = LiveAdversary(plain(), every=3)
    env.reset(seed=seed_of(env, attacked=True))
    assert [env.reset()[1]["attacked"] for _ in range(6)] == [False, False, True] * 2


def test_its_spec_makes_the_same_wrapper():
    env = LiveAdversary(plain(), every=4, replan_s=1.0)
    for spec in (env.spec, pickle.loads(pickle.dumps(env.spec))):
        made = gymnasium.make(spec, disable_env_checker=True)
        assert isinstance(made, LiveAdversary)
        assert made.reset(seed=0)[1]["attacked"] == env.reset(seed=0)[1]["attacked"]


def test_what_cannot_be_meant_is_refused():
    with pytest.raises(RegentsError, match="not an environment of highway-env"):
        LiveAdversary(gymnasium.make("CartPole-v1"))
    with pytest.raises(RegentsError, match="every 0, expected 1"):
        LiveAdversary(plain(), every=0)
    with pytest.raises(RegentsError, match="method 'gentle'"):
        LiveAdversary(plain(), method="gentle")


@pytest.mark.slow
def test_a_slow_policy_is_attacked_and_the_same_seed_is_the_same_episode():
    env = LiveAdversary(plain(), replan_s=1.0)
    begun = 0
    for seed in range(3):
        seen, told = episode(env, seed, (SLOWER,) * 15)
        begun += told[-1]["attacks"]
        attackers = {info["adversary"] for info in told} - {""}
        assert len(attackers) <= told[-1]["attacks"]
    assert begun
    np.testing.assert_array_equal(seen, episode(env, seed, (SLOWER,) * 15)[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["merge-v1", "intersection-v2", "roundabout-v1"])
def test_other_roads(name):
    env = LiveAdversary(plain(name), replan_s=1.0)
    _, told = episode(env, 0)
    assert told[0]["attacked"]


@pytest.mark.slow
def test_gymnasium_s_own_checks_pass():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # highway-env's observations have no bounds
        check_env(LiveAdversary(plain(), replan_s=1.0))


@pytest.mark.slow
def test_as_many_as_one_likes_side_by_side():
    wrapper = functools.partial(LiveAdversary, replan_s=1.0)
    envs = gymnasium.make_vec("highway-fast-v0", num_envs=2, vectorization_mode="sync", wrappers=[wrapper])
    _, info = envs.reset(seed=0)
    assert info["attacked"].tolist() == [True, True]
    for _ in range(5):
        *_, info = envs.step(np.array([IDLE, IDLE]))
    assert len(info["adversary"]) == 2
    envs.close()


@pytest.mark.slow
def test_in_sumo_an_adversary_attacks_as_the_agent_drives():
    """Where its way is straight: an agent that does nothing stands at lights, and leaves the road in bends."""
    env = gymnasium.make("regents/SumoReplay-v0", config={"background": "live"}, disable_env_checker=True)
    begun = 0
    for network in ("crossing", "grid"):
        _, info = env.reset(seed=0, options={"case": str(crash_on(network))})
        assert info["attacked"]
        over = False
        while not over:
            *_, terminated, truncated, info = env.step(np.zeros(2, np.float32))
            over = terminated or truncated
        begun += info["attacks"]
    assert begun
    env.close()


def test_sumo_s_wrong_settings_are_refused():
    with pytest.raises(RegentsError, match="method 'gentle'"):
        gymnasium.make("regents/SumoReplay-v0", config={"background": "live", "method": "gentle"})


@pytest.mark.slow
def test_a_copy_goes_on_alone():
    """Planners that look ahead copy the environment that they are in."""
    env = LiveAdversary(plain(), replan_s=1.0)
    env.reset(seed=0)
    env.step(IDLE)
    other = copy.deepcopy(env)
    ahead = [other.step(IDLE)[0] for _ in range(3)]
    np.testing.assert_array_equal([env.step(IDLE)[0] for _ in range(3)], ahead)
