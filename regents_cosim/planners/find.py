"""Find planners by name: built-in ones, entry points, `package.module:attribute`, `path/to/file.py:attribute`, bridges.

A planner that the user names is run. A planner that a case names is not, as the case may come from a stranger (see
`planner_of`). This module does not import JAX, which processes that host a planner do not need.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from pkgutil import resolve_name
from typing import Any

from regents_cosim.checks.names import did_you_mean, nearest
from regents_cosim.errors import PlannerError
from regents_cosim.planners.hosting.object_transport import Pickled, name_of, unpickled
from regents_cosim.planners.interface import Planner
from regents_cosim.planners.names import OURS, WITH_SETTINGS, all_that_may_be_named, is_built_in
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.user_code import import_named, place_of, plugins

GROUP = "regents_cosim.planners"  # of entry points
_BRIDGES = ("aim-bev", "exec", "highway", "sumo", "torch")  # prefixes, as in `exec:./my_planner --fast`


def planner_of(case: Scenario, named: str | None = None) -> str:
    """The name of the planner for `case`: the one that the user `named`, otherwise the one that it was attacked with.

    A case is data, and may come from anywhere: the planner that it names must be a built-in one. Raises PlannerError
    for any other.
    """
    if named:
        return named
    if case.attack is None:
        raise PlannerError(f"case {case.id} was never attacked, and names no planner: name one with --planner")
    name = case.attack.planner
    if not is_built_in(name):
        raise PlannerError(
            f"case {case.id} was attacked with planner {name!r}, which does not come with regents_cosim; what a "
            "case names is not run: name the planner yourself, with --planner"
        )
    return name


def attacked_planner(cases: Sequence[Scenario]) -> str:
    """The planner that the cases were attacked with. Raises PlannerError unless it is a single built-in one."""
    planners = {planner_of(case) for case in cases if case.attack}
    if len(planners) != 1:
        raise PlannerError("the cases do not name one planner that was attacked; name it with --planner")
    return planners.pop()


def find_attribute(name: str) -> Any:
    """The object behind a name: a planner, or something that makes one without arguments. Raises PlannerError."""
    if name in OURS:
        return resolve_name(OURS[name])
    prefix, _, rest = name.partition(":")
    if prefix in WITH_SETTINGS:
        return lambda: _made_with(resolve_name(OURS[prefix]), prefix, rest)
    if prefix in OURS and "=" in rest and prefix not in _BRIDGES:
        raise PlannerError(f"planner {name!r}: {prefix} has no settings, expected {prefix} alone")
    if bridge := bridge_of(name):
        factory = _factory_of(bridge)
        return lambda: factory(rest)
    module_name, attribute, installed = place_of(name, GROUP)
    if not module_name:
        raise _unknown(name, tuple(plugins(GROUP)))
    module = import_named(module_name, f"planner {name!r}", installed=installed)
    found: Any = module
    for part in attribute.split("."):  # may be a class inside a class
        found = getattr(found, part, None)
    if found is None:
        own = [
            one for one, what in vars(module).items() if isinstance(what, type) and what.__module__ == module.__name__
        ]
        hint = did_you_mean(attribute, own) if own else "it defines no class"
        raise PlannerError(f"planner {name!r}: {module_name} has no {attribute!r} ({hint})")
    return found


def bridge_of(name: str) -> str:
    """The bridge that makes the planner of that name; empty for other names, also where an entry point has it."""
    prefix = name.partition(":")[0]
    return prefix if prefix in _BRIDGES and name not in plugins(GROUP) else ""


def _factory_of(bridge: str) -> Callable[[str], Any]:
    """What makes the Planner or JaxPlanner from the text after the prefix; imported when such a planner is named."""
    if bridge == "aim-bev":
        from regents_cosim.planners.aim_bev.planner import aim_bev

        return aim_bev
    if bridge == "exec":
        from regents_cosim.planners.hosting.exec_planner import ExecPlanner

        return ExecPlanner
    if bridge == "highway":
        from regents_cosim.replays.highway.ego import HighwayEgo

        return HighwayEgo
    if bridge == "sumo":
        from regents_cosim.replays.sumo.ego import SumoEgo

        return SumoEgo
    from regents_cosim.planners.hosting.torch_bridge import TorchPlanner

    return TorchPlanner


def _unknown(name: str, installed: tuple[str, ...]) -> PlannerError:
    if name.endswith(".py"):
        return PlannerError(f"planner {name!r} is a file: name the planner in it as well, {name}:CLASS")
    if name.endswith((".zip", ".cleanrl_model")):
        return PlannerError(f"planner {name!r} is a file: a policy for highway-env is named highway:{name}")
    if near := nearest(name, (*OURS, *installed), 3):
        return PlannerError(f"planner {name!r} not found: did you mean {' or '.join(near)}?")
    return PlannerError(f"planner {name!r} not found, expected one of {all_that_may_be_named(installed)}")


def _made_with(make: Any, name: str, settings: str) -> Any:
    """What the class `make` of the planner `name` makes with settings, as in `idm:time_headway=0.2,max_accel=1.5`."""
    numbers = [one.name for one in fields(make) if isinstance(one.default, float)]
    return make(**dict(_setting(name, numbers, word) for word in settings.split(",")))


def _setting(planner: str, known: list[str], word: str) -> tuple[str, float]:
    name, _, number = word.partition("=")
    if name not in known:
        raise PlannerError(
            f"{planner} has no setting {name!r}, expected {planner}:SETTING=NUMBER with one of {', '.join(known)}"
        )
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise PlannerError(f"{planner}:{name} is {number!r}, expected a number of 0 or more")
    return name, value


def make_planner(source: str | Pickled) -> Planner:
    """Make the host planner of that name or object. Raises PlannerError, or whatever the planner raises."""
    found: Any = find_attribute(source) if isinstance(source, str) else unpickled(source)
    planner: Any = found if _is_planner(found) or not callable(found) else found()
    if not _is_planner(planner):
        raise no_planner(source if isinstance(source, str) else name_of(found), planner)
    return planner


def require_planner(name: str) -> None:
    """Raise PlannerError for a name of no host planner, or whatever the planner raises; a class is not called."""
    if not isinstance(find_attribute(name), Planner):
        make_planner(name)


def no_planner(name: str, found: Any) -> PlannerError:
    """The error for an object that is not a planner."""
    return PlannerError(
        f"planner {name!r} is a {type(found).__name__}, expected a JaxPlanner, "
        "or an object with `reset(scene)` and `act(observation)`"
    )


def _is_planner(found: Any) -> bool:
    """Whether an object, but not a class, has `reset` and `act`."""
    return isinstance(found, Planner) and not isinstance(found, type)
