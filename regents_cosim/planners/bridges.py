"""Bridges: kinds of planner behind a prefix, as in `exec:./my_planner --fast`, whose factory gets the rest of the name.

Packages above this one add their own bridges (`rooms`).
"""

from importlib import import_module

from regents_cosim.rooms import ADD_PLANNERS

# Factories as `module:attribute`, imported when a planner of that kind is named.
BRIDGES: dict[str, str] = {
    "aim-bev": "regents_cosim.planners.aim_bev.planner:aim_bev",
    "exec": "regents_cosim.planners.exec_planner:ExecPlanner",
    "idm": "regents_cosim.planners.idm_settings:idm_with",
    "torch": "regents_cosim.planners.torch_bridge:TorchPlanner",
}


def bridges() -> dict[str, str]:
    """All bridges, including those of packages above this one."""
    for room in ADD_PLANNERS:
        import_module(room)
    return BRIDGES
