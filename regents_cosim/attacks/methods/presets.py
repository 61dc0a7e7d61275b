"""The methods of attack with their settings: KING, ReGentS, focused, and what they are compared with.

A method is a class that begins a search for each candidate. Its fields are its settings, and their defaults its preset.
"""

from dataclasses import dataclass, fields, replace
from inspect import get_annotations
from typing import TYPE_CHECKING, Any, ClassVar, Literal, cast, final, get_args

from regents_cosim.checks.names import did_you_mean, require_file_name
from regents_cosim.checks.ranges import Range, check_ranges
from regents_cosim.errors import RegentsError, require
from regents_cosim.norms.grades import AdversaryMay
from regents_cosim.scenario.road_users import ROAD_USERS, Kind, RoadUser
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.foreign_code import foreign_code, said_by
from regents_cosim.system.process_kept import process_kept
from regents_cosim.system.user_code import import_named, place_of, plugins

if TYPE_CHECKING:
    from regents_cosim.attacks.job import Candidate
    from regents_cosim.attacks.methods.moves import Search
    from regents_cosim.attacks.sampling.sampled_search import Sampler
    from regents_cosim.mirror.bicycle import ControlArrays

_MOST_ITERATIONS = 100_000
_WEIGHT = Range(0.0, 1e6, "the weight of a cost")
_BOUND = Range(0.0, 1e3, "m/s^2, or 0 where `driving` decides")
_RANGES = {
    "iterations": Range(1, _MOST_ITERATIONS, "updates at most", whole=True),
    "patience": Range(0, _MOST_ITERATIONS, "iterations without progress, or 0 for no end to it", whole=True),
    "near_m": Range(0.0, 1e4, "metres from which on a search has less patience, or 0 for the same everywhere"),
    "learning_rate": Range(1e-9, 10.0, "the step of an update"),
    "pair_weight": _WEIGHT,
    "usual_weight": _WEIGHT,
    "at_least_usual": Range(0.0, 100.0, "percent, or 0 for any drive"),
    "road_weight": _WEIGHT,
    "pair_reach_m": Range(0.0, 1e4, "metres within which background agents repel each other"),
    "max_deviation": Range(0.0, 2.0, "a share of an action's limit, or 0 for no bound"),
    "max_accel": _BOUND,
    "max_braking": _BOUND,
    "max_lateral_accel": _BOUND,
    "max_jerk": Range(0.0, 1e3, "m/s^3, or 0 where `driving` decides"),
    "softmin_m": Range(0.0, 1e4, "metres, or 0 for the mean over time"),
    "starts": Range(0, 1000, "drives to begin with per candidate, or 0 for the log alone", whole=True),
    "attempts": Range(1, 1000, "searches per candidate", whole=True),
    "sampled": Range(0, 1000, "of the attempts those that sample, or 0 for descents alone", whole=True),
    "nearest": Range(1, 1000, "candidates that get a search of their own", whole=True),
    "replan_every": Range(0, _MOST_ITERATIONS, "iterations between two closed loops, or 0 for the usual", whole=True),
    "drives": Range(0, _MOST_ITERATIONS, "drives of the planner in a window at most, or 0 for any number", whole=True),
}


def _check_kinds(kinds: tuple[str, ...]) -> None:
    known = get_args(RoadUser)
    require(
        bool(kinds) and set(kinds) <= set(known) and len(set(kinds)) == len(kinds),
        f"adversary kinds {','.join(kinds)!r}: expected one or more of {','.join(known)}, each once",
        RegentsError,
    )


@dataclass(frozen=True, repr=False)
class _Part(ShortRepr):
    """A part of a method's settings. Raises RegentsError for a value out of its range."""

    def __post_init__(self) -> None:
        check_ranges(self, {name: allowed for name, allowed in _RANGES.items() if hasattr(self, name)})


@dataclass(frozen=True, repr=False)
class Steps(_Part):
    """The updates of a search: how many, how long without progress, and how large by which gradient."""

    iterations: int = 500
    """largest number of updates of a search"""
    patience: int = 0
    """number of updates without progress (the distance to the ego falls by less than 2 %) after which a search ends; 0:
    it never ends early"""
    near_m: float = 0.0
    """distance to the ego above which a search has less patience [m]; 0: the same patience everywhere"""
    learning_rate: float = 1e-3
    """step of an update by Adam, as a share of a control's limit"""
    gradient: Literal["adversary", "through-planner"] = "adversary"
    """adversary: the planner's track counts as constant; through-planner: the gradient also passes through the
    planner (only in JAX)"""


