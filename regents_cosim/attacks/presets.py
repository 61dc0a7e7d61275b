"""The configuration of an attack, and its presets: KING, ReGentS and focused."""

from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, cast, get_args

import numpy as np

from regents_cosim.checks.ranges import Range, check_ranges
from regents_cosim.checks.suggestions import did_you_mean
from regents_cosim.errors import RegentsError, require
from regents_cosim.scenario import ROAD_USERS, Kind, RoadUser
from regents_cosim.short_repr import ShortRepr

_MOST_ITERATIONS = 100_000
_WEIGHT = Range(0.0, 1e6, "the weight of a cost")
_SHARE = Range(0.0, 1.0, "a share")
_DECAY = Range(0.0, 1.0 - 1e-9, "how much of a moment Adam keeps")
_BOUND = Range(0.0, 1e3, "m/s^2, or 0 where `driving` decides")
_RANGES = {
    "iterations": Range(1, _MOST_ITERATIONS, "updates at most", whole=True),
    "patience": Range(0, _MOST_ITERATIONS, "iterations without progress, or 0 for no end to it", whole=True),
    "near_m": Range(0.0, 1e4, "metres from which on a search has less patience, or 0 for the same everywhere"),
    "learning_rate": Range(1e-9, 10.0, "the step of an update"),
    "beta1": _DECAY,
    "beta2": _DECAY,
    "pair_weight": _WEIGHT,
    "road_weight": _WEIGHT,
    "pair_reach_m": Range(0.0, 1e4, "metres within which background agents repel each other"),
    "max_deviation": Range(0.0, 2.0, "a share of an action's limit, or 0 for no bound"),
    "max_accel": _BOUND,
    "max_braking": _BOUND,
    "max_lateral_accel": _BOUND,
    "max_jerk": Range(0.0, 1e3, "m/s^3, or 0 where `driving` decides"),
    "front_share": _SHARE,
    "front_window_rad": Range(0.0, 2.0 * np.pi, "an angle [rad]"),
    "rear_share": _SHARE,
    "rear_sector_rad": Range(0.0, 2.0 * np.pi, "an angle [rad]"),
    "static_m": Range(0.0, 1e4, "metres that an agent moves over the horizon"),
    "softmin_m": Range(0.0, 1e4, "metres, or 0 for the mean over time"),
    "behind_rad": Range(0.0, np.pi, "a bearing [rad]"),
    "starts": Range(0, 1000, "drives to begin with per candidate, or 0 for the log alone", whole=True),
    "attempts": Range(1, 1000, "searches per candidate", whole=True),
    "sampled": Range(0, 1000, "of the attempts those that sample, or 0 for descents alone", whole=True),
    "nearest": Range(1, 1000, "candidates that get a search of their own", whole=True),
    "replan_every": Range(0, _MOST_ITERATIONS, "iterations between two closed loops, or 0 for the usual", whole=True),
}


