"""Planners that a user hands over as objects: their names, and their transport to another process.

An object is sent by cloudpickle: parts of modules by name; classes of a notebook, a script or a function by value. It
goes from the user's process to processes that this one starts, never back, and never to disk. This is the only module
that uses cloudpickle.
"""

import dataclasses
import importlib.machinery
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec

from regents_cosim.errors import PlannerError
from regents_cosim.system.foreign_code import foreign_code, said_by

_PLAIN = (bool, int, float, str, type(None))


class Pickled(msgspec.Struct, tag=True, frozen=True):
    """A planner, or something that makes one without arguments, for another process of the same user."""

    content: bytes


def pickled(planner: Any) -> Pickled | None:
    """Pickle a planner for another process; None where it cannot leave this one."""
    import cloudpickle

    module = _hidden_module(planner)
    try:
        if module is not None:
            cloudpickle.register_pickle_by_value(module)
        return Pickled(cloudpickle.dumps(planner))
    except Exception:  # its parts may raise anything: locks, sockets, open files
        return None
    finally:
        if module is not None:
            cloudpickle.unregister_pickle_by_value(module)


def unpickled(planner: Pickled) -> Any:
    """Unpickle the planner in the other process. Raises PlannerError."""
    import cloudpickle

    def failed(error: BaseException) -> PlannerError:
        return PlannerError(
            f"the object cannot be made again in a process of its own: {said_by(error)} "
            "(PlannerUnderTest.of(planner, own_process=False) lets it drive where it is)"
        )

    with foreign_code(failed):
        return cloudpickle.loads(planner.content)


def name_of(planner: Any) -> str:
    """The name `module:QualifiedName` of a class, a function, or the class of an object, as it may be imported.

    Fields of a dataclass with other values than the defaults follow, as in `module:Mine(gap_m=20.0)`. A class of a
    script is called `script.py:Mine`, one of a notebook `__main__:Mine`.
    """
    named = planner if hasattr(planner, "__qualname__") else type(planner)
    return f"{_home(named)}:{named.__qualname__}{_changed(planner)}"


def _home(named: Any) -> str:
    module = getattr(named, "__module__", None) or "__main__"
    if module != "__main__":
        return module
    main = sys.modules["__main__"]
    if spec := getattr(main, "__spec__", None):  # run by `python -m`
        return spec.name
    file = getattr(main, "__file__", None)
    return Path(file).name if file and Path(file).is_file() else module


def _changed(planner: Any) -> str:
    if isinstance(planner, type) or not dataclasses.is_dataclass(planner):
        return ""
    values = {field: getattr(planner, field.name, None) for field in dataclasses.fields(planner) if field.init}
    changed = [f"{field.name}={_short(value)}" for field, value in values.items() if not _is_default(field, value)]
    return f"({','.join(changed)})" if changed else ""


def _is_default(field: "dataclasses.Field[Any]", value: Any) -> bool:
    default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
    try:
        return value is default or (type(value) is type(default) and bool(value == default))
    except Exception:  # arrays of several numbers are neither equal nor unequal
        return False


def _short(value: Any) -> str:
    return "".join(repr(value).split()) if isinstance(value, _PLAIN) else "..."


def _hidden_module(planner: Any) -> ModuleType | None:
    """The module of a planner if another process would not find it by its name."""
    name = getattr(planner if hasattr(planner, "__qualname__") else type(planner), "__module__", None)
    module = sys.modules.get(name or "")
    if name is None or module is None or name == "__main__" or _is_found(name):
        return None
    return module


def _is_found(name: str) -> bool:
    """Whether a dotted name is found along `sys.path`, as in a new process."""
    if name in sys.builtin_module_names:
        return True
    places, whole = None, ""
    for part in name.split("."):
        whole = f"{whole}.{part}" if whole else part
        spec = importlib.machinery.PathFinder.find_spec(whole, places)
        if spec is None:
            return False
        places = list(spec.submodule_search_locations or ())
    return True
