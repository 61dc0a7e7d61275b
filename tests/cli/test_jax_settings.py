"""Whatever a process has set for JAX, results are those of single precision; with no device one line says so."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from command import regents
from jaxtyping import Array
from mirror_drives import replay_in_mirror
from scenes import scene
from shipped_cases import crash_on

from regents_cosim import ControlArrays, JaxPlanner
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import OURS, REGENTS
from regents_cosim.mirror.programs.jax_settings import each_in_float32, in_float32
from regents_cosim.verdicts.judge import judge

BUSY = scene((0, 0, 10), (20, 3.2, 8), (30, 3.2, 9), steps=30)
QUICK = REGENTS.but(iterations=3)
DOUBLE = """
import jax
import jax.numpy as jnp
from regents_cosim import ControlArrays, JaxPlanner

jax.config.update("jax_enable_x64", True)
HALF = jnp.asarray(0.5)


class Sets(JaxPlanner):
    def step(self, memory, sight, ego):
        return ControlArrays(HALF * (10.0 - ego.speed), jnp.float32(0.0)), memory
"""


class Holds(JaxPlanner):
    """An array of the precision in which it was made."""

    gain: Array

    def step(self, memory, sight, ego):
        return ControlArrays(self.gain * (10.0 - ego.speed), jnp.float32(0.0)), memory


def same_tracks(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("x", "y", "yaw", "speed"))


@pytest.mark.slow
def test_attacks_and_drives_are_the_same_in_a_process_of_double_precision():
    plain = [judge(case) for case in attack([BUSY], QUICK)]
    with jax.enable_x64(True):
        double = [judge(case) for case in attack([BUSY], QUICK)]
        assert jnp.asarray(1.0).dtype == np.float64
        assert same_tracks(replay_in_mirror(BUSY, "idm"), replay_in_mirror(BUSY, "idm"))
    assert [case.attack for case in double] == [case.attack for case in plain]
    assert all(same_tracks(one.tracks, other.tracks) for one, other in zip(double, plain, strict=True))


@pytest.mark.slow
def test_so_are_those_of_a_planner_that_was_made_in_double_precision():
    plain = replay_in_mirror(BUSY, Holds(jnp.asarray(0.5)))
    with jax.enable_x64(True):
        assert same_tracks(replay_in_mirror(BUSY, Holds(jnp.asarray(0.5))), plain)


@pytest.mark.slow
def test_so_are_those_in_a_process_that_promotes_no_arrays():
    plain = [judge(case) for case in attack([BUSY], OURS.but(iterations=3))]
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        strict = [judge(case) for case in attack([BUSY], OURS.but(iterations=3))]
        assert same_tracks(replay_in_mirror(BUSY, "idm"), replay_in_mirror(BUSY, "idm"))
    assert all(same_tracks(one.tracks, other.tracks) for one, other in zip(strict, plain, strict=True))


def test_who_takes_items_goes_on_as_before():
    @each_in_float32
    def makes():
        for _ in range(2):
            yield jnp.asarray(1.0).dtype

    with jax.enable_x64(True):
        for made in makes():
            assert (made, jnp.asarray(1.0).dtype) == (np.float32, np.float64)
        assert in_float32(lambda: jnp.asarray(1.0).dtype)() == np.float32


def words(command, out):
    crossing = ("-c", "shipped:crossing", "--horizon", "4", "--json", "--quiet", "-o", out)
    return {
        "evaluate": ("evaluate", crash_on("crossing"), "--planner", "idm", "--json", "--quiet"),
        "in sumo": ("evaluate", crash_on("crossing"), "--planner", "idm", "--json", "--quiet", "--in", "sumo"),
        "attack": ("attack", *crossing, "--count", 1, "--no-pictures", "--method", "regents", "--iterations", 3),
        "live": ("live", *crossing, "--longest", "3", "--no-pictures"),
    }[command]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["evaluate", "in sumo", "attack"])
def test_commands_say_the_same(command, tmp_path):
    zero, one = (regents(*words(command, "out"), cwd=folder(tmp_path, x), JAX_ENABLE_X64=x) for x in "01")
    assert zero.returncode == one.returncode == 0, one.stderr
    assert zero.stdout == one.stdout


@pytest.mark.slow
def test_live_runs(tmp_path):
    done = regents(*words("live", "out"), cwd=tmp_path, JAX_ENABLE_X64="1", code=0)
    assert "detached" not in done.stderr


def folder(parent, name):
    (parent / name).mkdir()
    return parent / name


@pytest.mark.slow
@pytest.mark.parametrize("where", ["mirror", "sumo"])
def test_a_planner_may_set_double_precision(where, tmp_path):
    (tmp_path / "sets.py").write_text(DOUBLE)
    regents("evaluate", crash_on("crossing"), "--planner", f"{tmp_path}/sets.py:Sets", "--in", where, code=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "platform"),
    [("evaluate", "nonsense"), ("evaluate", "cuda"), ("in sumo", "nonsense"), ("attack", "tpu"), ("live", "nonsense")],
)
def test_a_device_that_is_not_there(command, platform, tmp_path):
    if platform == "cuda" and any(device.platform == "gpu" for device in jax.devices()):
        pytest.skip("there is one")
    done = regents(*words(command, "out"), cwd=tmp_path, JAX_PLATFORMS=platform, code=3)
    (line,) = done.stderr.splitlines()
    assert f"JAX has no device with JAX_PLATFORMS={platform}" in line


@pytest.mark.slow
@pytest.mark.parametrize("where", ["mirror", "sumo"])
def test_a_device_that_is_not_there_in_pytest(where, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--regents-suite", "shipped:quickstart",
         "--regents-planner", "idm", "--regents-in", where],
        capture_output=True, text=True, cwd=tmp_path, env=os.environ | {"JAX_PLATFORMS": "nonsense"},
    )  # fmt: skip
    assert done.returncode == 4, done.stdout + done.stderr
    assert "JAX has no device with JAX_PLATFORMS=nonsense" in done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
