"""The package's requirements of JAX, independent of the environment and of other code: float32, a device, a cache."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

import jax

from regents_cosim.errors import MissingDependencyError
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs

_P = ParamSpec("_P")
_R = TypeVar("_R")

# The settings for which the package's programs are written, each with what sets it for a block.
_OURS: tuple[tuple[str, Any, Callable[[Any], AbstractContextManager[object]]], ...] = (
    ("jax_enable_x64", False, jax.enable_x64),
    ("jax_numpy_rank_promotion", "allow", jax.numpy_rank_promotion),
    ("jax_numpy_dtype_promotion", "standard", jax.numpy_dtype_promotion),
)


def in_float32(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """A decorator that runs `function` in single precision, even in a process that computes in double precision.

    Arrays are promoted as by default, even where the process is stricter. Results are defined so. The decorator belongs
    on functions that take cases and return cases or numbers, where their thread begins. Raises MissingDependencyError
    where JAX has no device.
    """

    @wraps(function)
    def single(*given: _P.args, **named: _P.kwargs) -> _R:
        require_device()
        others = [block(value) for name, value, block in _OURS if getattr(jax.config, name) != value]
        if not others:
            return function(*given, **named)
        with ExitStack() as stack:
            for one in others:
                stack.enter_context(one)
            return function(*given, **named)

    return single


def each_in_float32(function: Callable[_P, Iterator[_R]]) -> Callable[_P, Iterator[_R]]:
    """A decorator like `in_float32` for generators: each item is computed in single precision."""

    @wraps(function)
    def single(*given: _P.args, **named: _P.kwargs) -> Iterator[_R]:
        made, further = function(*given, **named), in_float32(next)
        with suppress(StopIteration):
            while True:
                yield further(made)

    return single


@contextmanager
def settings_kept() -> Iterator[None]:
    """A block after which JAX has the settings that it had before."""
    before = _settings()
    try:
        yield
    finally:
        for name in [name for name, value in _settings().items() if before.get(name, value) != value]:
            jax.config.update(name, before[name])


def _settings() -> dict[str, Any]:
    return jax.config.values  # pyright: ignore[reportAttributeAccessIssue]  # a new dictionary each time


@cache
def require_device() -> None:
    """Prepare JAX for the first program of a process: check its device, keep programs, run them in the calling thread.

    Raises MissingDependencyError where JAX has no device, as with JAX_PLATFORMS=cuda on a machine without one, and
    RegentsError where others can write to the folder of programs.
    """
    keep_compiled_programs()
    # To hand a program to another thread, on a CPU, takes as long as a step of a planner's drive.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    try:
        jax.devices()
    except Exception as error:  # each kind of device has its own error
        asked = jax.config.jax_platforms  # pyright: ignore[reportAttributeAccessIssue]
        said = str(error).strip().partition("\n")[0] or type(error).__name__
        raise MissingDependencyError(
            f"JAX has no device with JAX_PLATFORMS={asked or ''}: {said} (JAX_PLATFORMS=cpu works everywhere)"
        ) from error
