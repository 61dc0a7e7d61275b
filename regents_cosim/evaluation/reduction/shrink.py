"""`regents shrink`: finds the smallest form of an attacked case in which the planner still crashes.

Four reductions are repeated until none of them makes progress:

1. agents other than the adversary return to their logged tracks,
2. the adversary keeps less of its change: of all its controls, of its accelerations, of its steering,
3. agents that do not matter are left out,
4. the window begins later and ends soon after the crash; the planner starts again there.

A reduction is kept if the planner, driving in closed loop, still meets the same adversary in the same way, by the exact
boxes, no new flaw spoils the crash, the adversary breaks no further law, and every reference driver that avoided the
crash still does: a telling crash stays telling. A shrunk case shrinks no further.

Source: delta debugging, Zeller and Hildebrandt 2002.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from regents_cosim.attack_record import Collision
from regents_cosim.cases.manifest import load_manifest
from regents_cosim.cases.suite import load_suite
from regents_cosim.checks.names import file_name
from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.evaluation.reduction.interpolation import AttackInterpolation, changed_agents
from regents_cosim.judgement import Flaw
from regents_cosim.planners.find import planner_of
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario import Overlap, Scenario, Signal, Tracks, with_rows
from regents_cosim.short_repr import ShortRepr
from regents_cosim.system.progress import ShowProgress, progress_for
from regents_cosim.verdicts.behaviour import deviation
from regents_cosim.verdicts.clean import flaws
from regents_cosim.verdicts.judge import judge

LEAD_S = 2.0  # least part of the window before the crash: the planner must have something to decide
_TAIL_S = 0.5  # part of the window after the crash
_SHARES = (0.0, 0.5, 0.75, 0.875, 0.9375)  # shares of the change that are tried
_LESS_M = 0.005  # least reduction of the deviation that counts
_LESS = 0.01  # the same as a share of the deviation


@dataclass(frozen=True, eq=False, repr=False)
class ShrunkCase(ShortRepr):
    """A case before and after shrinking; the latter is judged."""

    attacked: Scenario
    case: Scenario
    drives: int  # number of closed loops that shrinking took

    @property
    def begin(self) -> int:
        """The step of the attacked case at which the shrunk one begins."""
        later = self.case.provenance.begin_s - self.attacked.provenance.begin_s
        return round(later / self.attacked.dt)

    @property
    def in_time(self) -> Scenario:
        """The attacked case, cut so that it crashes at the same step as the shrunk one, for comparison."""
        hit = _collision(self.attacked)
        begin = max(hit.step - _collision(self.case).step, 0)
        from_there = cut(self.attacked, begin, self.attacked.tracks.steps - 1)
        moved = replace(hit, step=hit.step - begin, time_s=round((hit.step - begin) * from_there.dt, 9))
        return replace(from_there, attack=from_there.attack and replace(from_there.attack, collision=moved))


@dataclass(frozen=True)
class CaseSize:
    """The size of an attacked case."""

    case: str
    changed_agents: int  # agents more than 0.1 m from their logs somewhere
    deviation_mean_m: float  # of the adversary, up to the crash
    deviation_max_m: float
    steps: int
    agents: int
    collision_step: int
    collision_type: str
    impact_m_s: float


def size(attacked: Scenario) -> CaseSize:
    """The size of a case that ends in a collision."""
    hit = _collision(attacked)
    apart = deviation(attacked)
    assert apart is not None
    return CaseSize(
        case=attacked.id,
        changed_agents=len(changed_agents(attacked)),
        deviation_mean_m=round(apart.mean_m, 3),
        deviation_max_m=round(apart.max_m, 3),
        steps=attacked.tracks.steps,
        agents=len(attacked.agents),
        collision_step=hit.step,
        collision_type=hit.collision_type,
        impact_m_s=round(hit.relative_speed, 2),
    )


def shrink(
    attacked: Scenario,
    planner: AnyPlanner | None = None,
    *,
    lead_s: float = LEAD_S,
    act_timeout_s: float = ACT_TIMEOUT_S,
    progress: ShowProgress = True,
) -> ShrunkCase:
    """The smallest form of `attacked` in which `planner` still crashes; default: the attacked planner, if it is ours.

    The window begins at least `lead_s` [s] before the crash. A progress bar is shown on terminals and in notebooks
    unless `progress` is False. Raises RegentsError for a case without a collision, or in which this planner does not
    crash, PlannerError for one that cannot be found, DriveError where it fails.
    """
    at_the_wheel = planner_of(attacked) if planner is None else planner
    with progress_for(progress).waiting("shrinking"), MirrorController(at_the_wheel, act_timeout_s) as driver:
        return shrink_at(driver, attacked, lead_s)


def shrink_at(driver: MirrorController, attacked: Scenario, lead_s: float = LEAD_S) -> ShrunkCase:
    """Shrink `attacked` as by `shrink`, with the planner of `driver`."""
    hit = _collision(attacked)
    trial = _Trial(driver, hit.agent)
    case = trial.begin(attacked)
    reductions: tuple[_Reduction, ...] = (_put_back, _deviate_less, _leave_out, lambda c, t: _shorten(c, t, lead_s))
    before = None
    while case is not before:
        before = case
        for reduce in reductions:
            case = reduce(case, trial)
    return ShrunkCase(attacked, judge(case), trial.drives)


class _Trial:
    """Runs closed loops, and checks whether they end in the crash that is to be kept."""

    def __init__(self, driver: MirrorController, adversary: str) -> None:
        self._driver, self._adversary = driver, adversary
        self._type, self._flaws = "", frozenset[Flaw]()
        self._said = _TellingParts(frozenset(), frozenset())
        self.drives = 0

    def begin(self, attacked: Scenario) -> Scenario:
        """The case to begin with, under its new name. Raises RegentsError where the planner does not crash."""
        tracks = self._drive(attacked)
        found, own = first_contact(attacked.agents, tracks), first_contact(attacked.agents, attacked.tracks)
        if found is None or attacked.agents[found[0]].id != self._adversary:
            met = f"meets {attacked.agents[found[0]].id}" if found else "does not collide"
            raise RegentsError(
                f"case {attacked.id}: planner {self._driver.planner!r} {met}, expected a crash with {self._adversary}: "
                "nothing to shrink (name the planner that crashes here with --planner)"
            )
        case = _named(attacked, self._driver.planner)
        if found != own:
            case = self._as_driven(case, tracks)
        self._type, self._flaws, self._said = _collision(case).collision_type, _flaws(case), _said(case)
        return replace(case, judgement=None, evasion=None)

    def crash(self, smaller: Scenario) -> Scenario | None:
        """The planner's drive in `smaller`, where it crashes as before; None where it does not.

        The drive is repeated in the resulting case, since a replay of that must give the same.
        """
        try:
            driven = self._as_driven(smaller, self._drive(smaller))
            if not self._is_kept(driven):
                return None
            again = first_contact(driven.agents, self._drive(driven))
        except DriveError:
            return None
        return driven if again == first_contact(driven.agents, driven.tracks) else None

    def _drive(self, case: Scenario) -> Tracks:
        self.drives += 1
        return self._driver.drive(case).tracks

    def _as_driven(self, case: Scenario, tracks: Tracks) -> Scenario:
        contact = first_contact(case.agents, tracks)
        record = case.attack
        assert record is not None
        hit = None
        if contact is not None:
            attributed = record.collision is not None and record.collision.attributed
            hit = collision_at(case.agents, tracks, contact, case.dt, attributed)
        return replace(case, tracks=tracks, attack=replace(record, collision=hit), judgement=None, evasion=None)

    def _is_kept(self, driven: Scenario) -> bool:
        hit = driven.attack.collision if driven.attack else None
        if hit is None or (hit.agent, hit.collision_type) != (self._adversary, self._type):
            return False
        return _flaws(driven) <= self._flaws and _said(driven).says_no_less_than(self._said)


@dataclass(frozen=True)
class _TellingParts:
    """The facts that make a clean crash telling."""

    broken: frozenset[str]  # rules, by the adversary
    avoided_by: frozenset[str]  # reference drivers

    def says_no_less_than(self, other: "_TellingParts") -> bool:
        return self.broken <= other.broken and self.avoided_by >= other.avoided_by


_Reduction = Callable[[Scenario, _Trial], Scenario]


def _put_back(case: Scenario, trial: _Trial) -> Scenario:
    """Reduction 1: put others than the adversary back on their logged tracks."""
    log = case.log
    assert log is not None
    away = [
        agent.id
        for row, agent in enumerate(case.agents)
        if agent.role == "background"
        and any(not np.array_equal(getattr(case.tracks, n)[row], getattr(log, n)[row]) for n in ("x", "y", "yaw"))
    ]

    def logged(case: Scenario, names: Sequence[str]) -> Scenario:
        assert case.log is not None
        chosen = np.array([agent.id in names for agent in case.agents])
        return replace(case, tracks=with_rows(case.tracks, case.log, chosen))

    return _greedily(case, away, logged, trial)


def _deviate_less(case: Scenario, trial: _Trial) -> Scenario:
    """Reduction 2: move the adversary closer to its log."""
    found: Scenario | None = case
    while found is not None:
        case = found
        tried = (trial.crash(smaller) for smaller in _closer(case) if _is_closer(smaller, case))
        found = next((crash for crash in tried if crash and _is_closer(crash, case)), None)
    return case


def _closer(case: Scenario) -> Iterator[Scenario]:
    """Variants with less of the attack in the adversary's controls."""
    between = AttackInterpolation(case, _adversary(case))
    yield from (between.at(share, "both") for share in _SHARES[1:])
    yield from (between.at(share, "curvature") for share in _SHARES)
    yield from (between.at(share, "accel") for share in _SHARES)


