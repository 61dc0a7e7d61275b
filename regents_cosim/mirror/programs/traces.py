"""Keep traced programs on disk, beside the compiled ones.

JAX keeps compiled programs, but every process has to trace its Python again. So the trace is kept too (StableHLO, by
`jax.export`), under a digest of everything that tracing depends on: the package's code, the versions of the libraries,
the compiled-in values, and the shapes. A program that contains foreign code, such as a planner or a cost, is traced
every time; so is a program with values that it was not given (a closure).
"""

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import version
from inspect import unwrap
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import export

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


COMPILING = "compiling once, about 30 s"
_PROGRAM = "/jax/core/compile/backend_compile_duration"


@cache
def tell_of_compiling() -> None:
    """Report compilations in this process from now on."""
    jax.monitoring.register_scalar_listener(_begun)
    jax.monitoring.register_event_duration_secs_listener(_done)


def _begun(event: str, value: float | int, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.begin(COMPILING)


def _done(event: str, duration_secs: float, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.end()


# Convert a tree of the package's values to plain JSON with separate arrays, and back.
# Such trees outlive a process: nothing is unpickled, and only names of this package and of optax are imported.
_OWN = ("regents_cosim.", "optax.")


class NoOutlineError(TypeError):
    """A tree holds a value that has no outline, such as a function, a class or a foreign object."""


def outline(tree: Any, arrays: list[Any]) -> Any:
    """Convert `tree` to plain JSON; its arrays are appended to `arrays`. Raises NoOutlineError."""
    if tree is None or type(tree) in (bool, int, float, str):
        return tree
    if isinstance(tree, jax.Array):
        arrays.append(tree)
        return {"array": [str(tree.dtype), *tree.shape], "weak": tree.weak_type}
    if type(tree) in (list, tuple):
        return {type(tree).__name__: [outline(part, arrays) for part in tree]}
    if isinstance(tree, type) or hasattr(tree, "__qualname__"):
        return {"name": _name(tree)}
    return {"of": _name(type(tree)), "fields": [outline(getattr(tree, f), arrays) for f in _fields(tree)]}


def rebuild(plain: Any, arrays: Iterator[Any]) -> Any:
    """Convert an outline back to a tree, with the next of `arrays` for each of its arrays."""
    match plain:
        case {"array": _}:
            return next(arrays)
        case {"list": parts}:
            return [rebuild(part, arrays) for part in parts]
        case {"tuple": parts}:
            return tuple(rebuild(part, arrays) for part in parts)
        case {"name": name}:
            return _named(name)
        case {"of": name, "fields": parts}:
            return _made(_named(name), [rebuild(part, arrays) for part in parts])
    return plain


def _fields(tree: Any) -> list[str]:
    if isinstance(tree, tuple):
        return list(getattr(tree, "_fields", ()))
    if not dataclasses.is_dataclass(tree):
        raise NoOutlineError(f"{type(tree).__name__} has no outline: neither a dataclass nor a named tuple")
    return [field.name for field in dataclasses.fields(tree)]


def _made(kind: type, values: list[Any]) -> Any:
    """Make a value without `__init__`, which would convert and check its fields once more."""
    if issubclass(kind, tuple):
        return tuple.__new__(kind, values)
    made = object.__new__(kind)
    for field, value in zip(dataclasses.fields(kind), values, strict=True):
        object.__setattr__(made, field.name, value)
    return made


def _name(what: Any) -> str:
    """The name under which `what` can be imported. Raises NoOutlineError for a foreign or unreachable object."""
    name = f"{getattr(what, '__module__', '')}:{what.__qualname__}"
    if not name.startswith(_OWN) or "<" in name or _named(name) is not what:
        raise NoOutlineError(f"{name} is not a name of the package's")
    return name


def _named(name: str) -> Any:
    module, _, path = name.partition(":")
    if not name.startswith(_OWN):
        raise NoOutlineError(f"{name} is not a name of the package's")
    found: Any = import_module(module)
    for part in path.split("."):
        found = getattr(found, part, None)  # an object that its own name does not lead to has no outline
    return found
