"""The planner under test: looked up once, with what it is called and where it runs, and then handed on.

A planner in JAX runs inside the compiled loop. Any other runs in a process of its own, which may end it when it hangs;
an object that cannot leave the process that it is in is asked where it is.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Literal

from regents_cosim.brief import Brief
from regents_cosim.checks.names import require_id
from regents_cosim.errors import PlannerError
from regents_cosim.planners.find import find_attribute, no_planner
from regents_cosim.planners.interface import Planner
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.planners.names import OURS, is_built_in
from regents_cosim.planners.own_object import Pickled, name_of, pickled, unpickled
from regents_cosim.planners.torch_bridge import TorchPlanner, is_torch
from regents_cosim.planners.torch_in_loop import in_loop
from regents_cosim.system.foreign_code import foreign_code, said_by

_SHORT_NAMES = {place: name for name, place in OURS.items()}

Where = Literal["compiled loop", "own process", "this process"]


@dataclass(frozen=True, eq=False, repr=False)
class PlannerUnderTest(Brief):
    """A planner, what it is called on disk and in tables, and where it runs."""

    name: str
    loop: JaxPlanner | None = None  # what the compiled loop runs
    source: str | Pickled | None = None  # what another process makes it from; None: it cannot leave this one
    here: Planner | None = None  # what is asked in this process

    @classmethod
    def of(cls, planner: Any, *, name: str = "", own_process: bool = True) -> "PlannerUnderTest":
        """A planner by its name, or the object itself, its class, or what makes one without arguments.

        Names are as on the command line. An object is called `module:QualifiedName`, or `name`. Without `own_process`
        one that is not in JAX is asked in this process: it can be stepped through in a debugger and looked at
        afterwards, and a planner that hangs hangs the caller. Raises PlannerError.
        """
        if isinstance(planner, PlannerUnderTest):
            return planner
        with _looked_at(planner if isinstance(planner, str) else type(planner).__name__):
            given = _named(planner) if isinstance(planner, str) else _by_object(planner, own_process)
        return replace(given, name=_own_name(name)) if name and not isinstance(planner, str) else given

    @property
    def where(self) -> Where:
        """Where it runs."""
        if self.loop is not None:
            return "compiled loop"
        return "this process" if self.source is None else "own process"

    @property
    def ticket(self) -> "PlannerTicket | None":
        """The value from which another process makes the planner; None if it cannot leave this process."""
        return None if self.source is None else PlannerTicket(self.name, self.source, self.loop is not None)


@dataclass(frozen=True)
class PlannerTicket:
    """A planner for another process."""

    name: str
    source: str | Pickled
    in_loop: bool

    def planner(self) -> PlannerUnderTest:
        """The planner in that process. Raises PlannerError."""
        if isinstance(self.source, str):
            return PlannerUnderTest.of(self.source)
        return PlannerUnderTest(self.name, unpickled(self.source) if self.in_loop else None, self.source)


# What every function of the package takes that lets a planner drive.
AnyPlanner = str | Planner | JaxPlanner | Callable[[], Any] | PlannerUnderTest


def _named(name: str) -> PlannerUnderTest:
    found = find_attribute(name)
    made = found if _acts(found) else _made(name, found)  # a class is called by its own process alone
    if isinstance(made, TorchPlanner):
        return _torch(name, made, source=name)
    return PlannerUnderTest(name, made if isinstance(made, JaxPlanner) else None, source=name)


def _by_object(planner: Any, own_process: bool) -> PlannerUnderTest:
    name = _name(planner)
    if is_torch(planner):
        made = TorchPlanner(name, planner)
        return _torch(name, made, pickled(made))
    made = planner if _acts(planner) else _made(name, planner)
    if isinstance(made, JaxPlanner):
        return PlannerUnderTest(name, made, pickled(made))
    source = pickled(planner) if own_process else None
    if source is not None:
        return PlannerUnderTest(name, source=source)
    return PlannerUnderTest(name, here=_made(name, made) if isinstance(made, type) else made)


def _looked_at(name: str) -> AbstractContextManager[None]:
    """While a planner is looked at, which may run code of its own: attributes, comparisons, pickling."""
    return foreign_code(lambda error: PlannerError(f"planner {name!r} cannot be looked at: {said_by(error)}"))


def _name(planner: Any) -> str:
    name = name_of(planner)
    if name in _SHORT_NAMES:
        return _SHORT_NAMES[name]
    return f"object:{name}" if is_built_in(name) else name  # of a module of the user's that is called `idm`


def _torch(name: str, planner: TorchPlanner, source: str | Pickled | None) -> PlannerUnderTest:
    """A translated module travels as such: it is translated once."""
    translated = in_loop(planner)
    if translated is not None:
        return PlannerUnderTest(name, translated, pickled(translated))
    return PlannerUnderTest(name, source=source, here=planner if source is None else None)


def _made(name: str, found: Any) -> Any:
    """A planner in JAX as it is, or what is made without arguments. Raises PlannerError for anything else."""
    if isinstance(found, JaxPlanner):
        return found
    if not callable(found):
        raise no_planner(name, found)
    with foreign_code(
        lambda error: PlannerError(
            f"planner {name!r} cannot be made: {said_by(error)} (it is called without arguments)"
        )
    ):
        made = found()
    if not isinstance(made, JaxPlanner) and not _acts(made):
        raise no_planner(name, made)
    return made


def _acts(found: Any) -> bool:
    """Whether it is asked step by step: an object, or the class of it."""
    is_jax = isinstance(found, JaxPlanner) or (isinstance(found, type) and issubclass(found, JaxPlanner))
    return not is_jax and all(callable(getattr(found, name, None)) for name in ("reset", "act"))


def _own_name(name: str) -> str:
    """A name that the caller has chosen; cases are never to take it for one of ours. Raises PlannerError."""
    require_id(name, "the planner's name")
    if is_built_in(name) or any(character.isspace() for character in name):
        raise PlannerError(f"planner name {name!r}: expected one without blanks that none of ours has")
    return name
