"""Systems under test by name: planners in JAX as they are, all others by the name that their process is told."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from regents_cosim.errors import PlannerError, RegentsError
from regents_cosim.planners.find import find_attribute, no_planner
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.planners.patience import ACT_TIMEOUT_S as ACT_TIMEOUT_S
from regents_cosim.planners.torch_bridge import TorchPlanner
from regents_cosim.planners.torch_in_loop import in_loop


@dataclass(frozen=True)
class HostPlanner:
    """A planner that is not in JAX; a process of its own makes it (`host_process`)."""

    name: str


def find_planner(name: str) -> JaxPlanner | HostPlanner:
    """A planner by its name, as `package.module:attribute` or as `path/to/file.py:attribute`.

    The attribute is a planner or something that makes one without arguments. Names come from the
    entry points `regents_cosim.planners`. Raises PlannerError.
    """
    found = find_attribute(name)
    if isinstance(found, JaxPlanner):
        return found
    if _acts(found):  # an object, or a class that only its own process is to call
        return HostPlanner(name)
    if not callable(found):
        raise no_planner(name, found)
    made = _made(name, found)
    if isinstance(made, JaxPlanner):
        return made
    if isinstance(made, TorchPlanner):
        return in_loop(made) or HostPlanner(name)
    if not _acts(made):
        raise no_planner(name, made)
    return HostPlanner(name)


def _made(name: str, maker: Callable[[], Any]) -> Any:
    """What `maker` makes, without arguments."""
    try:
        return maker()
    except RegentsError:
        raise
    except Exception as error:  # whatever a user's code raises is the user's answer
        raise PlannerError(
            f"planner {name!r} cannot be made: {type(error).__name__}: {error} (it is called without arguments)"
        ) from error


def _acts(found: Any) -> bool:
    return not (isinstance(found, type) and issubclass(found, JaxPlanner)) and all(
        callable(getattr(found, name, None)) for name in ("reset", "act")
    )
