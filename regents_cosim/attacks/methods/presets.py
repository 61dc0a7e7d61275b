"""The methods of attack with their settings: KING, ReGentS, focused, and what they are compared with.

A method is a class that begins a search for each candidate. Its fields are its settings, and their defaults its preset.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast, final, get_args

from regents_cosim.checks.ranges import Range, check_ranges
from regents_cosim.errors import RegentsError, require
from regents_cosim.norms.grades import AdversaryMay
from regents_cosim.road_users import ROAD_USERS, Kind, RoadUser
from regents_cosim.short_repr import ShortRepr

if TYPE_CHECKING:
    from jaxtyping import Array, Bool

    from regents_cosim.attacks.descent.step import Descent
    from regents_cosim.attacks.job import Candidate
    from regents_cosim.attacks.methods.moves import Search
    from regents_cosim.mirror.bicycle import ControlArrays
    from regents_cosim.mirror.world import World
    from regents_cosim.scenario import Scenario

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
    "front_window_rad": Range(0.0, 2.0 * math.pi, "an angle [rad]"),
    "rear_share": _SHARE,
    "rear_sector_rad": Range(0.0, 2.0 * math.pi, "an angle [rad]"),
    "static_m": Range(0.0, 1e4, "metres that an agent moves over the horizon"),
    "softmin_m": Range(0.0, 1e4, "metres, or 0 for the mean over time"),
    "behind_rad": Range(0.0, math.pi, "a bearing [rad]"),
    "starts": Range(0, 1000, "drives to begin with per candidate, or 0 for the log alone", whole=True),
    "attempts": Range(1, 1000, "searches per candidate", whole=True),
    "sampled": Range(0, 1000, "of the attempts those that sample, or 0 for descents alone", whole=True),
    "nearest": Range(1, 1000, "candidates that get a search of their own", whole=True),
    "replan_every": Range(0, _MOST_ITERATIONS, "iterations between two closed loops, or 0 for the usual", whole=True),
    "drives": Range(0, _MOST_ITERATIONS, "drives of the planner in a window at most, or 0 for any number", whole=True),
}


@dataclass(frozen=True, repr=False)
class _Part(ShortRepr):
    """A part of a method's settings. Raises RegentsError for a value out of its range."""

    def __post_init__(self) -> None:
        check_ranges(self, {name: allowed for name, allowed in _RANGES.items() if hasattr(self, name)})


@dataclass(frozen=True, repr=False)
class Cost(_Part):
    """What the attack lowers: the terms of both papers, their weights, and how the distance to the ego is pooled."""

    pair_weight: float = 5.0
    """weight of collisions between others than the ego in the cost (lambda_col)"""
    road_weight: float = 20.0
    """weight of leaving the road in the cost (lambda_dev)"""
    pair_reach_m: float = 1.25
    """distance within which background agents repel each other (tau) [m]"""
    softmin_m: float = 0.0
    """temperature of a soft minimum over time in place of the mean of eq. 4 [m]; 0: the mean"""
    pull_from_behind: bool = True
    """whether steps at which the adversary is behind the ego pull as well"""
    behind_rad: float = 3 * math.pi / 4
    """bearing from the ego beyond which another is behind [rad]"""
    pull_standing: bool = True
    """whether steps at which the ego stands pull as well"""


@dataclass(frozen=True, repr=False)
class Rules(_Part):
    """The rules of ReGentS (section 3.3): who may steer and who may attack."""

    cancel_front_steering: bool = False
    """ReGentS rule 1: an adversary ahead of the ego that turns away to its own side (red zone) is not steered"""
    front_share: float = 0.5
    """share of the steps in the red zone that cancels steering (tau_front)"""
    front_window_rad: float = math.pi / 8
    """how far the bearing from the ego and the heading differ from its own at most in the red zone [rad]"""
    exclude_rear: bool = False
    """ReGentS rule 2: none that stays behind the ego is a candidate"""
    rear_share: float = 0.8
    """share of the steps in the sector behind the ego from which on one is excluded"""
    rear_sector_rad: float = math.pi / 4
    """full width of the sector behind the ego [rad]"""
    exclude_static: bool = False
    """ReGentS rule 3: none that stands is a candidate"""
    static_m: float = 0.2
    """distance over the horizon below which an agent stands [m]"""


