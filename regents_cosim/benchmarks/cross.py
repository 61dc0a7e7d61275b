"""`regents bench cross`: whether adversaries that were found for one planner make others crash."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import preset
from regents_cosim.errors import RegentsError
from regents_cosim.evaluation.drives.driving import DriveResult, drive_each
from regents_cosim.evaluation.statistics import percent, percent_interval
from regents_cosim.planners.find import planner_of
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.scenario.scenario import Scenario, with_rows
from regents_cosim.system.data_frames import Rows
from regents_cosim.system.progress import SILENT, Progress

ALL = "all"  # in the place of a planner: every one of them


@dataclass(frozen=True)
class CrossRow:
    """One planner among the adversaries of another.

    Of windows in which a planner collides without any attack nothing can be learnt about it: they
    are left out for it, and for `all` where one of the planners does. A crash of a planner is any
    collision of its ego. Several adversaries of one window count each.
    """

    adversaries_of: str
    planner: str
    n: int  # adversaries, each of which made the planner crash that it was found for
    crashes: int  # of the planner among them; of `all`: those that make every planner crash
    crash_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    windows: int  # without a collision before the attack
    windows_crashed: int  # in which at least one adversary does
    windows_percent: float
    windows_interval_percent: tuple[float, float]
    planner_errors: int  # drives that failed count as no crash


def among_adversaries(attacked: Scenario) -> Scenario:
    """The traffic after an attack for another planner to drive in: its ego has its recorded track again.

    The track of the ego in an attacked case is what the attacked planner made of it, and says
    where it crashes: no other is to follow it.
    """
    if attacked.log is None:
        return attacked
    is_ego = np.arange(len(attacked.agents)) == 0
    return replace(attacked, tracks=with_rows(attacked.tracks, attacked.log, is_ego), judgement=None, evasion=None)


def planners_of(attacked: Mapping[str, Sequence[Scenario]]) -> tuple[str, ...]:
    """Those that the cases were attacked with, each once. Raises PlannerError for one that is not ours."""
    return tuple(dict.fromkeys(planner_of(case) for cases in attacked.values() for case in cases))


def by_attacked(cases: Iterable[Scenario]) -> dict[str, list[Scenario]]:
    """Cases by the planners that they were attacked with. Raises RegentsError for one that never was."""
    found = dict[str, list[Scenario]]()
    for case in cases:
        if case.attack is None:
            raise RegentsError(f"case {case.id} was never attacked (expected cases of `regents attack`)")
        found.setdefault(case.attack.planner, []).append(case)
    return found


def attacked_for_each(
    windows: Sequence[Scenario],
    planners: Sequence[PlannerUnderTest],
    method: str,
    *,
    act_timeout_s: float = ACT_TIMEOUT_S,
    progress: Progress = SILENT,
) -> dict[str, list[Scenario]]:
    """Attacks on each planner, by its name."""
    found = dict[str, list[Scenario]]()
    for planner in planners:
        results = attack_each(windows, preset(method), planner, act_timeout_s=act_timeout_s)
        doing = f"attacking {planner.name}"
        found[planner.name] = [case for some in progress.each(results, doing, len(windows)) for case in some]
    return found


def cross_rows(
    attacked: Mapping[str, Sequence[Scenario]],
    planners: Sequence[PlannerUnderTest],
    act_timeout_s: float = ACT_TIMEOUT_S,
) -> Rows[CrossRow]:
    """All rows: `attacked` holds the results of attacks by the planner that the adversaries were found for."""
    given = {one.name: one for one in planners}
    originals = {case.attack.case: case for cases in attacked.values() for case in cases if case.attack}
    crashes = {name: [case for case in cases if case.crash] for name, cases in attacked.items()}
    before = [case.before_attack() for case in originals.values()]
    alone = {n: dict(zip(originals, drive_each(before, p, act_timeout_s), strict=True)) for n, p in given.items()}
    rows = Rows[CrossRow]()
    for name, cases in crashes.items():
        among = {n: list(drive_each(map(among_adversaries, cases), p, act_timeout_s)) for n, p in given.items()}
        tried = [case.attack for case in attacked[name] if case.attack]
        windows = {record.case for record in tried if record.outcome != "already_colliding"}
        rows += [_row(name, planner, cases, windows, alone, among) for planner in (*given, ALL)]
    return rows


def _row(
    name: str,
    planner: str,
    cases: list[Scenario],
    windows: set[str],
    alone: Mapping[str, Mapping[str, DriveResult]],
    among: Mapping[str, list[DriveResult]],
) -> CrossRow:
    driven = list(among) if planner == ALL else [planner]
    free = {window for window in windows if all(alone[one][window].hits is None for one in driven)}
    counted = [index for index, case in enumerate(cases) if case.attack and case.attack.case in free]
    crashed = [index for index in counted if all(among[one][index].hits is not None for one in driven)]
    hit_windows = {case.attack.case for index in crashed if (case := cases[index]).attack}
    return CrossRow(
        adversaries_of=name,
        planner=planner,
        n=len(counted),
        crashes=len(crashed),
        crash_percent=percent(len(crashed), len(counted)),
        interval_percent=percent_interval(len(crashed), len(counted)),
        windows=len(free),
        windows_crashed=len(hit_windows),
        windows_percent=percent(len(hit_windows), len(free)),
        windows_interval_percent=percent_interval(len(hit_windows), len(free)),
        planner_errors=sum(bool(among[one][index].error) for one in driven for index in counted),
    )
