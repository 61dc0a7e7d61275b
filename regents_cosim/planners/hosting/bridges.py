"""Kinds of planner behind a prefix, as in `exec:./my_planner --fast`: the factory gets the text after the colon."""

from collections.abc import Callable
from typing import Any

Factory = Callable[[str], Any]  # makes a Planner or a JaxPlanner


def _aim_bev() -> Factory:
    from regents_cosim.planners.aim_bev.planner import aim_bev

    return aim_bev


def _exec() -> Factory:
    from regents_cosim.planners.hosting.exec_planner import ExecPlanner

    return ExecPlanner


def _highway() -> Factory:
    from regents_cosim.replays.highway.ego import HighwayEgo

    return HighwayEgo


def _sumo() -> Factory:
    from regents_cosim.replays.sumo.ego import SumoEgo

    return SumoEgo


def _torch() -> Factory:
    from regents_cosim.planners.hosting.torch_bridge import TorchPlanner

    return TorchPlanner


# A function per prefix that imports the factory, when a planner of its kind is named.
BRIDGES: dict[str, Callable[[], Factory]] = {
    "aim-bev": _aim_bev, "exec": _exec, "highway": _highway, "sumo": _sumo, "torch": _torch,
}  # fmt: skip
