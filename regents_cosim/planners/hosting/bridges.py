"""Kinds of planner behind a prefix, as in `exec:./my_planner --fast`: the factory gets the text after the colon."""

from collections.abc import Callable
from typing import Any

BRIDGES = ("aim-bev", "exec", "highway", "sumo", "torch")


def factory_of(bridge: str) -> Callable[[str], Any]:
    """Makes the Planner or JaxPlanner; imported when a planner of its kind is named."""
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
