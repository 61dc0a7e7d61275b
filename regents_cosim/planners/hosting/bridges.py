"""Kinds of planner behind a prefix, as in `exec:./my_planner --fast`: the factory gets the text after the colon.

Packages above this one register theirs in `regents_cosim/__init__.py`, which every process imports first.
"""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable

    from regents_cosim.planners.interface import Planner
    from regents_cosim.planners.jax_planner import JaxPlanner

    Factory = Callable[[str], Planner | JaxPlanner]


def _aim_bev() -> Factory:
    from regents_cosim.planners.aim_bev.planner import aim_bev

    return aim_bev


def _exec() -> Factory:
    from regents_cosim.planners.hosting.exec_planner import ExecPlanner

    return ExecPlanner


def _torch() -> Factory:
    from regents_cosim.planners.hosting.torch_bridge import TorchPlanner

    return TorchPlanner


# A function per prefix that imports the factory, when a planner of its kind is named.
BRIDGES: dict[str, Callable[[], Factory]] = {"aim-bev": _aim_bev, "exec": _exec, "torch": _torch}
