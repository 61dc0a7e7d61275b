"""Imports modules that a user names (a planner, a policy, a network), together with the modules beside them.

`FILE.py` finds what `python FILE.py` finds, its own folder first; `package.module` finds what `python -m
package.module` finds, the working directory first. A folder within a suite is never searched, since a suite may come
from a stranger and could contain a `numpy.py`.
"""

import importlib
import importlib.util
import inspect
import sys
import threading
import traceback
from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import FrameType, FunctionType, ModuleType
from typing import Any

from regents_cosim.errors import PlannerError
from regents_cosim.system.foreign_code import foreign_code, said_by

_SEARCHED: list[Path] = []  # folders of users on sys.path
_LOCK = threading.RLock()
_IMPORTS: list[int] = []  # the thread that imports a module of a user, once for each that it is importing


def plugins(group: str) -> dict[str, EntryPoint]:
    """What other packages add to a group of entry points, by name."""
    return {point.name: point for point in entry_points(group=group)}


def place_of(name: str, group: str) -> tuple[str, str, bool]:
    """Module and attribute of an entry point, or of `module:attribute`, and whether it is installed.

    The module is empty for a name of neither kind.
    """
    point = plugins(group).get(name)
    module_name, _, attribute = (point.value if point else name).rpartition(":")
    return module_name, attribute, point is not None


def import_named(module_name: str, what: str, installed: bool = False) -> ModuleType:
    """Import a module by its dotted name, or a Python file by its path. `what` says in errors what it is needed for.

    For an `installed` module no folder is searched. Raises PlannerError with the module's own error and its line.
    """
    hint, is_file = "", module_name.endswith(".py")

    def failed(error: BaseException) -> PlannerError:
        name = Path(module_name).stem if is_file else module_name
        line = _last_line(error, lambda frame: frame.f_globals.get("__name__") == name)
        return PlannerError(
            f"{what} cannot be imported: {said_by(error)}{line}{hint if isinstance(error, ImportError) else ''}"
        )

    with foreign_code(failed), _LOCK:
        if not installed:
            hint = _search_first(Path(module_name).resolve().parent if is_file else Path.cwd())
        _IMPORTS.append(threading.get_ident())
        try:
            return _import_file(Path(module_name)) if is_file else importlib.import_module(module_name)
        finally:
            _IMPORTS.pop()


def is_importing() -> bool:
    """Whether this thread is importing a module that a user names."""
    return threading.get_ident() in _IMPORTS


def searched_first() -> list[str]:
    """The folders of users on `sys.path`, in its order."""
    with _LOCK:
        of_users = set(map(str, _SEARCHED))
        return [place for place in sys.path if place in of_users]


def names_beside(class_: type) -> dict[str, Any]:
    """The names in the module of a class, also of one imported by its path, which `sys.modules` does not list."""
    module = sys.modules.get(class_.__module__)
    if module is not None and getattr(module, class_.__name__, None) is class_:
        return vars(module)
    functions = (one for one in vars(class_).values() if isinstance(one, FunctionType))
    return next((inspect.unwrap(one).__globals__ for one in functions), {})


def suite_around(folder: Path) -> Path | None:
    """The suite, or the case, that `folder` is or lies in; None where there is none."""
    places = (folder, *folder.parents)
    return next((p for p in places if (p / "suite.json").exists() or (p / "scenario.json").exists()), None)


def line_beside(error: BaseException, class_: type) -> str:
    """The last line that an error passed in the module of a class or in one beside it, in brackets; else empty."""
    home = Path(names_beside(class_).get("__file__", "")).resolve().parent
    return _last_line(error, lambda frame: Path(frame.f_code.co_filename).resolve().parent == home)


def _last_line(error: BaseException, is_theirs: Callable[[FrameType], bool]) -> str:
    lines = [(frame, number) for frame, number in traceback.walk_tb(error.__traceback__) if is_theirs(frame)]
    return "".join(f" ({Path(frame.f_code.co_filename).name}, line {number})" for frame, number in lines[-1:])


def _import_file(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look up their module. A loaded module of that name stays.
    registered = sys.modules.setdefault(path.stem, module)
    try:
        spec.loader.exec_module(module)
    finally:
        if registered is module:
            sys.modules.pop(path.stem, None)
    return module


def _search_first(folder: Path) -> str:
    """Put `folder` first on sys.path, and forget equally named modules from other folders of users.

    So two versions of a planner, each with its `model.py`, can run in one process. Returns the reason if the folder is
    not searched, for the error message.
    """
    suite = suite_around(folder)
    if suite is not None:
        return f" (modules are not looked for in {folder}, which lies in the suite {suite})"
    if str(folder) in sys.path:
        sys.path.remove(str(folder))
    sys.path.insert(0, str(folder))
    others = [other for other in _SEARCHED if other != folder]
    _SEARCHED[:] = [folder, *others]
    importlib.invalidate_caches()  # files may be newer than the caches of the finders
    _forget(folder, others)
    return ""


def _forget(folder: Path, others: list[Path]) -> None:
    """Forget modules that were found in `others` and are in `folder` too."""
    if not others:
        return
    roots = [(name, module) for name, module in list(sys.modules.items()) if "." not in name]
    moved = [name for name, module in roots if home_of(module) in others]
    hidden = {name for name in moved if (folder / f"{name}.py").is_file() or (folder / name).is_dir()}
    for name in [name for name in sys.modules if name.partition(".")[0] in hidden]:
        del sys.modules[name]


def home_of(module: ModuleType) -> Path | None:
    """The folder in which a module or a package lies; None where it lies in none."""
    spec = getattr(module, "__spec__", None)
    if spec is None:
        return None
    if spec.submodule_search_locations is not None:
        return next((Path(place).parent for place in spec.submodule_search_locations), None)
    return Path(spec.origin).parent if spec.has_location else None