@dataclass(frozen=True, repr=False)
class Acceptance(_Part):
    """The crash that ends a search."""

    accept: Literal["any", "clean", "telling"] = "any"
    """which crash ends a search: any; clean: one without a flaw; telling: one that a careful driver also avoids"""
    adversary_may: AdversaryMay = "anything"
    """what the adversary may do against the rules: mistakes, such as failing to give way, drifting out of its
    lane or driving up to 20 % too fast; none: it keeps every rule; anything: it may also break the law grossly, such as
    run a red light or drive in oncoming lanes"""
    at_least_usual: float = 0.0
    """smallest share of ordinary continuations that take as much effort as the adversary's drive, if that is known
    [percent]; 0: any drive counts"""


@dataclass(frozen=True, repr=False)
class Tries(_Part):
    """How often each candidate is searched, and from what."""

    starts: int = 0
    """number of drives on lawful paths, timed to meet the ego, that are tried for each candidate before the search"""
    attempts: int = 1
    """largest number of searches for each candidate, each from another start, until one succeeds"""
    sampled: int = 0
    """how many of these searches, the first ones, sample changes (CMA-ES) instead of using gradients"""

    @property
    def samples(self) -> int:
        """The number of attempts that sample instead of descending."""
        return min(self.sampled, self.attempts - 1)


@dataclass(frozen=True, repr=False)
class Candidates(_Part):
    """Who may attack, alone or together."""

    search: Literal["joint", "per-candidate"] = "joint"
    """joint: one search over all candidates; per-candidate: one for each of the nearest, and a case for every adversary
    found"""
    nearest: int = 5
    """number of candidates that are searched one by one, the nearest first"""
    adversary_kinds: tuple[RoadUser, ...] = ("vehicle",)
    """road users that may attack"""
    adversaries: Literal["all", "one"] = "all"
    """all: a case for each candidate that succeeds; one: the first success ends the search of a window, and its best
    crash is the only case"""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_kinds(self.adversary_kinds)

    @property
    def kinds(self) -> frozenset[Kind]:
        """The kinds of road users that may attack, as scenarios name them."""
        return frozenset[Kind]().union(*(ROAD_USERS[user] for user in self.adversary_kinds))


@dataclass(frozen=True, repr=False)
class Traffic(_Part):
    """How the scene moves in a roll-out, and how often the planner drives in it."""

    dynamics: Literal["recorded", "bicycle", "highway"] = "recorded"
    """model of motion: bicycle: the mirror's; highway: exactly that of highway-env; recorded: that of the simulator
    that recorded the window"""
    background: Literal["log", "reactive"] = "log"
    """how other road users move: log: as recorded; reactive: vehicles react to others"""
    replan_every: int = 0
    """in every which iteration of a descent the planner drives; 0: in every one if it is in JAX, else in every tenth"""
    drives: int = 0
    """largest number of drives of a planner outside JAX in one window; 0: any number"""


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
    usual_weight: float = 0.0
    """weight of how unlikely the adversary's accelerations and jerk are in ordinary traffic [m/nat]; 0: they do not
    count"""
    pull_from_behind: bool = True
    """whether steps at which the adversary is behind the ego pull as well"""
    pull_standing: bool = True
    """whether steps at which the ego stands pull as well"""


@dataclass(frozen=True, repr=False)
class Rules(_Part):
    """The rules of ReGentS (section 3.3): who may steer and who may attack; its constants in `accept.rules`."""

    cancel_front_steering: bool = False
    """ReGentS rule 1: do not steer an adversary that is ahead of the ego and turns away to its own side (red zone)"""
    exclude_rear: bool = False
    """ReGentS rule 2: a road user that stays behind the ego is no candidate"""
    exclude_static: bool = False
    """ReGentS rule 3: a road user that stands is no candidate"""


@dataclass(frozen=True, repr=False)
class Limits(_Part):
    """How hard an adversary may drive."""

    max_deviation: float = 0.0
    """largest change of a control from its logged value, as a share of the limit of controls; 0: any change"""
    driving: Literal["any", "ordinary"] = "any"
    """ordinary: the adversary drives at most as hard as drivers in the traffic of its window, or as is usual for its
    kind; any: as hard as the mirror allows"""
    max_accel: float = 0.0
    """highest acceleration of the adversary, unless its log exceeds it [m/s^2]; 0: as `driving` says"""
    max_braking: float = 0.0
    """hardest braking of the adversary, unless its log exceeds it [m/s^2]; 0: as `driving` says"""
    max_lateral_accel: float = 0.0
    """highest lateral acceleration of the adversary, unless its log exceeds it [m/s^2]; 0: as `driving` says"""
    max_jerk: float = 0.0
    """highest jerk of the adversary, unless its log exceeds it [m/s^3]; 0: as `driving` says"""


