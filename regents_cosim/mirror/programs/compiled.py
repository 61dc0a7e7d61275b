"""Compile the package's programs for the device.

XLA's CPU backend has two code emitters. The default one writes kernels through MLIR and takes much longer to compile an
attack, for iterations that are hardly shorter. By default XLA also uses half of a 512-bit register.

Matrix products use full single precision. On GPUs JAX's default would cut the factors to ten bits (TF32), and a
position at 100 m would be off by 5 cm.
"""

import gc
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial, wraps
from pathlib import Path
from threading import RLock
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from regents_cosim.mirror.programs.forked import require_own_threads
from regents_cosim.mirror.programs.jax_settings import require_device
from regents_cosim.system.progress import DOING

# The versions of JAX that pyproject.toml allows know these; another version may refuse them by name.
COMPILER_OPTIONS: Mapping[str, bool | int] = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_prefer_vector_width": 512}

_Tree = TypeVar("_Tree")

_new: list[str] = []  # programs traced since the last check for room
_made: set[Any] = set()  # existing programs, by function and shapes
_turn = RLock()


def compiled(function: Any = None, **how: Any) -> Any:
    """A decorator that compiles `function` to one program: arrays are its inputs, all other arguments are compiled in.

    It takes the further options of `equinox.filter_jit`. Such programs must not call each other.
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
        with _turn, _no_collection():  # one of several threads that need a new program makes it, and the others wait
            result = program(*given, **named)
        _made.add(wanted)
        return result

    vars(run)["lower"] = program.lower  # to inspect what is compiled
    return run


@contextmanager
def _no_collection() -> Iterator[None]:
    """Collect no garbage meanwhile: a trace makes a million objects that stay, and they would be searched often."""
    on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if on:
            gc.enable()


def _precise(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def precise(*given: Any, **named: Any) -> Any:
        _new.append(function.__name__)
        with jax.default_matmul_precision("highest"):
            return function(*given, **named)

    return precise


def mapped_with(some: Array, values: _Tree) -> _Tree:
    """The same values, mapped wherever a `vmap` maps `some`, whose shape fits theirs.

    JAX maps the body of a loop again for every part of its state that only the body turns out to map. A start that is
    mapped as a whole halves the time that tracing such a loop takes.
    """
    either = some == 0
    return jax.tree.map(lambda value: jnp.where(either, value, value), values)


COMPILING = "compiling once, about 30 s"
_PROGRAM = "/jax/core/compile/backend_compile_duration"


def _begun(event: str, value: float | int, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.begin(COMPILING)


def _done(event: str, duration_secs: float, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.end()


jax.monitoring.register_scalar_listener(_begun)
jax.monitoring.register_event_duration_secs_listener(_done)


# Each program takes dozens of the memory maps that Linux grants a process. Where none is left, the compiler ends the
# process (a segmentation fault). A run over many places meets that limit: other numbers of vehicles and other roads are
# other shapes, and each shape has its own programs.
_GRANTED = Path("/proc/sys/vm/max_map_count")
_TAKEN = Path("/proc/self/maps")
_SHARE = 0.5  # of the granted maps: two simultaneous compilations take far less than the rest


def make_room() -> bool:
    """Forget all compiled programs if they take half of the memory maps that the process may have.

    Programs that are needed again are compiled again or read from disk. Returns whether programs were forgotten; False
    where the system does not tell its limit.
    """
    granted = maps_granted()
    if granted is None or maps_taken() <= _SHARE * granted:
        return False
    jax.clear_caches()
    gc.collect()
    return True


@cache
def maps_granted() -> int | None:
    """The number of memory maps that a process may have; None where the system does not tell."""
    try:
        return int(_GRANTED.read_text())
    except (OSError, ValueError):
        return None


def maps_taken() -> int:
    """The number of memory maps of this process."""
    try:
        with _TAKEN.open("rb") as lines:
            return sum(1 for _ in lines)
    except OSError:
        return 0
