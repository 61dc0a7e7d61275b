"""`python:INTERPRETER:PLANNER`: a planner that runs in an environment of its own, with versions that clash with ours.

The interpreter of that environment hosts the planner (`host_server`). This package is not installed there: its modules
are loaded from their folder here, and the environment needs the packages of `NEEDED` beside those of the planner.
"""

import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from regents_cosim.errors import PlannerError
from regents_cosim.planners.find import require_planner
from regents_cosim.planners.time_limits import MAKE_TIMEOUT_S
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.standard_streams import keep_stdout_for_results, results

PREFIX = "python:"
NEEDED = ("numpy", "msgspec", "shapely", "jaxtyping")  # what `host_server` imports
_OLDEST = (3, 11)
_CHECK_S = 60.0  # longest time that an interpreter may take to report what it lacks
_CHECK = (
    "import sys, importlib.util as u; "
    "print(*sys.version_info[:2], *(name for name in sys.argv[1:] if u.find_spec(name) is None))"
)
# Load this package from its folder, whose neighbours, our other packages, stay out of sight.
LOAD = (
    "import importlib.util as u; place = sys.argv.pop(1); "
    "spec = u.spec_from_file_location('regents_cosim', place + '/__init__.py', submodule_search_locations=[place]); "
    "sys.modules['regents_cosim'] = package = u.module_from_spec(spec); spec.loader.exec_module(package); "
)
_FIND = (
    f"import sys; {LOAD}from regents_cosim.planners.hosting.own_interpreter import tell_what_is_wrong as tell; "
    "tell(sys.argv.pop(1))"
)
FOLDER = str(Path(__file__).parents[2])  # of this package


@dataclass(frozen=True)
class OwnInterpreter:
    """An interpreter, and the planner that it is to run."""

    python: str
    planner: str

    @classmethod
    def named(cls, name: str) -> "OwnInterpreter | None":
        """The interpreter and the planner of a name; None for a name without the prefix. Raises PlannerError."""
        if not name.startswith(PREFIX):
            return None
        python, _, planner = name.removeprefix(PREFIX).partition(":")
        if not python or ":" not in planner:
            raise PlannerError(f"planner {name!r}, expected {PREFIX}INTERPRETER:FILE.py:CLASS")
        return cls(python, planner)

    def check(self) -> None:
        """Raise PlannerError for an interpreter that cannot host a planner, or does not find it."""
        _check(self.python)
        _find(self.python, self.planner)


@cache
def _check(python: str) -> None:
    what = f"interpreter {python!r} of the planner"
    if shutil.which(python) is None:
        raise PlannerError(f"{what} is neither an executable file nor on the PATH")
    try:
        asked = [python, "-P", "-c", _CHECK, *NEEDED]
        said = subprocess.run(asked, capture_output=True, text=True, timeout=_CHECK_S, stdin=subprocess.DEVNULL)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise PlannerError(f"{what} cannot be run: {error}") from error
    answer = said.stdout.split()
    if said.returncode or len(answer) < 2 or not all(part.isdecimal() for part in answer[:2]):
        raise PlannerError(f"{what} is no Python {_named(_OLDEST)} or newer")
    if (version := (int(answer[0]), int(answer[1]))) < _OLDEST:
        raise PlannerError(f"{what} is Python {_named(version)}, expected {_named(_OLDEST)} or newer")
    if missing := answer[2:]:
        raise PlannerError(f"{what} lacks {', '.join(missing)}: {python} -m pip install {' '.join(missing)}")


@cache
def _find(python: str, planner: str) -> None:
    what = f"planner {planner!r} in {python!r}"
    try:
        asked = [python, "-P", "-c", _FIND, FOLDER, planner]
        said = subprocess.run(
            asked, stdout=subprocess.PIPE, text=True, timeout=MAKE_TIMEOUT_S, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired:  # a drive may have more time
        return
    if said.returncode or said.stdout:
        raise PlannerError(said.stdout or f"{what}: the interpreter ended with {said.returncode} when it looked it up")


def tell_what_is_wrong(planner: str) -> None:
    """In that interpreter: print why it does not find the planner; nothing where it does."""
    keep_stdout_for_results()
    try:
        with foreign_code(lambda error: PlannerError(f"planner {planner!r} cannot be made: {said_by(error)}")):
            require_planner(planner)
    except PlannerError as error:
        lacks = f"; install it with {sys.executable} -m pip" if isinstance(error.__cause__, ModuleNotFoundError) else ""
        results().write(f"{error}{lacks}")
    results().flush()


def _named(version: tuple[int, int]) -> str:
    return ".".join(map(str, version))