@dataclass(frozen=True, repr=False)
class Limits(_Part):
    """How hard an adversary may drive."""

    max_deviation: float = 0.0
    """largest change of an action from its logged value, as a share of the limit of actions; 0: unbounded"""
    driving: Literal["any", "ordinary"] = "any"
    """ordinary: the adversary accelerates, brakes, steers and jerks at most as hard as drivers in the traffic of
    its scene, or as usual for its kind of vehicle; any: as hard as the mirror allows"""
    max_accel: float = 0.0
    """highest acceleration of the adversary, unless its log exceeds it [m/s^2]; 0: as `driving` says"""
    max_braking: float = 0.0
    """hardest braking of the adversary, unless its log exceeds it [m/s^2]; 0: as `driving` says"""
    max_lateral_accel: float = 0.0
    """highest lateral acceleration of the adversary, unless its log exceeds it [m/s^2]; 0: as `driving` says"""
    max_jerk: float = 0.0
    """highest jerk of the adversary, unless its log exceeds it [m/s^3]; 0: as `driving` says"""


@dataclass(frozen=True, repr=False)
class Steps(_Part):
    """The updates of a descent."""

    learning_rate: float = 1e-3
    """step of an update by Adam, as a share of an action's limit"""
    beta1: float = 0.9
    """how much of the first moment Adam keeps"""
    beta2: float = 0.999
    """how much of the second moment Adam keeps"""
    gradient: Literal["adversary", "through-planner"] = "adversary"
    """adversary: the planner's track counts as constant; through-planner: the gradient also passes through the
    planner (only in JAX)"""


