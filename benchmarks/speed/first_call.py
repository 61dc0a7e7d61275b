"""Prints the seconds until a new process has an attack's program: traced and compiled, or loaded."""

import sys
from pathlib import Path
from time import perf_counter

import jax.numpy as jnp

sys.path.append(str(Path(__file__).parents[2] / "tests/support"))

from timing import dense_traffic, job

from regents_cosim.attacks.descent.search import look_and_descend
from regents_cosim.attacks.methods.presets import KING
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs

keep_compiled_programs()
planner, wanted = job(dense_traffic(32), "idm")
begin = perf_counter()
look_and_descend.lower(wanted, planner, KING.compiled(), None, jnp.int32(1), jnp.int32(500)).compile()
print(perf_counter() - begin)
