"""Scores of a method on windows of traffic: the counts of the papers, and those of meaningful crashes."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, fields
from statistics import fmean, median
from typing import Any, NamedTuple, get_args
from weakref import WeakKeyDictionary

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.evaluation.crashes.failures import count_reasons, failing_offences
from regents_cosim.evaluation.crashes.realism import distances_to_traffic
from regents_cosim.evaluation.drives.driving import DriveResult, driving_row, score
from regents_cosim.evaluation.drives.metrics import METRICS
from regents_cosim.evaluation.statistics import percent, percent_interval
from regents_cosim.norms.grades import OFFENCES_ON_FOOT, OffenceName
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.behaviour import death_risk_of, deviation_m

Results = Sequence[Scenario]  # of one window: one of a joint search; one for each adversary of a search per candidate
Interval = tuple[float, float]
Protocol = tuple[tuple[str, object], ...]  # settings of a search, by name (`AttackConfig.protocol`)
USUAL = tuple(range(0, 101, 5))  # percentages: successes are counted by the least usualness of the adversary


class CrashInSumo(NamedTuple):
    """The result of a crash's replay in SUMO."""

    case: str
    verified: bool  # the same contact at the same step by SUMO's positions
    listed: bool  # SUMO's own list of collisions contains the pair


@dataclass(frozen=True, eq=False)
class MethodRun:
    """A method's judged results on some windows."""

    method: str
    planner: str
    rollouts: int  # most roll-outs per window
    windows: Sequence[Results]
    in_sumo: Sequence[CrashInSumo] = ()  # of the crashes
    seconds: float = 0.0  # of the search on all cores
    protocol: Protocol = ()  # of the search; empty for methods without one


@dataclass(frozen=True)
class MethodScores:
    """Scores of a method. Percentages of windows have n and 95 % Wilson intervals, those of crashes refer to all."""

    method: str
    planner: str
    source: str  # file that the traffic came from, or "all"
    protocol: str  # of the search, in words
    rollouts: int  # most per window
    mean_rollouts: float | None  # actual number per window; None where it was not counted
    windows: int
    colliding_before: int
    n: int  # windows without a collision before the attack
    telling: int  # windows with a telling crash (`Judgement.telling`)
    telling_percent: float
    telling_interval: Interval
    flawless: int  # windows with a telling crash whose adversary keeps every rule
    flawless_percent: float
    flawless_interval: Interval
    telling_unknown: int  # windows without, but with a crash for which it is unknown (no directions, say)
    successes: int  # windows with a crash, as the papers count
    success_percent: float
    success_interval: Interval
    clean: int  # windows with a crash that nothing spoils
    clean_percent: float
    clean_interval: Interval
    route_completion_percent: float  # over all windows, where the ego stops at a collision
    infraction_score: float
    driving_score_percent: float
    collision_rate_percent: float
    red_lights: int  # number that the ego ran
    red_light_windows: int  # windows in which it ran any
    lights_known: int  # windows in which lights are known
    against_direction_percent: float | None  # share of the ego's way, where lanes are known
    crashes: int
    collision_types: dict[str, int]
    impact_m_s: float | None  # mean relative speed at the contact
    death_risk_percent: float | None  # mean over pedestrians hit by the ego's front; None if there were none
    flaws: dict[str, int]  # crashes with each flaw
    preventions: dict[str, int]  # crashes by whether a careful driver prevents them (`Prevention`)
    conducts: dict[str, int]  # crashes by how the adversary behaves (`Conduct`)
    offences: dict[str, int]  # crashes by the adversary's offence
    ego_offences: dict[str, int]  # crashes by the ego's offence
    offences_told: dict[str, int]  # crashes in which each offence can be decided
    usual_percent: float | None  # median rank of the adversaries among continuations of the same moment
    usual_unknown: int  # crashes without a known rank
    telling_by_usual: dict[str, float]  # % of windows with a telling crash, by least usualness
    flawless_by_usual: dict[str, float]  # likewise with a flawless one
    at_fault: dict[str, int]
    min_ttc_p5_s: float | None
    max_drac_p95_m_s2: float | None
    deviation_m: float | None  # mean distance of the adversary to its log, up to the collision
    realism_distance: dict[str, float]  # Wasserstein distance between adversaries and all background traffic
    verified_in_sumo: int  # the same contact at the same step by SUMO's positions
    in_sumos_list: int
    failures: dict[str, int]  # reasons why windows have no telling crash
    failing_offences: dict[str, int]  # offences of the adversaries where these are the reason
    seconds: float


