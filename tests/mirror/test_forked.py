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
from regents_cosim.mirror.compiled import compiled

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
import functools, warnings
import gymnasium, highway_env, jax
from regents_cosim.envs import LiveAdversary
from regents_cosim.errors import RegentsError

warnings.simplefilter("ignore")
jax.devices()
how = dict(vectorization_mode="async", wrappers=[LiveAdversary], vector_kwargs={"context": "fork"})
envs = gymnasium.make_vec("highway-fast-v0", num_envs=2, **how)
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


@pytest.mark.slow
def test_environments_side_by_side_in_forked_processes():
    assert 'AsyncVectorEnv(..., context="forkserver")' in said_by(VECTOR)
