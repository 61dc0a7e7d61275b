"""What planners are called: ours, and what a user may name besides. No imports: `--help` lists them."""

# Those that come with the package. Another package's entry point of the same name does not take their place.
OURS: dict[str, str] = {
    "aim-bev": "regents_cosim.planners.aim_bev.planner:aim_bev",
    "aim-bev-hardened": "regents_cosim.planners.aim_bev.planner:aim_bev_hardened",
    "careful": "regents_cosim.planners.reference.drivers:CarefulDriver",
    "constant_velocity": "regents_cosim.planners.constant_velocity:ConstantVelocity",
    "fuzzy": "regents_cosim.planners.reference.drivers:FuzzyDriver",
    "idm": "regents_cosim.planners.idm:IDM",
    "log_replay": "regents_cosim.planners.log_replay:LogReplay",
    "rss": "regents_cosim.planners.reference.drivers:RssDriver",
}
_OTHERS = (
    "sumo", "idm:SETTING=NUMBER", "aim-bev:WEIGHTS", "highway:AGENT", "torch:MODULE", "exec:COMMAND",
    "package.module:attribute or file.py:attribute",
)  # fmt: skip

# All that a case may name: what these load comes with the package, or with SUMO and highway-env.
BUILT_IN = frozenset({*OURS, "sumo", "highway:idm", "highway:mdp", "highway:random"})
_OURS_WITH_NUMBERS = ("idm:",)  # and these with whatever settings: nothing but numbers follows


def is_built_in(name: str) -> bool:
    """Whether a case may name this planner."""
    return name in BUILT_IN or name.startswith(_OURS_WITH_NUMBERS)


def all_that_may_be_named(installed: tuple[str, ...] = ()) -> str:
    """Ours, the `installed` ones of other packages, and the kinds of name that stand for a user's own."""
    return ", ".join((*sorted({*OURS, *installed}), *_OTHERS))
