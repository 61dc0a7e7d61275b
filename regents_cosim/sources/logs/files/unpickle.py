"""Reads pickles without running any of their code: containers, numbers, text and NumPy arrays only.

Python's own unpickler imports and calls what a file names. This one knows the instructions of `pickletools` and a few
names (arrays, their numbers and types, sets, `bytes`, `int`, `defaultdict`), and calls none of them: it builds an array
from its bytes, which protocol 2 writes as text in Latin-1. Every other name is refused. Keys of dictionaries are text
or numbers, since hashing deeply nested tuples overflows the stack. The size of the file bounds the memory.
"""

import io
import pickletools
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from regents_cosim.errors import LogError

_NAMES = {
    ("numpy", "ndarray"), ("numpy", "dtype"), ("collections", "defaultdict"), ("_codecs", "encode"),
    *((builtins, name) for builtins in ("builtins", "__builtin__") for name in ("int", "set", "bytes")),
    *(
        (f"numpy.{core}.{module}", name)
        for core in ("core", "_core")  # before and since NumPy 2
        for module, name in (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"))
    ),
}  # fmt: skip
_DTYPES = "fiubUS"  # NumPy's kinds of numbers and text that an array may hold
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_VALUES = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT", "STRING", "BINSTRING",
    "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES",
    "BINBYTES8", "BYTEARRAY8",
}  # fmt: skip
_MOST_KEY = 1 << 63  # thousands of larger integers may share one hash
_MARK = object()


class _Name(tuple[str, str]):
    """A name that a pickle may use."""


class _Type:
    """A NumPy type that is being read."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.order: Any = "|"

    def build(self, state: Any) -> "_Type":
        """Set the byte order."""
        self.order = state[1]
        return self

    def values(self, content: bytes | bytearray) -> np.ndarray:
        """The numbers or texts of this type in `content`. Raises ValueError for any other type."""
        if not re.fullmatch(rf"[{_DTYPES}]\d{{1,9}}", self.name):
            raise ValueError(f"an array of {self.name[:10]!r}")
        return np.frombuffer(content, np.dtype(self.name).newbyteorder(self.order))


class _Array:
    """An array whose content has not been read yet."""

    def __init__(self) -> None:
        self.places: list[int] = []  # of this array in the memo

    def build(self, state: Any) -> Any:
        """The array; a list where it holds objects."""
        _, shape, kind, fortran, data = state
        if isinstance(data, list):
            return data
        return kind.values(data).reshape(shape, order="F" if fortran else "C")


def unpickle(content: bytes) -> Any:
    """The content of a pickle. Raises LogError where it is damaged or names anything but arrays."""
    machine = _Machine()
    try:
        for instruction, argument, _ in pickletools.genops(io.BytesIO(content)):
            if instruction.name == "STOP":
                return machine.stack.pop()
            machine.run(instruction.name, argument)
    except LogError:
        raise
    except (ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError, UnicodeError) as error:
        raise LogError(f"damaged or truncated pickle ({str(error)[:200] or type(error).__name__})") from error
    raise LogError("truncated pickle (it does not end)")


class _Machine:
    """The stack machine that a pickle is a program for: a stack and a memo."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.memo: dict[int, Any] = {}
        self._encoded: dict[str, bytes] = {}

    def run(self, name: str, argument: Any) -> None:
        """Carry out one instruction."""
        if name in _VALUES:
            self.stack.append(argument)
        elif name in _CONSTANTS:
            self.stack.append(_CONSTANTS[name])
        elif name in _STEPS:
            _STEPS[name](self, argument)
        else:
            raise LogError(f"the pickle uses the instruction {name}, expected numbers, text and arrays only")

    def since_mark(self) -> list[Any]:
        """Remove and return all values down to the last mark."""
        at = len(self.stack) - 1
        while self.stack[at] is not _MARK:
            at -= 1
            if at < 0:
                raise ValueError("no mark")
        found = self.stack[at + 1 :]
        del self.stack[at:]
        return found

    def put(self, place: int) -> None:
        """Store the topmost value in the memo."""
        top = self.stack[-1]
        self.memo[place] = top
        if isinstance(top, _Array):
            top.places.append(place)

    def name(self, module: str, name: str) -> None:
        """Push a global name. Raises for a name that is not allowed."""
        _require_text(module, name)
        if (module, name) not in _NAMES:
            raise LogError(
                f"the pickle asks for {module[:60]}.{name[:60]}, which is not a name that a ScenarioNet "
                "file needs; refused, nothing of it was run"
            )
        self.stack.append(_Name((module, name)))

    def call(self) -> None:
        """Build an array, a number, a type or a dictionary; every other call is refused."""
        arguments, function = self.stack.pop(), self.stack.pop()
        if not isinstance(function, _Name):
            raise ValueError("a call of something that is not a name")
        if function[1] == "_reconstruct":
            self.stack.append(_Array())
        elif function[1] == "dtype":
            self.stack.append(_Type(_require_text(arguments[0])))
        elif function[1] == "_frombuffer":
            content, kind, shape, order = arguments
            self.stack.append(kind.values(content).reshape(shape, order="F" if order == "F" else "C"))
        elif function[1] == "scalar":
            kind, content = arguments
            self.stack.append(kind.values(content)[0].item())
        elif function[1] == "defaultdict":
            self.stack.append({})
        elif function[1] == "set":
            (members,) = arguments
            if not isinstance(members, list):
                raise ValueError("a set of something that is not a list")
            self.stack.append(members)
        elif function[1] == "encode" and arguments[1:] in (("latin1",), ("latin-1",)):
            self.stack.append(self.encoded(arguments[0]))
        elif function[1] == "bytes" and arguments == ():
            self.stack.append(b"")
        else:
            raise ValueError(f"a call of {function[1]}")

    def encoded(self, text: Any) -> bytes:
        """The bytes of a text in Latin-1, the same ones each time, as a file may name one text many times."""
        if _require_text(text) not in self._encoded:
            self._encoded[text] = text.encode("latin-1")
        return self._encoded[text]

    def build(self) -> None:
        """Give an array or a type its content."""
        state, target = self.stack.pop(), self.stack.pop()
        if not isinstance(target, _Array | _Type):
            raise ValueError("content for something that is not an array")
        if isinstance(target, _Array) and isinstance(state[-1], str):
            state = (*state[:-1], self.encoded(state[-1]))
        made = target.build(state)
        if isinstance(target, _Array):
            for place in target.places:
                self.memo[place] = made
        self.stack.append(made)

    def set_items(self, items: list[Any]) -> None:
        """Add items to the dictionary on top of the stack."""
        target = self.stack[-1]
        if not isinstance(target, dict) or len(items) % 2:
            raise ValueError("items for something that is not a dictionary")
        for key, value in zip(items[::2], items[1::2], strict=True):
            is_huge = isinstance(key, int) and abs(key) >= _MOST_KEY
            if not isinstance(key, str | int | float | bytes | None) or is_huge:
                raise ValueError("a key that is neither text nor a number of 64 bits")
            target[key] = value

    def append(self, items: list[Any]) -> None:
        """Add items to the list on top of the stack."""
        if not isinstance(self.stack[-1], list):
            raise ValueError("items for something that is not a list")
        self.stack[-1].extend(items)

    def tuple_of(self, count: int) -> None:
        """Replace the topmost `count` values by a tuple of them."""
        if len(self.stack) < count:
            raise ValueError("the stack is empty")
        values = tuple(self.stack[-count:])
        del self.stack[-count:]
        self.stack.append(values)