@dataclass(frozen=True, repr=False)
class AttackConfig(ShortRepr):
    """All settings of an attack besides the scenario and the planner.

    The defaults are those that both papers share. Actions are optimised in [-1, 1], as shares of the mirror's limits,
    so `learning_rate` x `iterations` bounds how far they can move.
    """

    method: str
    iterations: int = 500  # at most
    patience: int = 0  # updates without a decrease by 2 % after which a search ends; 0: never
    near_m: float = 0.0  # [m] above this ego's cost a search has less patience (`patience`); 0: always the same
    learning_rate: float = 1e-3  # Adam; ReGentS section 4
    beta1: float = 0.9
    beta2: float = 0.999
    pair_weight: float = 5.0  # lambda_col
    road_weight: float = 20.0  # lambda_dev
    pair_reach_m: float = 1.25  # tau: background agents further apart do not repel each other
    max_deviation: float = 0.0  # most change of an action, as a share of its limit; 0: no bound
    driving: Literal["any", "ordinary"] = "any"  # as hard as the mirror can, or as drivers in the scene's traffic do
    max_accel: float = 0.0  # [m/s^2] of the adversary, unless its log has more; 0: as `driving` says
    max_braking: float = 0.0  # [m/s^2] likewise
    max_lateral_accel: float = 0.0  # [m/s^2] likewise, |curvature| speed^2
    max_jerk: float = 0.0  # [m/s^3] likewise, longitudinal
    gradient: Literal["adversary", "through-planner"] = "adversary"  # whether the ego's reaction is differentiated too
    cancel_front_steering: bool = False  # ReGentS rule 1
    front_share: float = 0.5  # tau_front: share of steps in the red zone that cancels steering
    front_window_rad: float = np.pi / 8
    exclude_rear: bool = False  # ReGentS rule 2
    rear_share: float = 0.8  # of the steps inside the sector behind the ego
    rear_sector_rad: float = np.pi / 4  # its full width
    exclude_static: bool = False  # ReGentS rule 3
    static_m: float = 0.2  # agents that move less over the horizon are static
    softmin_m: float = 0.0  # temperature of a soft minimum over time instead of the mean of eq. 4; 0: the mean
    pull_from_behind: bool = True  # whether steps at which the adversary is behind the ego pull as well
    behind_rad: float = 3 * np.pi / 4  # bearing from the ego beyond which an agent is behind
    pull_standing: bool = True  # whether steps at which the ego stands pull as well
    accept: Literal["any", "clean", "telling"] = "any"  # the collisions that end a search
    optimiser: Literal["adam", "random", "cma-es", "none"] = "adam"  # lowers the cost; others serve comparison
    starts: int = 0  # lawful drives that are looked at for each candidate before it is searched; 0: none
    attempts: int = 1  # searches for each candidate; the last begins with the log, earlier ones with such drives
    sampled: int = 0  # number of first attempts that sample changes (CMA-ES); the last attempt always descends
    law: Literal["any", "strict"] = "any"  # whether the adversary keeps to its lanes, turns and the speed limit
    search: Literal["joint", "per-candidate"] = "joint"  # one descent over all candidates, or one for each
    nearest: int = 5  # candidates that get their own descent
    adversary_kinds: tuple[RoadUser, ...] = ("vehicle",)  # who may attack
    adversaries: Literal["all", "one"] = "all"  # find all adversaries that succeed, or end at the first
    dynamics: Literal["recorded", "bicycle", "highway"] = "recorded"  # model of vehicles; recorded: that of the source
    background: Literal["log", "reactive"] = "log"  # whether other agents brake for obstacles on their way
    replan_every: int = 0  # iterations between two closed loops of the planner; 0: 1 in the compiled loop, 10 outside
    universal: Literal["mean", "worst"] = "mean"  # combines the costs of several planners that are attacked at once
    as_published: bool = False  # follow the public ReGentS code where it departs from the paper

    def __post_init__(self) -> None:
        check_ranges(self, _RANGES)
        require(
            self.gradient == "adversary" or self.background == "log",
            "a gradient through the planner needs background `log`: reactions are not differentiated",
            RegentsError,
        )
        require(
            self.gradient == "adversary" or self.replan_every <= 1,
            "a gradient through the planner needs it in every iteration: replan_every 1",
            RegentsError,
        )
        require(
            self.optimiser == "adam" or (self.search == "per-candidate" and self.gradient == "adversary"),
            f"optimiser {self.optimiser} searches one candidate at a time and knows no gradient: "
            "take search `per-candidate` and gradient `adversary`",
            RegentsError,
        )
        require(
            self.law == "any" or self.search == "per-candidate",
            "law `strict` gives each candidate a map of its own: take search `per-candidate`, or law `any`",
            RegentsError,
        )
        require(
            self.attempts == 1 or self.starts > 0 or self.search == "joint",
            f"{self.attempts} attempts need somewhere else to begin: take `starts` of 1 or more, or 1 attempt",
            RegentsError,
        )
        _check_kinds(self.adversary_kinds)
        choices = (self.search, self.background, self.accept, self.pull_from_behind, self.pull_standing)
        ours = self.softmin_m > 0.0 or choices != ("joint", "log", "any", True, True)
        require(
            not (self.as_published and ours),
            "the public code has no soft minimum, no search per candidate and no reactive background, which are "
            "ours: as published, take method `regents` or `king` with search `joint` and background `log`",
            RegentsError,
        )
        require(
            self.adversary_kinds == ("vehicle",) or not self.as_published,
            f"adversary kinds {','.join(self.adversary_kinds)}: the public code moves vehicles alone; as published, "
            "take `vehicle`",
            RegentsError,
        )

    def compiled(self) -> "AttackConfig":
        """The configuration without settings on which compiled programs do not depend, and with rounded iterations."""
        chosen_before = {name: getattr(type(self), name) for name in _CHOSEN_BEFORE}
        room = max(-(-self.iterations // _ROOM), 1) * _ROOM
        return replace(self, method="", iterations=room, **chosen_before)

    @property
    def may_attack(self) -> frozenset[Kind]:
        """The kinds of road users that may attack."""
        return frozenset[Kind]().union(*(ROAD_USERS[user] for user in self.adversary_kinds))

    @property
    def samples(self) -> int:
        """The number of attempts that sample instead of descending."""
        return min(self.sampled, self.attempts - 1)

    @property
    def descents(self) -> int:
        """The number of attempts that descend."""
        return self.attempts - self.samples

    def descending(self) -> "AttackConfig":
        """A copy for searches that cannot sample: one more descent, from the log, replaces all samplings."""
        return replace(self, attempts=self.descents + min(self.samples, 1), sampled=0)

    @property
    def protocol(self) -> tuple[tuple[str, object], ...]:
        """The rules of the search, which must agree for a comparison of methods.

        The cost (soft minimum, pulls), the method's rules for candidates, and the optimiser are not part of it.
        """
        alone = () if self.search == "per-candidate" else _ALONE
        return tuple((name, getattr(self, name)) for name in PROTOCOL if name not in alone)

    def by_protocol_of(self, other: "AttackConfig") -> "AttackConfig":
        """The method, with the rules of `other`."""
        return replace(self, **{name: getattr(other, name) for name in PROTOCOL})

    @property
    def noted(self) -> dict[str, Any]:
        """The settings that every case notes, without those that are noted elsewhere or only if set."""
        unset = tuple(name for name in _NOTED_IF_SET if not getattr(self, name))
        return {name: value for name, value in asdict(self).items() if name not in _NOTED_ELSEWHERE + unset}

    @property
    def label(self) -> str:
        """The name for tables and ids: the method, and whether it runs as published."""
        return f"{self.method}-published" if self.as_published else self.method


_NOTED_ELSEWHERE = ("method", "universal", "adversary_kinds")
_NOTED_IF_SET = ("near_m",)


def _check_kinds(kinds: tuple[str, ...]) -> None:
    known = get_args(RoadUser)
    require(
        bool(kinds) and set(kinds) <= set(known) and len(set(kinds)) == len(kinds),
        f"adversary kinds {','.join(kinds)!r}: expected one or more of {','.join(known)}, each once",
        RegentsError,
    )


PROTOCOL = (
    "search", "nearest", "starts", "attempts", "adversaries", "accept", "law", "driving", "background", "iterations",
    "patience", "near_m", "replan_every",
)  # fmt: skip
_ALONE = ("nearest", "starts", "attempts", "adversaries")  # only for a search per candidate
_ROOM = 500  # iterations for which programs store the costs
_CHOSEN_BEFORE = (
    "replan_every", "starts", "attempts", "sampled", "nearest", "adversaries", "adversary_kinds", "dynamics",
    "driving", "max_accel", "max_braking", "max_lateral_accel", "max_jerk",
    "exclude_rear", "rear_share", "rear_sector_rad", "exclude_static", "static_m",
)  # fmt: skip

KING = AttackConfig("king")
REGENTS = AttackConfig("regents", cancel_front_steering=True, exclude_rear=True, exclude_static=True)

# A mean over time rewards staying close rather than hitting ("time-averaged distance bias" of the ReGentS paper), and a
# minimum over candidates commits to one ("minimum trap"). So here the soft minimum pulls the closest moments together,
# each candidate is searched alone, none is pulled from behind or towards a standing ego, and followers brake for the
# ego instead of hitting it.
# The wanted crash is a telling one: by a lawful adversary (`law`) that a careful driver avoids (`accept`), and that
# drives as people do (`driving`): as hard as the traffic of its scene, jerk included.
# Descents from the log alone found one in 3 of 36 windows of crossing, signals and grid (seed 100): the gradient pulls
# straight across, where the law forbids it. With a look at twelve lawful drives that meet the ego, and a descent from
# the most promising one before the one from the log, it is 13 of 36. Eight candidates are searched: those with the most
# promising drives among three times as many. An agent that stands may pull out, so it counts as well.
# Three of four descents never get anywhere, and show it early: those that succeed have taken 75 iterations in the
# median, and only one in thirty has stood still for a hundred before. The further away they are, the earlier they show
# it (`near_m`; `patience`).
# A descent ends at the nearest crash, or passes it if it is not telling. So two searches sample changes of the drive
# before one descends. Of 31 windows (seed 400) in which no start alone is enough, two descents solve 7, one descent and
# two sampling searches 13. With the samples first the same ones are solved with fewer roll-outs.
REGENTS_FOCUSED = replace(
    REGENTS,
    method="focused",
    softmin_m=2.0,
    pull_from_behind=False,
    search="per-candidate",
    nearest=8,
    background="reactive",
    pull_standing=False,
    accept="telling",
    law="strict",
    starts=12,
    attempts=3,
    sampled=2,
    patience=100,
    near_m=4.0,
    exclude_static=False,
    driving="ordinary",
    adversary_kinds=("vehicle", "cyclist", "pedestrian"),
)

OURS = REGENTS_FOCUSED  # methods are compared by its rules

# The focused cost alone, from the log, for any clean crash: for figures, and for scenes without lanes.
FOCUSED_COST = replace(
    REGENTS_FOCUSED, law="any", driving="any", accept="clean", starts=0, attempts=1, sampled=0, near_m=0.0
)

# The focused cost without its gradient, with as many roll-outs for each candidate.
RANDOM = replace(
    REGENTS_FOCUSED, method="random", optimiser="random", iterations=1500, attempts=1, sampled=0, patience=0
)
CMA_ES = replace(RANDOM, method="cma-es", optimiser="cma-es")

# A look at every start and at the log without a search: what the rules find by themselves.
STARTS = replace(REGENTS_FOCUSED, method="starts", optimiser="none", sampled=0)

METHODS = {preset.method: preset for preset in (REGENTS, KING, REGENTS_FOCUSED, STARTS, RANDOM, CMA_ES)}


def road_users(text: str) -> tuple[RoadUser, ...]:
    """Parse text such as `vehicle,cyclist`. Raises RegentsError."""
    kinds = tuple(kind.strip() for kind in text.split(","))
    _check_kinds(kinds)
    return cast(tuple[RoadUser, ...], kinds)


def preset(method: str, **given: Any) -> AttackConfig:
    """The preset `method` with the `given` values; None keeps the value of the preset.

    Raises RegentsError for an unknown name, and for values that do not go together.
    """
    if method not in METHODS:
        raise RegentsError(f"method {method!r} is not known: {did_you_mean(method, METHODS)}")
    return replace(METHODS[method], **{name: value for name, value in given.items() if value is not None})
