"""The planner under test: found once, with its name and the place where it runs, and then passed on.

A planner in JAX runs inside the compiled loop. Any other runs in its own process, which can be ended when it hangs; an
object that cannot leave its process is asked where it is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from regents_cosim.checks.names import require_id
from regents_cosim.errors import PlannerError
from regents_cosim.mirror.programs.jax_settings import settings_kept
from regents_cosim.planners.find import find_attribute, no_planner
from regents_cosim.planners.hosting.object_transport import Pickled, name_of, pickled, unpickled
from regents_cosim.planners.hosting.own_interpreter import OwnInterpreter
from regents_cosim.planners.hosting.torch_bridge import TorchPlanner, is_torch
from regents_cosim.planners.hosting.torch_in_loop import in_loop
from regents_cosim.planners.interface import Planner
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.planners.names import OURS, is_built_in
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.process_kept import process_kept

_SHORT_NAMES = {place: name for name, place in OURS.items()}

Where = Literal["compiled loop", "own process", "this process"]


@dataclass(frozen=True, eq=False, repr=False)
class PlannerUnderTest(ShortRepr):
    """A planner with its name on disk and in tables, and the place where it runs."""

    name: str
    loop: JaxPlanner | None = None  # for the compiled loop
    source: str | Pickled | None = None  # for another process to make it; None: it cannot leave this process
    here: Planner | None = None  # asked in this process

    @classmethod
    def of(cls, planner: Any, *, name: str = "", own_process: bool = True) -> "PlannerUnderTest":
        """Find a planner by name, or take an object, its class, or a function that makes one without arguments.

        Names are as on the command line. An object is called `module:QualifiedName`, or `name`. Without `own_process` a
        planner outside JAX is asked in this process: a debugger can step through it, and it can be inspected
        afterwards, but if it hangs, the caller hangs. Raises PlannerError.
        """
        if isinstance(planner, PlannerUnderTest):
            return planner
        said = planner if isinstance(planner, str) else type(planner).__name__

        def failed(error: BaseException) -> PlannerError:  # of its attributes, comparisons or pickling
            return PlannerError(f"planner {said!r} cannot be looked at: {said_by(error)}")

        with process_kept(), settings_kept(), foreign_code(failed):
            given = _named(planner) if isinstance(planner, str) else _by_object(planner, own_process)
        return replace(given, name=_own_name(name)) if name and not isinstance(planner, str) else given

    @property
    def where(self) -> Where:
        """The place where it runs."""
        if self.loop is not None:
            return "compiled loop"
        return "this process" if self.source is None else "own process"

    @property
    def ticket(self) -> "PlannerTicket | None":
        """The value from which another process makes the planner; None if it cannot leave this process."""
        return None if self.source is None else PlannerTicket(self.name, self.source, self.loop is not None)

    def __reduce__(self) -> tuple[Callable[..., "PlannerUnderTest"], tuple["PlannerTicket"]]:
        """Pickled as its ticket, so that another process makes the planner. Raises PlannerError where none can."""
        if self.ticket is None:
            raise PlannerError(f"planner {self.name!r} cannot leave its process: give it by name")
        return PlannerTicket.planner, (self.ticket,)


@dataclass(frozen=True)
class PlannerTicket:
    """A planner for another process."""

    name: str
    source: str | Pickled
    in_loop: bool

    def planner(self) -> PlannerUnderTest:
        """The planner in that process, which imports it only for the compiled loop. Raises PlannerError."""
        if not self.in_loop:
            return PlannerUnderTest(self.name, source=self.source)
        if isinstance(self.source, str):
            return PlannerUnderTest.of(self.source)
        return PlannerUnderTest(self.name, unpickled(self.source), self.source)


# Every function of the package that takes a planner accepts these.
AnyPlanner = str | Planner | JaxPlanner | Callable[[], Any] | PlannerUnderTest


def _named(name: str) -> PlannerUnderTest:
    if elsewhere := OwnInterpreter.named(name):
        elsewhere.check()
        return PlannerUnderTest(name, source=name)
    found = find_attribute(name)
    made = found if _acts(found) else _made(name, found)  # a class is only called in its own process
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


def _name(planner: Any) -> str:
    name = name_of(planner)
    if name in _SHORT_NAMES:
        return _SHORT_NAMES[name]
    return f"object:{name}" if is_built_in(name) else name  # a user's module may be called `idm`


def _torch(name: str, planner: TorchPlanner, source: str | Pickled | None) -> PlannerUnderTest:
    """The planner of a torch module; a translated module is sent as such, so that it is translated once."""
    translated = in_loop(planner)
    if translated is not None:
        return PlannerUnderTest(name, translated, pickled(translated))
    return PlannerUnderTest(name, source=source, here=planner if source is None else None)


def _made(name: str, found: Any) -> Any:
    """A planner in JAX unchanged, else what `found` makes without arguments. Raises PlannerError for the rest."""
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
    """Whether it is an object with `reset` and `act`, or a class of such objects, outside JAX."""
    is_jax = isinstance(found, JaxPlanner) or (isinstance(found, type) and issubclass(found, JaxPlanner))
    return not is_jax and all(callable(getattr(found, name, None)) for name in ("reset", "act"))


def _own_name(name: str) -> str:
    """Check a name that the caller has chosen: cases must never take it for a built-in planner. Raises PlannerError."""
    require_id(name, "the planner's name")
    if is_built_in(name) or any(character.isspace() for character in name):
        raise PlannerError(f"planner name {name!r}: expected one without blanks that none of ours has")
    return name