# Those that are columns of a drive's metric.
_OF_DRIVES = {one.name for one in fields(MethodScores)} & {part.name for one in METRICS for part in one.columns}


def scores(run: MethodRun, source: str = "all", files: Collection[str] | None = None) -> MethodScores:
    """The scores of a run, or of its windows from `files` only, which are called `source`."""
    windows = [results for results in run.windows if files is None or results[0].provenance.file in files]
    kept = {case.id for results in windows for case in results}
    in_sumo = [one for one in run.in_sumo if one.case in kept]
    judged = [results for results in windows if not collided_before(results)]
    crashes = [case for results in judged for case in results if case.judgement]
    driven = driving_row(source, [_drive_in(results[0]) for results in windows])
    return MethodScores(
        method=run.method,
        planner=run.planner,
        source=source,
        protocol=in_words(run.protocol),
        rollouts=run.rollouts,
        mean_rollouts=_mean_rollouts(judged),
        windows=len(windows),
        colliding_before=len(windows) - len(judged),
        red_light_windows=driven.red_light_cases,
        **{name: driven.columns[name] for name in _OF_DRIVES},
        verified_in_sumo=sum(one.verified for one in in_sumo),
        in_sumos_list=sum(one.listed for one in in_sumo),
        seconds=round(run.seconds, 1),
        **_of_windows(judged),
        **_of_crashes(crashes),
        **_of_law(crashes),
    )


_DRIVES = WeakKeyDictionary[Scenario, DriveResult]()  # a table is made again after each place, and for its parts


def _drive_in(case: Scenario) -> DriveResult:
    """The ego's drive in a result, measured once."""
    if case not in _DRIVES:
        _DRIVES[case] = score(case, case.tracks)
    return _DRIVES[case]


def _of_windows(judged: Sequence[Results]) -> dict[str, Any]:
    """Scores by windows, without those that have a collision before the attack."""
    n, found = len(judged), dict[str, Any]()
    for name, which in COUNTS.items():
        number = count_windows(judged, which)
        found |= {"successes" if name == "success" else name: number}
        found |= {f"{name}_percent": percent(number, n), f"{name}_interval": percent_interval(number, n)}
    return found | {
        "n": n,
        "telling_unknown": sum(_unknown(results) for results in judged),
        "telling_by_usual": _by_usual(judged, is_telling),
        "flawless_by_usual": _by_usual(judged, is_flawless),
        "failures": {str(reason): number for reason, number in count_reasons(judged).items()},
        "failing_offences": dict(Counter(name for results in judged for name in failing_offences(results))),
    }


def _by_usual(judged: Sequence[Results], which: Callable[[Scenario], bool]) -> dict[str, float]:
    """The share of windows [percent] with such a crash by an adversary that is known to be usual by so many percent."""

    def share(least: int) -> float:
        return percent(count_windows(judged, lambda case: which(case) and (_usual(case) or 0.0) >= least), len(judged))

    return {str(least): share(least) for least in USUAL}