def _require_text(*values: Any) -> str:
    """The first value, once all are known to be text: lists and tuples may contain themselves a billion times."""
    if not all(isinstance(value, str) for value in values):
        raise ValueError("something that is not a text where one is expected")
    return values[0]


def _dictionary(machine: _Machine, _: Any) -> None:
    items = machine.since_mark()
    machine.stack.append({})
    machine.set_items(items)


def _pop_two(machine: _Machine) -> list[Any]:
    value, key = machine.stack.pop(), machine.stack.pop()
    return [key, value]


_STEPS: dict[str, Callable[[_Machine, Any], None]] = {
    "PROTO": lambda machine, _: None,
    "FRAME": lambda machine, _: None,
    "MARK": lambda machine, _: machine.stack.append(_MARK),
    "EMPTY_DICT": lambda machine, _: machine.stack.append({}),
    **dict.fromkeys(("EMPTY_LIST", "EMPTY_SET"), lambda machine, _: machine.stack.append([])),
    "EMPTY_TUPLE": lambda machine, _: machine.stack.append(()),
    "LIST": lambda machine, _: machine.stack.append(machine.since_mark()),
    "TUPLE": lambda machine, _: machine.stack.append(tuple(machine.since_mark())),
    "TUPLE1": lambda machine, _: machine.tuple_of(1),
    "TUPLE2": lambda machine, _: machine.tuple_of(2),
    "TUPLE3": lambda machine, _: machine.tuple_of(3),
    "DICT": _dictionary,
    "APPEND": lambda machine, _: machine.append([machine.stack.pop()]),
    **dict.fromkeys(("APPENDS", "ADDITEMS"), lambda machine, _: machine.append(machine.since_mark())),
    "SETITEM": lambda machine, _: machine.set_items(_pop_two(machine)),
    "SETITEMS": lambda machine, _: machine.set_items(machine.since_mark()),
    "MEMOIZE": lambda machine, _: machine.put(len(machine.memo)),
    **dict.fromkeys(("PUT", "BINPUT", "LONG_BINPUT"), lambda machine, place: machine.put(place)),
    **dict.fromkeys(("GET", "BINGET", "LONG_BINGET"), lambda machine, place: machine.stack.append(machine.memo[place])),
    "GLOBAL": lambda machine, names: machine.name(*names.split(" ", 1)),
    "STACK_GLOBAL": lambda machine, _: machine.name(*_pop_two(machine)),
    "REDUCE": lambda machine, _: machine.call(),
    "BUILD": lambda machine, _: machine.build(),
}
