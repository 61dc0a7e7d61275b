"""Keep traced programs on disk, beside the compiled ones.

JAX keeps compiled programs, but every process has to trace its Python again. So the trace is kept too (StableHLO, by
`jax.export`), under a digest of everything that tracing depends on: the package's code, the versions of the libraries,
the compiled-in values, and the shapes. A program that contains foreign code, such as a planner or a cost, is traced
every time; so is a program with values that it was not given (a closure).
"""

import hashlib
import json
import shutil
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from inspect import unwrap
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import export

from regents_cosim.mirror.programs.compiling import COMPILING
from regents_cosim.mirror.programs.outline import NoOutlineError, outline, rebuild
from regents_cosim.system.edited_code import is_edited
from regents_cosim.system.files.atomic import write_atomic
from regents_cosim.system.progress import DOING

# Worth: `attack -c shipped:crossing --count 2 --planner idm`, with all programs compiled before, takes 10.5 s of CPU in
# place of 14.5, and 0.68 of the time (medians, and mean ratio, of 5 pairs).
_PACKAGE = Path(__file__).parents[2]
_LIBRARIES = ("jax", "jaxlib", "equinox", "optax", "numpy")
_VERSIONS = 4  # versions of the package whose traces are kept
_kept_in: list[Path] = []  # the folder, if there is one

_Kept = tuple[export.Exported, list[Any], Any]


def keep_traced_programs(folder: Path | None) -> None:
    """Keep traces in `folder` from now on; None: trace every time."""
    _kept_in[:] = [folder] if folder else []


def traced(function: Callable[..., Any], given: tuple[Any, ...], named: dict[str, Any]) -> Any:
    """Call `function` while JAX traces a program, by a kept trace if there is one.

    Raises whatever `function` raises.
    """
    kept = _kept(function, given, named) if _may_keep(function) else None
    if kept is None:
        with DOING.during(COMPILING):
            return function(*given, **named)
    program, arrays, returned = kept
    return rebuild(returned, iter(program.call(*arrays)))


def _may_keep(function: Callable[..., Any]) -> bool:
    """Whether a trace may be kept: there is a folder, and the code has not been edited since it was loaded."""
    return bool(_kept_in) and _is_ours(function) and not is_edited(_PACKAGE)


def _is_ours(function: Callable[..., Any]) -> bool:
    """Whether the package's code alone decides what the function does."""
    name = f"{function.__module__}.{function.__qualname__}"
    return (
        name.startswith("regents_cosim.") and "<" not in name and getattr(unwrap(function), "__closure__", ()) is None
    )


def _kept(function: Callable[..., Any], given: tuple[Any, ...], named: dict[str, Any]) -> _Kept | None:
    """The trace, its inputs and the outline of its result; None where no trace can be kept."""
    arrays: list[Any] = []
    try:
        plain = outline([list(given), list(named), list(named.values())], arrays)
        file = _kept_in[0] / version_of(_PACKAGE) / f"{function.__name__}-{_digest(function, plain)}"
        program, returned = _load(file) or _trace(function, plain, arrays, file)
    except (NoOutlineError, OSError, ValueError, NotImplementedError):  # the last two: JAX cannot export it
        return None
    return program, arrays, returned


def _load(file: Path) -> tuple[export.Exported, Any] | None:
    try:
        checksum, returned, program = file.read_bytes().split(b"\n", 2)
    except (FileNotFoundError, ValueError):
        return None
    if hashlib.sha256(returned + program).hexdigest().encode() != checksum:
        return None
    return export.deserialize(bytearray(program)), json.loads(returned)


def _trace(function: Callable[..., Any], plain: Any, arrays: list[Any], file: Path) -> tuple[export.Exported, Any]:
    """Trace a function and keep the program in `file`, with the outline of its result."""
    returned: list[Any] = []

    def flat(*values: Any) -> list[Any]:
        given, names, named = rebuild(plain, iter(values))
        made: list[Any] = []
        returned.append(outline(function(*given, **dict(zip(names, named, strict=True))), made))
        return made

    shapes = [jax.ShapeDtypeStruct(array.shape, array.dtype, weak_type=array.weak_type) for array in arrays]
    with DOING.during(COMPILING):
        exported = export.export(jax.jit(flat))(*shapes)
    head, program = json.dumps(returned[-1]).encode(), bytes(exported.serialize())
    _make_room(file.parent)
    write_atomic(file, hashlib.sha256(head + program).hexdigest().encode() + b"\n" + head + b"\n" + program)
    return exported, returned[-1]


def _make_room(folder: Path) -> None:
    """Make the folder for this version of the package, and remove those of old versions."""
    if folder.exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    versions = sorted(folder.parent.iterdir(), key=lambda one: one.stat().st_mtime, reverse=True)
    for old in versions[_VERSIONS:]:
        shutil.rmtree(old, ignore_errors=True)


def _digest(function: Callable[..., Any], plain: Any) -> str:
    """A digest of what the trace of a function depends on within one version of the package."""
    where = (function.__module__, function.__qualname__, jax.default_backend(), str(jnp.result_type(float)))
    return hashlib.sha256(json.dumps([where, plain]).encode()).hexdigest()


@cache
def version_of(package: Path) -> str:
    """A digest of a package's code and of the versions of the libraries that it traces with."""
    digest = hashlib.sha256(" ".join(f"{library} {version(library)}" for library in _LIBRARIES).encode())
    for file in sorted(package.rglob("*.py")):
        content = file.read_bytes()
        digest.update(f"\n{file.relative_to(package)} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]