def _of_crashes(crashes: Sequence[Scenario]) -> dict[str, Any]:
    hits = [case.collision for case in crashes if case.collision]
    return {
        "crashes": len(crashes),
        "collision_types": dict(Counter(hit.collision_type for hit in hits)),
        "impact_m_s": _mean([hit.relative_speed for hit in hits]),
        "death_risk_percent": _mean([100.0 * risk for hit in hits if (risk := death_risk_of(hit)) is not None]),
        "flaws": _count(flaw for case in crashes if case.judgement for flaw in case.judgement.flaws),
        "usual_percent": _mean([rank for case in crashes if (rank := _usual(case)) is not None], median),
        "usual_unknown": sum(_usual(case) is None for case in crashes),
        "deviation_m": _mean([apart for case in crashes if (apart := deviation_m(case)) is not None]),
        "realism_distance": {name: round(apart, 3) for name, apart in distances_to_traffic(crashes).items()},
    }


def _of_law(crashes: Sequence[Scenario]) -> dict[str, Any]:
    judgements = [case.judgement for case in crashes if case.judgement]
    laws = [judgement.law for judgement in judgements if judgement.law]
    return {
        "preventions": _count(judgement.prevention for judgement in judgements),
        "conducts": _count(judgement.conduct for judgement in judgements),
        "offences": _count(name for law in laws for name in {offence.name for offence in law.adversary}),
        "ego_offences": _count(name for law in laws for name in {offence.name for offence in law.ego}),
        "offences_told": _count(name for case in crashes for name in told_offences(case)),
        "at_fault": dict(Counter(judgement.fault.at_fault for judgement in judgements if judgement.fault)),
    }


def collided_before(results: Results) -> bool:
    """Whether the planner collides without an attack in this window."""
    return any(case.attack is not None and case.attack.outcome == "already_colliding" for case in results)


def is_telling(case: Scenario) -> bool:
    """Whether the crash is known to be telling."""
    return case.judgement is not None and case.judgement.telling is True


def is_flawless(case: Scenario) -> bool:
    """Whether the crash is known to be telling, and its adversary to keep every rule."""
    return case.judgement is not None and case.judgement.flawless is True


def is_crash(case: Scenario) -> bool:
    """Whether the attack made the ego collide."""
    return case.crash is not None


def is_clean(case: Scenario) -> bool:
    """Whether no flaw spoils the crash."""
    return case.judgement is not None and case.judgement.clean


COUNTS: dict[str, Callable[[Scenario], bool]] = {
    "telling": is_telling,
    "flawless": is_flawless,
    "success": is_crash,
    "clean": is_clean,
}


def count_windows(windows: Sequence[Results], which: Callable[[Scenario], bool]) -> int:
    """The number of windows in which `which` holds for some result."""
    return sum(any(map(which, results)) for results in windows)


def rollouts_at_most(config: AttackConfig) -> int:
    """The most closed loops of the planner that a search of a window may take."""
    if config.candidates.search == "joint":
        return config.steps.iterations
    return config.candidates.nearest * (config.tries.starts + config.tries.attempts * config.rollouts)


def in_words(protocol: Protocol) -> str:
    """A protocol in words, for tables."""
    return ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in protocol) or "-"


def told_offences(case: Scenario) -> set[str]:
    """The offences of the adversary's kind that the data of a crash can decide."""
    law = case.judgement.law if case.judgement else None
    on_foot = any(agent.role == "adversary" and agent.kind == "pedestrian" for agent in case.agents)
    never = frozenset() if on_foot else OFFENCES_ON_FOOT
    return set(get_args(OffenceName)) - set(law.unknown) - never if law else set()


def _unknown(results: Results) -> bool:
    """Whether a window has no crash known to be telling, and one for which it is unknown."""
    said = [case.judgement.telling for case in results if case.judgement]
    return True not in said and None in said


def _mean_rollouts(windows: Sequence[Results]) -> float | None:
    made = [results[0].attack.rollouts for results in windows if results[0].attack]
    return round(fmean(made), 1) if any(made) else None


def _count(words: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(words).items()))


def _usual(case: Scenario) -> float | None:
    return case.judgement.usual if case.judgement else None


def _mean(values: Sequence[float], mean: Callable[[Sequence[float]], float] = fmean) -> float | None:
    return round(mean(values), 2) if values else None
