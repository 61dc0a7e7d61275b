"""A tree of the package's own values as plain JSON and its arrays, and made of these again.

For trees that outlive a process: nothing is unpickled, nothing imported but the package's (and optax's) own names.
"""

import dataclasses
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import jax

_OWN = ("regents_cosim.", "optax.")


class NoOutlineError(TypeError):
    """A tree holds what has no outline, such as a function, a class or a value from outside."""


def outline(tree: Any, arrays: list[Any]) -> Any:
    """`tree` as plain JSON, with arrays as their types; they are appended to `arrays`. Raises NoOutlineError."""
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
    """The tree that an outline is of, with the next of `arrays` for each of its own."""
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
    """As it was: without `__init__`, which would convert and check what has been converted and checked."""
    if issubclass(kind, tuple):
        return tuple.__new__(kind, values)
    made = object.__new__(kind)
    for field, value in zip(dataclasses.fields(kind), values, strict=True):
        object.__setattr__(made, field.name, value)
    return made


def _name(what: Any) -> str:
    """Where `what` is found. Raises NoOutlineError where it is not there, or not ours."""
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
        found = getattr(found, part, None)  # what its own name does not lead to has no outline
    return found
