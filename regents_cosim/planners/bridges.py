"""Other kinds of planner behind a prefix, as in `exec:./my_planner --fast`: what the factory gets is the rest.

Rooms above this one add what needs them (`rooms`): nothing here knows them.
"""

from importlib import import_module

from regents_cosim.rooms import ADD_PLANNERS

# Where the factory of each is, as `module:attribute`: it is imported when a planner of its kind is named.
BRIDGES: dict[str, str] = {
    "aim-bev": "regents_cosim.planners.aim_bev.planner:aim_bev",
    "exec": "regents_cosim.planners.exec_planner:ExecPlanner",
    "idm": "regents_cosim.planners.idm_settings:idm_with",
    "torch": "regents_cosim.planners.torch_bridge:TorchPlanner",
}


def bridges() -> dict[str, str]:
    """All of them, with those of rooms above."""
    for room in ADD_PLANNERS:
        import_module(room)
    return BRIDGES
