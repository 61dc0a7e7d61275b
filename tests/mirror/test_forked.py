"""Processes that are forked after JAX was at work say so, in place of waiting for ever."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing is forked there")

FORK = """
import multiprocessing, sys, warnings
import jax
from regents_cosim.errors import RegentsError
from regents_cosim.mirror.programs.compiled import compiled

warnings.simplefilter("ignore")  # of JAX, which says that it will likely hang
jax.devices() if sys.argv[1] == "at work" else None

def ask(answers):
    try:
        answers.put(float(compiled(lambda x: x + 1.0)(1.0)))
    except RegentsError as error:
        answers.put(str(error))

context = multiprocessing.get_context("fork")
answers = context.Queue()
context.Process(target=ask, args=(answers,)).start()
print(answers.get())
"""

VECTOR = """
import sys, warnings
import gymnasium, highway_env, jax
from regents_cosim.envs import LiveAdversary
from regents_cosim.errors import RegentsError

warnings.simplefilter("ignore")
jax.devices()
env = sys.argv[1]
how = dict(vectorization_mode="async", vector_kwargs={"context": "fork"})
envs = gymnasium.make_vec(env, num_envs=2, wrappers=[LiveAdversary] if env == "highway-fast-v0" else [], **how)
try:
    envs.reset(seed=0)
except RegentsError as error:
    print(error)
envs.close()
"""


def said_by(code, *words):
    command = [sys.executable, "-c", code, *words]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout


@pytest.mark.slow
def test_a_program_in_a_forked_process():
    said = said_by(FORK, "at work")
    assert "forked from one that has used JAX" in said
    assert "forkserver" in said
    assert said_by(FORK, "not yet") == "2.0\n"


BASELINES = """
import sys, warnings
import gymnasium, highway_env, jax, numpy as np
from stable_baselines3.common.vec_env import SubprocVecEnv
from regents_cosim.envs import LiveAdversary

warnings.simplefilter("ignore")
make = lambda: LiveAdversary(gymnasium.make("highway-fast-v0"))
if __name__ == "__main__":
    jax.devices()
    envs = SubprocVecEnv([make] * 2, start_method=sys.argv[1])
    envs.seed(0)
    envs.reset()
    envs.step(np.array([1, 1]))
    print("stepped")
"""


@pytest.mark.slow
@pytest.mark.parametrize("env", ["highway-fast-v0", "regents/SumoReplay-v0"])
def test_environments_side_by_side_in_forked_processes(env):
    assert 'AsyncVectorEnv(..., context="forkserver")' in said_by(VECTOR, env)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["fork", "forkserver"])
def test_environments_of_stable_baselines(how, tmp_path):
    """A process of theirs that fails says why and dies; none of those that are left open prints a traceback."""
    pytest.importorskip("stable_baselines3", reason="needs the extra sb3")
    script = tmp_path / "side_by_side.py"
    script.write_text(BASELINES)
    done = subprocess.run([sys.executable, script, how], capture_output=True, text=True, check=False, timeout=200)
    if how == "fork":
        assert 'SubprocVecEnv(..., start_method="forkserver")' in done.stderr
        assert done.returncode == 1
    else:
        assert (done.returncode, done.stdout, done.stderr) == (0, "stepped\n", "")
