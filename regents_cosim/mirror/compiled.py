"""How the package's programs for the device are compiled.

XLA's CPU backend has two emitters of code. Its default writes kernels through MLIR and takes longer to compile an
attack (2.5 s in place of 1.5 s), for iterations that are hardly shorter. And it uses half of a 512-bit register unless
it is told to use all, which saves 7 to 20 % of an attack.

Products of matrices are in full single precision. On GPUs JAX's default cuts their factors to ten bits (TF32): a
position at 100 m would be off by 5 cm.
"""

from collections.abc import Callable, Mapping
from functools import partial, wraps
from threading import RLock
from typing import Any

import equinox as eqx
import jax

from regents_cosim.mirror.compiling import tell_of_compiling
from regents_cosim.mirror.forked import require_own_threads
from regents_cosim.mirror.jax_settings import require_device
from regents_cosim.mirror.program_room import make_room
from regents_cosim.mirror.traces import traced

# Known to the versions of JAX that pyproject.toml allows; another may refuse them by name.
COMPILER_OPTIONS: Mapping[str, bool | int] = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_prefer_vector_width": 512}

_new: list[str] = []  # programs traced since there was last looked for room
_made: set[Any] = set()  # programs, by function and shapes, that are there
_turn = RLock()


def compiled(function: Any = None, **how: Any) -> Any:
    """`function` as one program: arrays are its inputs, whatever else it is given is compiled in.

    A decorator, with what `equinox.filter_jit` takes besides. JAX wants such programs apart: none calls another.
    """
    if function is None:
        return partial(compiled, **how)
    jit: Any = eqx.filter_jit
    program = jit(_precise(function), compiler_options=COMPILER_OPTIONS, **how)

    @wraps(function)
    def run(*given: Any, **named: Any) -> Any:
        require_own_threads()
        if _new:
            _new.clear()
            if make_room():
                _made.clear()
        wanted = (function, *(getattr(leaf, "shape", None) for leaf in jax.tree.leaves((given, named))))
        if wanted in _made:
            return program(*given, **named)
        require_device()
        with _turn:  # of threads that want the same new program one makes it, and the others wait for it
            result = program(*given, **named)
        _made.add(wanted)
        return result

    vars(run)["lower"] = program.lower  # to look at what is compiled
    return run


def _precise(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def precise(*given: Any, **named: Any) -> Any:
        _new.append(function.__name__)
        with jax.default_matmul_precision("highest"):
            return traced(function, given, named)

    return precise


tell_of_compiling()
