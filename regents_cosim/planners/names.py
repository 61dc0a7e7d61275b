"""The names of planners, without imports, so that `--help` can list them."""

# Planners of this package. Entry points of other packages with the same name do not replace them.
OURS: dict[str, str] = {
    "aim-bev": "regents_cosim.planners.aim_bev.planner:aim_bev",
    "aim-bev-hardened": "regents_cosim.planners.aim_bev.planner:aim_bev_hardened",
    "careful": "regents_cosim.planners.careful.driver:CarefulDriver",
    "constant_velocity": "regents_cosim.planners.blind:ConstantVelocity",
    "idm": "regents_cosim.planners.idm:IDM",
    "idm-yielding": "regents_cosim.planners.idm_yielding:YieldingIDM",
    "log_replay": "regents_cosim.planners.blind:LogReplay",
    "pdm-closed": "regents_cosim.planners.pdm_closed:PdmClosed",
}
WITH_SETTINGS = ("idm",)  # of these, those whose numbers a name may set
_OTHERS = (
    "sumo", *(f"{name}:SETTING=NUMBER" for name in WITH_SETTINGS), "aim-bev:WEIGHTS", "highway:AGENT", "torch:MODULE",
    "exec:COMMAND", "python:INTERPRETER:FILE.py:CLASS", "package.module:attribute or file.py:attribute",
)  # fmt: skip

# The planners that a case may name, all from this package, SUMO or highway-env.
BUILT_IN = frozenset({*OURS, "sumo", "highway:idm", "highway:mdp", "highway:random"})


def is_built_in(name: str) -> bool:
    """Whether a case may name this planner: after the prefix of one with settings only numbers follow."""
    return name in BUILT_IN or name.startswith(tuple(f"{one}:" for one in WITH_SETTINGS))


def all_that_may_be_named(installed: tuple[str, ...] = ()) -> str:
    """The built-in planners, the `installed` ones of other packages, and the forms of a user's own planners."""
    return ", ".join((*sorted({*OURS, *installed}), *_OTHERS))