def _is_closer(smaller: Scenario, case: Scenario) -> bool:
    """Whether the adversary deviates less, in the mean up to the crash of each."""
    before, after = (found.mean_m if (found := deviation(one)) else 0.0 for one in (case, smaller))
    return after < min(before - _LESS_M, (1.0 - _LESS) * before)


def _leave_out(case: Scenario, trial: _Trial) -> Scenario:
    """Reduction 3: leave out agents that do not matter, those that stay far from the ego first."""
    tracks = case.tracks
    away = np.hypot(tracks.x - tracks.x[0], tracks.y - tracks.y[0])
    nearest = np.where(tracks.valid, away, np.inf).min(axis=1)
    others = [row for row in np.argsort(-nearest, kind="stable") if case.agents[row].role == "background"]
    return _greedily(case, [case.agents[row].id for row in others], without, trial)


def _shorten(case: Scenario, trial: _Trial, lead_s: float) -> Scenario:
    """Reduction 4: shorten the window to whole seconds, since every length is compiled once."""
    per_s = max(round(1.0 / case.dt), 1)
    step, last = _collision(case).step, case.tracks.steps - 1
    end = min(step + round(_TAIL_S * per_s), last)
    windows = [(end - length, end) for length in range(per_s, end + 1, per_s)]
    windows.append((0, min(-(-end // per_s) * per_s, last)))
    for begin, until in windows:
        if step - begin < min(round(lead_s * per_s), step) or until - begin >= last:
            continue
        found = trial.crash(cut(case, begin, until))
        if found is not None:
            return found
    return case


def _greedily(
    case: Scenario, names: list[str], reduce: Callable[[Scenario, Sequence[str]], Scenario], trial: _Trial
) -> Scenario:
    """The case reduced by as many of `names` as possible: by all at once, else by each half in turn."""
    if not names:
        return case
    found = trial.crash(reduce(case, names))
    if found is not None or len(names) == 1:
        return found or case
    half = len(names) // 2
    return _greedily(_greedily(case, names[:half], reduce, trial), names[half:], reduce, trial)


def _named(attacked: Scenario, planner: str) -> Scenario:
    """The case under the name of a shrunk one, with a note of its origin."""
    record = attacked.attack
    assert record is not None
    if "shrunk_from" in record.settings and record.planner == planner:
        return attacked
    settings = record.settings | {"shrunk_from": attacked.id}
    return replace(
        attacked, id=file_name(attacked.id, "shrunk"), attack=replace(record, planner=planner, settings=settings)
    )


def _collision(attacked: Scenario) -> Collision:
    record = attacked.attack
    if record is None or record.outcome != "collision" or record.collision is None:
        ended = f"its attack ended as {record.outcome}" if record else "it was never attacked"
        raise RegentsError(
            f"case {attacked.id} holds no collision to shrink: {ended} "
            "(expected a case of `regents attack` that crashes)"
        )
    return record.collision


def _adversary(case: Scenario) -> int:
    hit = _collision(case).agent
    return next(row for row, agent in enumerate(case.agents) if agent.id == hit)


def _flaws(case: Scenario) -> frozenset[Flaw]:
    found = flaws(case)
    assert found is not None
    return frozenset(found) - {Flaw.UNATTRIBUTED}


def _said(case: Scenario) -> _TellingParts:
    judged = judge(case).judgement
    broken = {offence.name for offence in judged.law.adversary} if judged and judged.law else ()
    return _TellingParts(frozenset(broken), frozenset(judged.preventable_by if judged else ()))


def cut(scenario: Scenario, begin: int, end: int) -> Scenario:
    """The steps from `begin` to `end`, both included, without agents that are absent throughout.

    The judgement of the whole case is dropped. The log of an attacked case is cut in the same way.
    """
    there = scenario.tracks.valid[:, begin : end + 1].any(axis=1)
    shorter = replace(
        scenario,
        tracks=_cut(scenario.tracks, begin, end),
        log=scenario.log and _cut(scenario.log, begin, end),
        signals=tuple(_cut_signal(signal, begin, end) for signal in scenario.signals),
        overlaps=tuple(
            Overlap(pair.agents, max(pair.first_step - begin, 0), min(pair.last_step, end) - begin)
            for pair in scenario.overlaps
            if pair.first_step <= end and pair.last_step >= begin
        ),
        provenance=replace(scenario.provenance, begin_s=round(scenario.provenance.begin_s + begin * scenario.dt, 9)),
        judgement=None,
        evasion=None,
    )
    return shorter.keeping(np.asarray(there))


def without(scenario: Scenario, names: Collection[str]) -> Scenario:
    """The case without the agents of these ids."""
    return scenario.keeping(np.array([agent.id not in names for agent in scenario.agents]))


def _cut(tracks: Tracks, begin: int, end: int) -> Tracks:
    parts = {name: getattr(tracks, name)[:, begin : end + 1] for name in ("x", "y", "yaw", "speed", "valid", "z")}
    if tracks.accel is None or tracks.curvature is None:
        return Tracks(**parts)
    return Tracks(**parts, accel=tracks.accel[:, begin:end], curvature=tracks.curvature[:, begin:end])


def _cut_signal(signal: Signal, begin: int, end: int) -> Signal:
    later = tuple((step - begin, letters) for step, letters in signal.changes if begin < step <= end)
    return replace(signal, changes=((0, signal.letters(begin)), *later))


def crashes_in(cases: Path) -> list[Scenario]:
    """The case at `cases`, or those of a suite that end in a collision. Raises RegentsError for none."""
    found = load_suite(cases)
    if not _is_case(cases):
        found = [case for case in found if case.attack and case.attack.outcome == "collision"]
    if not found:
        raise RegentsError(f"{cases} holds no case that ends in a collision (make some with `regents attack`)")
    return found


def shrink_each(
    crashes: Sequence[Scenario], planner: str | None, *, lead_s: float, act_timeout_s: float = ACT_TIMEOUT_S
) -> Iterator[ShrunkCase]:
    """Shrink each crash with `planner`, or with the planner that was attacked. Unknown planners are reported first."""
    names = [planner_of(case, planner) for case in crashes]
    planners = {name: PlannerUnderTest.of(name) for name in names}
    return (
        shrink(case, planners[name], lead_s=lead_s, act_timeout_s=act_timeout_s, progress=False)
        for case, name in zip(crashes, names, strict=True)
    )


def writer_beside(cases: Path, output: Path | None) -> SuiteWriter:
    """A writer to `output`, or to the suite of the original cases. Raises RegentsError for a case outside a suite."""
    folder = output or (cases.resolve().parent if _is_case(cases) else cases)
    known = (folder / "suite.json").is_file()
    if output is None and not known:
        raise RegentsError(f"{cases} lies in no suite (expected a folder for the shrunk case: name one with -o)")
    return SuiteWriter(folder, load_manifest(folder).seed if known else 0)


def _is_case(folder: Path) -> bool:
    return (folder / "scenario.json").is_file()
