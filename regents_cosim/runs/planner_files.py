"""Find the user's files that make up a planner; their content decides what it does, whatever its name.

No code is run: imports are followed to files that belong to no installed package, and files that a string names exactly
(weights, settings) count as well. A name that the planner puts together while it runs is not seen.
"""

import ast
import hashlib
import shlex
import site
import sys
import sysconfig
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.cases.provenance import sha256_of
from regents_cosim.errors import PlannerError
from regents_cosim.planners.find import GROUP, bridge_of
from regents_cosim.planners.names import is_built_in
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.system.user_code import names_beside, place_of

_MOST_FILES = 10_000
_NAME_LETTERS = 300  # a longer string names no file


def planner_digest(name: str) -> str:
    """A digest of the files of a planner; empty for a planner of this package, which the version identifies."""
    return _digest(planner_files(name))


def _digest(files: set[Path]) -> str:
    """A digest of files; empty for none."""
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(f"{file.name}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()[:20] if files else ""


def digest_of(planner: PlannerUnderTest) -> str:
    """The digest of a planner that was looked up: an object counts with its fields and with the files of its class.

    Raises PlannerError for an object that cannot leave its process, for nothing tells whether it has changed.
    """
    if isinstance(planner.source, str):
        return planner_digest(planner.source)
    if planner.source is None:
        raise PlannerError(f"planner {planner.name!r} cannot be pickled, so no run can go on with it: give it by name")
    return hashlib.sha256(planner_digest(planner.name).encode() + planner.source.content).hexdigest()[:20]


def method_digest(method: AttackConfig) -> str:
    """A digest of the files of a user's method; empty for a method of this package."""
    file = names_beside(type(method)).get("__file__")
    return _digest(_closure([Path(file)]) if file else set())


def planner_files(name: str) -> set[Path]:
    """The user's files behind a planner's name, as typed on the command line."""
    if is_built_in(name):
        return set()
    bridge = bridge_of(name)
    if not bridge:
        return _closure(_module_files(place_of(name, GROUP)[0]))
    rest = name.partition(":")[2]
    words = shlex.split(rest) if bridge == "exec" else [rest]
    named = [Path(word) for word in words if _is_file(Path(word))]
    modules = [file for word in words for file in _module_files(word.rpartition(":")[0])]
    return _closure([*named, *modules])


def _closure(begin: list[Path]) -> set[Path]:
    """The files, and all the user's files that they import or name."""
    found: set[Path] = set()
    waiting = [path.resolve() for path in begin]
    while waiting and len(found) < _MOST_FILES:
        path = waiting.pop()
        if path in found or not _is_users(path):
            continue
        found.add(path)
        if path.suffix == ".py":
            waiting += _mentioned(path)
    return found


def _mentioned(path: Path) -> Iterator[Path]:
    """The files that a Python file imports, or names in a string."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _module_files(alias.name, path.parent)
        elif isinstance(node, ast.ImportFrom):
            yield from _imported_from(node, path)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and 0 < len(node.value) < _NAME_LETTERS:
            yield from (at.resolve() for at in (path.parent / node.value, Path(node.value)) if _is_file(at))


def _imported_from(node: ast.ImportFrom, path: Path) -> Iterator[Path]:
    base = path.parent
    for _ in range(node.level - 1):
        base = base.parent
    module = node.module or ""
    for name in ("", *(alias.name for alias in node.names)):
        dotted = ".".join(filter(None, (module, name)))
        if node.level:
            yield from _below(base, dotted.split(".") if dotted else [])
        elif dotted:
            yield from _module_files(dotted, path.parent)


def _module_files(dotted: str, beside: Path | None = None) -> list[Path]:
    """The files of a module and of its parent packages; empty for an installed module."""
    if not dotted:
        return []
    if dotted.endswith(".py"):
        return [Path(dotted)] if _is_file(Path(dotted)) else []
    places = [str(place) for place in (beside, Path.cwd()) if place is not None] + sys.path
    found: list[Path] = []
    for part in dotted.split("."):
        try:
            spec = PathFinder.find_spec(part, places)
        except (ImportError, ValueError):
            break
        if spec is None:
            break
        if spec.origin and spec.has_location:
            found.append(Path(spec.origin))
            if not _is_users(found[-1].resolve()):
                return []
        places = list(spec.submodule_search_locations or ())
        if not places:
            break
    return found


def _below(base: Path, parts: list[str]) -> Iterator[Path]:
    """The existing files of a module below a folder, and of its packages there."""
    for depth in range(1, len(parts) + 1):
        at = base.joinpath(*parts[:depth])
        yield from filter(_is_file, (at.with_name(f"{at.name}.py"), at / "__init__.py"))


def _is_users(path: Path) -> bool:
    """Whether a file belongs to no installed package, nor to Python or this package."""
    return not any(path.is_relative_to(place) for place in _installed())


def _installed() -> list[Path]:
    places = {*sysconfig.get_paths().values(), *site.getsitepackages(), site.getusersitepackages()}
    ours = Path(__file__).parents[1]
    return [ours, *(Path(place).resolve() for place in places if place not in (sys.prefix, sys.base_prefix))]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a string that is not a valid name
        return False
