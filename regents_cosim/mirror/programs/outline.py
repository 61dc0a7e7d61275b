"""Convert a tree of the package's values to plain JSON with separate arrays, and back.

Such trees outlive a process: nothing is unpickled, and only names of this package and of optax are imported.
"""

import dataclasses
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import jax

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