@dataclass(frozen=True, repr=False)
class AttackConfig(ShortRepr):
    """A method of attack: its settings, and the search that it begins for each candidate.

    The settings are grouped in parts; `but(iterations=100, nearest=2)` returns the method with other values of some of
    them. The defaults are those that both papers share, and the search is a descent. Controls are optimised in [-1, 1],
    as shares of the mirror's limits, so `learning_rate` x `iterations` bounds their change. Raises RegentsError for
    values out of range, or that do not go together.
    """

    method: str
    """name of the preset"""
    steps: Steps = Steps()
    """the updates of a search"""
    acceptance: Acceptance = Acceptance()
    """the crash that ends a search"""
    tries: Tries = Tries()
    """how often each candidate is searched, and from what"""
    candidates: Candidates = Candidates()
    """who may attack"""
    traffic: Traffic = Traffic()
    """how the scene moves"""
    cost: Cost = Cost()
    """what it lowers"""
    rules: Rules = Rules()
    """the rules of ReGentS"""
    limits: Limits = Limits()
    """how hard an adversary may drive"""

    descends: ClassVar[bool] = True  # whether its longer searches descend

    def __post_init__(self) -> None:
        require_file_name(self.method or "none", "method")  # a part of the ids of cases; empty in programs
        hash(self)  # compiled programs are found by it: an own field that is a list fails here
        one_by_one, by_adversary = self.candidates.search == "per-candidate", self.steps.gradient == "adversary"
        require(
            by_adversary or self.traffic.background == "log",
            "a gradient through the planner needs background `log`: reactions are not differentiated",
            RegentsError,
        )
        require(
            by_adversary or self.traffic.replan_every <= 1,
            "a gradient through the planner needs it in every iteration: replan_every 1",
            RegentsError,
        )
        require(
            self.descends or (one_by_one and by_adversary),
            f"method {self.method} searches one candidate at a time and knows no gradient: "
            "take search `per-candidate` and gradient `adversary`",
            RegentsError,
        )
        require(
            not self.bound or one_by_one,
            f"adversary-may `{self.acceptance.adversary_may}` gives each candidate a map of its own: take search "
            "`per-candidate`, or adversary-may `anything`",
            RegentsError,
        )
        require(
            self.tries.attempts == 1 or self.tries.starts > 0 or not one_by_one,
            f"{self.tries.attempts} attempts need somewhere else to begin: take `starts` of 1 or more, or 1 attempt",
            RegentsError,
        )

    def begin(self, candidate: "Candidate") -> "Search":
        """Begin the search for a candidate: a look at every start, then longer searches."""
        from regents_cosim.attacks.methods.attempts import Attempts

        return Attempts(candidate, self.longer, self.tries.starts, self.attempts_sample)

    @property
    def attempts_sample(self) -> tuple[bool, ...]:
        """Whether each attempt samples, in order; the others descend."""
        return tuple(index < self.tries.samples for index in range(self.tries.attempts))

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """A longer search from a start (None: the log): a descent, or where it `samples` changes by `sampler`."""
        from regents_cosim.attacks.methods.attempts import OneDescent
        from regents_cosim.attacks.sampling.sampled_search import Sampling

        if not samples:
            return OneDescent(start, self.steps.iterations)
        job = candidate.job._replace(start=start)
        return Sampling(candidate.scenario.id, job, self, self.sampler, self.steps.iterations)

    def sampler(self, seed: int) -> "Sampler":
        """What proposes changes of a start: CMA-ES."""
        from regents_cosim.attacks.sampling.sampled_search import ByEvolution

        return ByEvolution(seed)

    @property
    def rollouts(self) -> int:
        """The most roll-outs of a longer search."""
        return self.steps.iterations

    @property
    def in_words(self) -> str:
        """What the method does, as its class says first."""
        words = " ".join((type(self).__doc__ or "").partition("\n\n")[0].split()).rstrip(".")
        return words[:1].lower() + words[1:]

    def compiled(self) -> "AttackConfig":
        """The settings on which compiled programs depend, with rounded iterations, as a method that merely descends."""
        may: AdversaryMay = "mistakes" if self.bound else "anything"
        return AttackConfig(
            method="",
            steps=replace(self.steps, iterations=max(-(-self.steps.iterations // _ROOM), 1) * _ROOM),
            acceptance=Acceptance(self.acceptance.accept, may),
            candidates=Candidates(search=self.candidates.search),
            traffic=Traffic(background=self.traffic.background),
            cost=self.cost,
            rules=Rules(cancel_front_steering=self.rules.cancel_front_steering),
            limits=Limits(max_deviation=self.limits.max_deviation),
        )

    @property
    def settings(self) -> dict[str, Any]:
        """All settings by name, whichever part holds them."""
        parts = [vars(part) if isinstance(part, _Part) else {name: part} for name, part in vars(self).items()]
        return {name: value for part in parts for name, value in part.items()}

    def but(self, **settings: Any) -> "AttackConfig":
        """The method with other settings, each by its name, whichever part holds it. Raises RegentsError."""
        for part in fields(self):
            held = getattr(self, part.name)
            if isinstance(held, _Part):
                own = {name: settings.pop(name) for name in vars(held) if name in settings}
                settings |= {part.name: replace(held, **own)} if own else {}
        return replace(self, **settings)

    @property
    def bound(self) -> bool:
        """Whether the adversary keeps to its lanes and turns, to lights, and near the speed limit."""
        return self.acceptance.adversary_may != "anything"

    @property
    def protocol(self) -> tuple[tuple[str, object], ...]:
        """The rules of the search, which must agree for a comparison of methods.

        The cost (soft minimum, pulls), the method's rules for candidates, and who lowers the cost are not part of it.
        """
        alone = () if self.candidates.search == "per-candidate" else _ALONE
        return tuple((name, self.settings[name]) for name in PROTOCOL if name not in alone)

    def by_protocol_of(self, other: "AttackConfig") -> "AttackConfig":
        """The method, with the rules of `other`."""
        return self.but(**{name: other.settings[name] for name in PROTOCOL})

    @property
    def noted(self) -> dict[str, Any]:
        """The settings that every case notes, without those that are noted elsewhere or only if set."""
        unset = tuple(name for name in _NOTED_IF_SET if not self.settings[name])
        every = {name: value for name, value in self.settings.items() if isinstance(value, bool | int | float | str)}
        return {name: value for name, value in every.items() if name not in _NOTED_ELSEWHERE + unset}


_NOTED_ELSEWHERE = ("method", "adversary_kinds", "dynamics")
_NOTED_IF_SET = ("near_m",)


PROTOCOL = (
    "search", "nearest", "starts", "attempts", "adversaries", "accept", "adversary_may", "at_least_usual", "driving",
    "background", "iterations", "patience", "near_m", "replan_every", "drives",
)  # fmt: skip
_ALONE = ("nearest", "starts", "attempts", "adversaries")  # only for a search per candidate
_ROOM = 500  # iterations for which programs store the costs


_OF_REGENTS = Rules(cancel_front_steering=True, exclude_rear=True, exclude_static=True)


@final
@dataclass(frozen=True, repr=False)
class King(AttackConfig):
    """One descent for all candidates, by the cost of the papers (KING, Hanselmann et al. 2022)."""

    method: str = "king"


@final
@dataclass(frozen=True, repr=False)
class Regents(AttackConfig):
    """King with three rules for who may attack and steer (ReGentS, Yin et al. 2024)."""

    method: str = "regents"
    rules: Rules = _OF_REGENTS


_SEARCHES = 8  # of `focused` for each candidate


# A mean over time rewards staying close rather than hitting ("time-averaged distance bias" of the ReGentS paper), and a
# minimum over candidates commits to one ("minimum trap"). So here the soft minimum pulls the closest moments together,
# each candidate is searched alone, none is pulled from behind or towards a standing ego, and followers brake for the
# ego instead of hitting it.
# The wanted crash is a telling one: a careful driver prevents it by braking (`accept`), and the adversary makes no more
# than a mistake (`adversary_may`) and drives as people do (`driving`): as hard as the traffic of its scene, jerk
# included.
# The gradient pulls straight across, where the law forbids it. So the search first looks at drives on lawful paths that
# meet the ego, and descends from the most promising one before it descends from the log. It searches the candidates
# with the most promising drives among three times as many. An agent that stands may pull out, so it counts as well.
# Most descents never get anywhere, and show it early, the earlier the further away they are (`near_m`; `patience`).
# A descent ends at the nearest crash, or passes it if it is not telling. So all searches but the last sample changes,
# each of another drive, and only the last one descends.
@dataclass(frozen=True, repr=False)
class ByRulesOfFocused(AttackConfig):
    """The cost of focused, its rules and its starts."""

    method: str = "focused"
    cost: Cost = Cost(softmin_m=2.0, pull_from_behind=False, pull_standing=False)
    rules: Rules = Rules(cancel_front_steering=True, exclude_rear=True)
    limits: Limits = Limits(driving="ordinary")
    candidates: Candidates = Candidates("per-candidate", 8, ("vehicle", "cyclist", "pedestrian"))
    traffic: Traffic = Traffic(background="reactive", drives=200)
    acceptance: Acceptance = Acceptance("telling", "mistakes")
    tries: Tries = Tries(starts=12, attempts=_SEARCHES, sampled=_SEARCHES - 1)
    steps: Steps = Steps(patience=60, near_m=4.0)


@final
@dataclass(frozen=True, repr=False)
class Focused(ByRulesOfFocused):
    """Ours, for telling crashes: from drives on lawful paths, by CMA-ES, then by a descent."""


@dataclass(frozen=True, repr=False)
class BySampling(ByRulesOfFocused):
    """The cost of focused without its gradient, with as many roll-outs for each candidate: of changes by `sampler`."""

    tries: Tries = Tries(starts=12)
    steps: Steps = Steps(iterations=_SEARCHES * Steps().iterations, near_m=4.0)

    descends: ClassVar[bool] = False

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """Changes of the start."""
        return super().longer(candidate, start, samples=True)


@final
@dataclass(frozen=True, repr=False)
class RandomSearch(BySampling):
    """For comparison, changes of a drive at random."""

    method: str = "random"

    def sampler(self, seed: int) -> "Sampler":
        """A sampler that never learns."""
        from regents_cosim.attacks.sampling.sampled_search import AtRandom

        return AtRandom(seed)


@final
@dataclass(frozen=True, repr=False)
class CmaEs(BySampling):
    """For comparison, changes of a drive by CMA-ES."""

    method: str = "cma-es"


@final
@dataclass(frozen=True, repr=False)
class StartsAlone(ByRulesOfFocused):
    """For comparison, a look at every start and at the log: what the rules find without a search."""

    method: str = "starts"
    tries: Tries = Tries(starts=12)

    descends: ClassVar[bool] = False

    def longer(self, candidate: "Candidate", start: "ControlArrays | None", samples: bool) -> "Search":
        """One more look."""
        from regents_cosim.attacks.methods.attempts import OneDescent

        return OneDescent(start, updates=0)

    @property
    def rollouts(self) -> int:
        """The most roll-outs of a longer search, which is one look."""
        return 1


KING, REGENTS, REGENTS_FOCUSED = King(), Regents(), Focused()
OURS = REGENTS_FOCUSED  # methods are compared by its rules
RANDOM, CMA_ES, STARTS = RandomSearch(), CmaEs(), StartsAlone()

METHODS = {preset.method: preset for preset in (REGENTS_FOCUSED, REGENTS, KING, RANDOM, CMA_ES, STARTS)}


def road_users(text: str) -> tuple[RoadUser, ...]:
    """Parse text such as `vehicle,cyclist`. Raises RegentsError."""
    kinds = tuple(kind.strip() for kind in text.split(","))
    _check_kinds(kinds)
    return cast(tuple[RoadUser, ...], kinds)


def preset(method: str, **given: Any) -> AttackConfig:
    """The preset `method`, or a user's method of that name, with the `given` values; None keeps the value it has.

    Raises RegentsError for an unknown name, and for values that do not go together.
    """
    found = METHODS.get(method) or own_method(method)
    return found.but(**{name: value for name, value in given.items() if value is not None})


GROUP = "regents_cosim.methods"


def own_method(name: str) -> AttackConfig:
    """The method with its default settings. Raises RegentsError where there is none of that name."""
    module_name, attribute, installed = place_of(name, GROUP)
    if not module_name:
        if name.endswith(".py"):
            raise RegentsError(f"method {name!r} is a file: name the method in it as well, {name}:CLASS")
        raise RegentsError(f"method {name!r} is not known: {did_you_mean(name, [*METHODS, *plugins(GROUP)])}")
    from regents_cosim.mirror.programs.jax_settings import settings_kept  # imports JAX

    with process_kept(), settings_kept():
        module = import_named(module_name, f"method {name!r}", installed=installed)
    found: Any = getattr(module, attribute, None)
    with foreign_code(lambda error: RegentsError(f"method {name!r} cannot be made: {said_by(error)}")):
        made: Any = found() if isinstance(found, type) else found
    if not isinstance(made, AttackConfig):
        raise RegentsError(f"method {name!r}: {module_name} has no {attribute!r} that is an AttackConfig")
    if get_annotations(type(made)) and "__dataclass_fields__" not in vars(type(made)):
        raise RegentsError(f"method {name!r}: {attribute} has fields, but no @dataclass(frozen=True) above it")
    if made.method in METHODS:
        raise RegentsError(
            f"method {name!r}: its field 'method' is {made.method!r}, one of ours, expected another name"
        )
    return made
