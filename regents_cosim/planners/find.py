"""Planners by name: an entry point, `package.module:attribute`, `path/to/file.py:attribute`, or a bridge.

No JAX here: processes that host a planner need none.
"""

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

from regents_cosim.errors import PlannerError
from regents_cosim.planners.interface import Planner
from regents_cosim.user_code import import_named

# Somebody else's kind of planner behind a prefix: `exec:./my_planner --fast`. What the factory gets is the rest.
# Modules by name, as entry points are: those that need the simulators of `replays` are found there.
BRIDGES: dict[str, str] = {
    "aim-bev": "regents_cosim.planners.aim_bev.planner:aim_bev",
    "exec": "regents_cosim.planners.exec_planner:ExecPlanner",
    "highway": "regents_cosim.replays.highway_ego:HighwayEgo",
    "sumo": "regents_cosim.replays.sumo_ego:SumoEgo",
    "torch": "regents_cosim.planners.torch_bridge:TorchPlanner",
}


def find_attribute(name: str) -> Any:
    """What a name stands for: a planner, or something that makes one without arguments. Raises PlannerError."""
    known = {point.name: point.value for point in entry_points(group="regents_cosim.planners")}
    bridge, _, rest = name.partition(":")
    if bridge in BRIDGES and name not in known:
        factory: Callable[[str], Planner] = find_attribute(BRIDGES[bridge])
        return lambda: factory(rest)
    module_name, _, attribute = known.get(name, name).rpartition(":")
    if not module_name:
        raise PlannerError(
            f"planner {name!r} not found, expected one of {', '.join(sorted(known))}, sumo, "
            "aim-bev:WEIGHTS, highway:AGENT, torch:MODULE, exec:COMMAND, "
            "`package.module:attribute` or `file.py:attribute`"
        )
    found = getattr(import_named(module_name, f"planner {name!r}"), attribute, None)
    if found is None:
        raise PlannerError(f"planner {name!r}: {module_name} has no {attribute!r}")
    return found


def make_planner(name: str) -> Planner:
    """The host planner that `name` stands for. Raises PlannerError where there is none, or what the planner raises."""
    found: Any = find_attribute(name)
    planner: Any = found if _is_planner(found) else found() if callable(found) else found
    if not _is_planner(planner):
        raise no_planner(name, planner)
    return planner


def no_planner(name: str, found: Any) -> PlannerError:
    """What to say of something that is no planner."""
    return PlannerError(
        f"planner {name!r} is a {type(found).__name__}, expected a JaxPlanner, "
        "or an object with `reset(scene)` and `act(observation)`"
    )


def _is_planner(found: Any) -> bool:
    """An object, not the class of it: that has `reset` and `act` too."""
    return isinstance(found, Planner) and not isinstance(found, type)