@dataclass(frozen=True, repr=False)
class AttackConfig(ShortRepr):
    """A method of attack: its settings, and the search that it begins for each candidate.

    The defaults are those that both papers share; without another class the search descends. Actions are optimised in
    [-1, 1], as shares of the mirror's limits, so `learning_rate` x `iterations` bounds how far they can move.
    """

    method: str
    """name of the preset"""
    iterations: int = 500
    """most updates of a search"""
    patience: int = 0
    """updates without progress (its distance comes down by less than 2 %) after which a search ends; 0: it goes on
    to the last"""
    near_m: float = 0.0
    """distance of the ego's cost from which on a search has less patience [m]; 0: the same everywhere"""
    accept: Literal["any", "clean", "telling"] = "any"
    """collisions that end a search: any; clean: those that nothing spoils; telling: those that a careful driver
    also avoids"""
    starts: int = 0
    """number of drives on other routes, timed to meet the ego, that are tried for each candidate before the
    search"""
    attempts: int = 1
    """most searches for each candidate, each from another start, until one succeeds"""
    sampled: int = 0
    """number of these searches, counted from the first, that sample changes (CMA-ES) instead of using gradients"""
    adversary_may: AdversaryMay = "anything"
    """what the adversary may do against the rules: mistakes, such as failing to give way, cutting in close or
    driving up to 20 % too fast; none: it keeps every rule; anything: it may also leave its lanes, or run a red light"""
    search: Literal["joint", "per-candidate"] = "joint"
    """joint: one search over all candidates; per-candidate: one for each of the nearest (every adversary found is a
    case)"""
    nearest: int = 5
    """number of candidates that are searched one by one, the nearest first"""
    adversary_kinds: tuple[RoadUser, ...] = ("vehicle",)
    """road users that may attack"""
    adversaries: Literal["all", "one"] = "all"
    """all: a case for each candidate that succeeds; one: the first success ends the search of a scenario"""
    dynamics: Literal["recorded", "bicycle", "highway"] = "recorded"
    """model of motion: bicycle: the mirror's; highway: exactly that of highway-env; recorded: that of the simulator
    that the case is from"""
    background: Literal["log", "reactive"] = "log"
    """how other agents move: log: as recorded; reactive: they also brake for obstacles"""
    replan_every: int = 0
    """number of iterations of a descent from one closed loop of the planner to the next; 0: 1 for planners in JAX,
    10 for others"""
    drives: int = 0
    """most drives of a planner that drives now and then, in one window; 0: any number"""
    cost: Cost = Cost()
    """what it lowers"""
    rules: Rules = Rules()
    """who may steer and attack"""
    limits: Limits = Limits()
    """how hard an adversary may drive"""
    steps: Steps = Steps()
    """the updates of a descent"""

    descends: ClassVar[bool] = True  # whether its longer searches descend

    def __post_init__(self) -> None:
        check_ranges(self, {name: allowed for name, allowed in _RANGES.items() if hasattr(self, name)})
        require(
            self.steps.gradient == "adversary" or self.background == "log",
            "a gradient through the planner needs background `log`: reactions are not differentiated",
            RegentsError,
        )
        require(
            self.steps.gradient == "adversary" or self.replan_every <= 1,
            "a gradient through the planner needs it in every iteration: replan_every 1",
            RegentsError,
        )
        require(
            self.descends or (self.search == "per-candidate" and self.steps.gradient == "adversary"),
            f"method {self.method} searches one candidate at a time and knows no gradient: "
            "take search `per-candidate` and gradient `adversary`",
            RegentsError,
        )
        require(
            not self.bound or self.search == "per-candidate",
            f"adversary-may `{self.adversary_may}` gives each candidate a map of its own: take search "
            "`per-candidate`, or adversary-may `anything`",
            RegentsError,
        )
        require(
            self.attempts == 1 or self.starts > 0 or self.search == "joint",
            f"{self.attempts} attempts need somewhere else to begin: take `starts` of 1 or more, or 1 attempt",
            RegentsError,
        )
        _check_kinds(self.adversary_kinds)

    def begin(self, candidate: "Candidate") -> "Search":
        """Begin the search for a candidate: a look at every start, then longer searches."""
        from regents_cosim.attacks.methods.attempts import Attempts

        return Attempts(candidate, self.longer, self.attempts, self.samples, self.starts)

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """A longer search from a start (None: the log): a descent, or where it `samples` CMA-ES."""
        from regents_cosim.attacks.methods.attempts import OneDescent
        from regents_cosim.attacks.sampling.sampled_search import ByEvolution, Sampling

        if not samples:
            return OneDescent(start, self.iterations)
        job = candidate.job._replace(start=start)
        return Sampling(candidate.scenario.id, job, self, ByEvolution, self.iterations)

    @property
    def rollouts(self) -> int:
        """The most roll-outs of a longer search."""
        return self.iterations

    def movable(self, world: "World") -> "Bool[Array, ' agent']":
        """The agents whose controls the attack may change."""
        from regents_cosim.attacks.accept.rules import candidates

        return candidates(world, self)

    def present(self, scenario: "Scenario") -> "Scenario":
        """The scenario with the times at which an attacked case shows its agents."""
        return scenario

    def descent(self) -> "type[Descent]":
        """The descent that the compiled programs make."""
        from regents_cosim.attacks.descent.step import Descent

        return Descent

    def compiled(self) -> "AttackConfig":
        """The settings on which compiled programs depend, with rounded iterations, as a method that merely descends."""
        given = {one.name: getattr(self, one.name) for one in fields(AttackConfig) if one.name not in _CHOSEN_BEFORE}
        given["limits"] = Limits(max_deviation=self.limits.max_deviation)
        steering = ("cancel_front_steering", "front_share", "front_window_rad")
        given["rules"] = Rules(**{name: getattr(self.rules, name) for name in steering})
        room = max(-(-self.iterations // _ROOM), 1) * _ROOM
        may = "mistakes" if self.bound else "anything"
        return self.of_programs()(**given | {"method": "", "iterations": room, "adversary_may": may})

    def of_programs(self) -> "type[AttackConfig]":
        """The class of the compiled settings, which all methods share whose programs are the same."""
        return AttackConfig

    @property
    def settings(self) -> dict[str, Any]:
        """All settings by name, whichever part holds them."""
        own = {one.name: getattr(self, one.name) for one in fields(self)}
        parts = [part for part in own.values() if isinstance(part, _Part)]
        plain = {name: value for name, value in own.items() if not isinstance(value, _Part)}
        return plain | {name: value for part in parts for name, value in vars(part).items()}

    def but(self, **settings: Any) -> "AttackConfig":
        """The method with other settings, each by its name, whichever part holds it. Raises RegentsError."""
        for part in fields(self):
            held = getattr(self, part.name)
            if isinstance(held, _Part):
                own = {name: settings.pop(name) for name in vars(held) if name in settings}
                settings |= {part.name: replace(held, **own)} if own else {}
        return replace(self, **settings)

    @property
    def may_attack(self) -> frozenset[Kind]:
        """The kinds of road users that may attack."""
        return frozenset[Kind]().union(*(ROAD_USERS[user] for user in self.adversary_kinds))

    @property
    def bound(self) -> bool:
        """Whether the adversary keeps to its lanes and turns, to lights, and near the speed limit."""
        return self.adversary_may != "anything"

    @property
    def samples(self) -> int:
        """The number of attempts that sample instead of descending."""
        return min(self.sampled, self.attempts - 1)

    @property
    def descents(self) -> int:
        """The number of attempts that descend."""
        return self.attempts - self.samples

    @property
    def protocol(self) -> tuple[tuple[str, object], ...]:
        """The rules of the search, which must agree for a comparison of methods.

        The cost (soft minimum, pulls), the method's rules for candidates, and who lowers the cost are not part of it.
        """
        alone = () if self.search == "per-candidate" else _ALONE
        return tuple((name, self.settings[name]) for name in PROTOCOL if name not in alone)

    def by_protocol_of(self, other: "AttackConfig") -> "AttackConfig":
        """The method, with the rules of `other`."""
        return self.but(**{name: other.settings[name] for name in PROTOCOL})

    @property
    def noted(self) -> dict[str, Any]:
        """The settings that every case notes, without those that are noted elsewhere or only if set."""
        unset = tuple(name for name in _NOTED_IF_SET if not getattr(self, name))
        every = {name: value for name, value in self.settings.items() if isinstance(value, bool | int | float | str)}
        return {name: value for name, value in every.items() if name not in _NOTED_ELSEWHERE + unset}


_NOTED_ELSEWHERE = ("method", "adversary_kinds", "dynamics")
_NOTED_IF_SET = ("near_m",)


def _check_kinds(kinds: tuple[str, ...]) -> None:
    known = get_args(RoadUser)
    require(
        bool(kinds) and set(kinds) <= set(known) and len(set(kinds)) == len(kinds),
        f"adversary kinds {','.join(kinds)!r}: expected one or more of {','.join(known)}, each once",
        RegentsError,
    )


PROTOCOL = (
    "search", "nearest", "starts", "attempts", "adversaries", "accept", "adversary_may", "driving", "background",
    "iterations", "patience", "near_m", "replan_every", "drives",
)  # fmt: skip
_ALONE = ("nearest", "starts", "attempts", "adversaries")  # only for a search per candidate
_ROOM = 500  # iterations for which programs store the costs
_CHOSEN_BEFORE = (
    "replan_every", "starts", "attempts", "sampled", "nearest", "adversaries", "adversary_kinds", "dynamics",
    "drives",
)  # fmt: skip


_OF_REGENTS = Rules(cancel_front_steering=True, exclude_rear=True, exclude_static=True)


@final
@dataclass(frozen=True, repr=False)
class King(AttackConfig):
    """KING: one descent for all candidates, by the cost of the papers (Hanselmann et al. 2022)."""

    method: str = "king"


@final
@dataclass(frozen=True, repr=False)
class Regents(AttackConfig):
    """ReGentS: KING with three rules for who may attack and steer."""

    method: str = "regents"
    rules: Rules = _OF_REGENTS


# A mean over time rewards staying close rather than hitting ("time-averaged distance bias" of the ReGentS paper), and a
# minimum over candidates commits to one ("minimum trap"). So here the soft minimum pulls the closest moments together,
# each candidate is searched alone, none is pulled from behind or towards a standing ego, and followers brake for the
# ego instead of hitting it.
# The wanted crash is a telling one: a careful driver prevents it by braking (`accept`), and the adversary makes no more
# than a mistake (`adversary_may`) and drives as people do (`driving`): as hard as the traffic of its scene, jerk
# included.
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
@dataclass(frozen=True, repr=False)
class ByRulesOfFocused(AttackConfig):
    """The cost of focused, its rules and its starts."""

    method: str = "focused"
    cost: Cost = Cost(softmin_m=2.0, pull_from_behind=False, pull_standing=False)
    rules: Rules = Rules(cancel_front_steering=True, exclude_rear=True)
    limits: Limits = Limits(driving="ordinary")
    search: Literal["joint", "per-candidate"] = "per-candidate"
    nearest: int = 8
    background: Literal["log", "reactive"] = "reactive"
    accept: Literal["any", "clean", "telling"] = "telling"
    adversary_may: AdversaryMay = "mistakes"
    adversary_kinds: tuple[RoadUser, ...] = ("vehicle", "cyclist", "pedestrian")
    starts: int = 12
    attempts: int = 3
    sampled: int = 2
    patience: int = 100
    near_m: float = 4.0
    drives: int = 250


@final
@dataclass(frozen=True, repr=False)
class Focused(ByRulesOfFocused):
    """Ours: telling crashes, for each candidate from lawful drives, by CMA-ES and by a descent."""


@dataclass(frozen=True, repr=False)
class _WithoutGradient(ByRulesOfFocused):
    """The cost of focused without its gradient, with as many roll-outs for each candidate."""

    iterations: int = 1500
    attempts: int = 1
    sampled: int = 0
    patience: int = 0

    descends: ClassVar[bool] = False


@final
@dataclass(frozen=True, repr=False)
class RandomSearch(_WithoutGradient):
    """Changes of a drive at random."""

    method: str = "random"

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """Changes of the start at random."""
        from regents_cosim.attacks.sampling.sampled_search import AtRandom, Sampling

        return Sampling(candidate.scenario.id, candidate.job._replace(start=start), self, AtRandom, self.iterations)


@final
@dataclass(frozen=True, repr=False)
class CmaEs(_WithoutGradient):
    """Changes of a drive by CMA-ES."""

    method: str = "cma-es"

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """CMA-ES around the start."""
        return super().longer(candidate, start, samples=True)


@final
@dataclass(frozen=True, repr=False)
class StartsAlone(ByRulesOfFocused):
    """A look at every start and at the log without a search: what the rules find by themselves."""

    method: str = "starts"
    sampled: int = 0

    descends: ClassVar[bool] = False

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """One more look."""
        from regents_cosim.attacks.methods.attempts import OneDescent

        return OneDescent(start, updates=0)

    @property
    def rollouts(self) -> int:
        """The most roll-outs of a longer search, which is one look."""
        return 1


@dataclass(frozen=True, repr=False)
class AsInCode(AttackConfig):
    """A method as in the public ReGentS code, where that departs from its paper."""

    def __post_init__(self) -> None:
        super().__post_init__()
        choices = (self.search, self.background, self.accept, self.cost.pull_from_behind, self.cost.pull_standing)
        require(
            self.cost.softmin_m == 0.0 and choices == ("joint", "log", "any", True, True),
            "the public code has no soft minimum, no search per candidate and no reactive background, which are ours: "
            f"{self.method or 'it'} takes search `joint` and background `log`",
            RegentsError,
        )
        require(
            self.adversary_kinds == ("vehicle",),
            f"adversary kinds {','.join(self.adversary_kinds)}: the public code moves vehicles alone, take `vehicle`",
            RegentsError,
        )

    def movable(self, world: "World") -> "Bool[Array, ' agent']":
        """The agents whose controls the public code may change."""
        from regents_cosim.attacks.descent.published import candidates

        return candidates(world, self)

    def present(self, scenario: "Scenario") -> "Scenario":
        """The scenario, whose agents stay to its end."""
        from regents_cosim.attacks.descent.published import stay

        return stay(scenario)

    def descent(self) -> "type[Descent]":
        """The descent of the public code."""
        from regents_cosim.attacks.descent.published import PublishedDescent

        return PublishedDescent

    def of_programs(self) -> type[AttackConfig]:
        """The class of the compiled settings."""
        return AsInCode


@final
@dataclass(frozen=True, repr=False)
class KingCode(AsInCode):
    """KING as in the public code."""

    method: str = "king-code"


@final
@dataclass(frozen=True, repr=False)
class RegentsCode(AsInCode):
    """ReGentS as in the public code."""

    method: str = "regents-code"
    rules: Rules = _OF_REGENTS


KING, REGENTS, REGENTS_FOCUSED = King(), Regents(), Focused()
OURS = REGENTS_FOCUSED  # methods are compared by its rules
RANDOM, CMA_ES, STARTS = RandomSearch(), CmaEs(), StartsAlone()

METHODS = {
    preset.method: preset
    for preset in (REGENTS, KING, REGENTS_FOCUSED, STARTS, RANDOM, CMA_ES, KingCode(), RegentsCode())
}


def road_users(text: str) -> tuple[RoadUser, ...]:
    """Parse text such as `vehicle,cyclist`. Raises RegentsError."""
    kinds = tuple(kind.strip() for kind in text.split(","))
    _check_kinds(kinds)
    return cast(tuple[RoadUser, ...], kinds)


def preset(method: str, **given: Any) -> AttackConfig:
    """The preset `method`, or a user's method of that name, with the `given` values; None keeps the value it has.

    Raises RegentsError for an unknown name, and for values that do not go together.
    """
    from regents_cosim.attacks.methods.own_methods import own_method

    found = METHODS.get(method) or own_method(method)
    return found.but(**{name: value for name, value in given.items() if value is not None})
