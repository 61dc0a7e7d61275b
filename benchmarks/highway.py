"""`python -m benchmarks highway`: attacks on highway-env's own traffic, and whether their crashes happen there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from regents_cosim.attacks.attack import attack_each
from regents_cosim.attacks.methods.presets import AttackConfig, preset
from regents_cosim.benchmarks.transfer import transfer_row
from regents_cosim.evaluation.statistics import percent, percent_interval
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.replays.replay import replay_each
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress

IN_HIGHWAY = ("environment", "method", "ego", "n", "successes", "success_percent", "track_same", "actions_same")


@dataclass(frozen=True)
class HighwayRow:
    """Attacks on the traffic of one environment of highway-env, and their transfer back into it."""

    environment: str
    method: str
    ego: str
    n: int  # windows without a collision before the attack
    successes: int
    success_percent: float
    interval_percent: tuple[float, float]  # 95 %, Wilson
    track_same: int  # of the crashes: the same agent at the same step, on tracks
    track_error_mm: float
    actions_same: int  # the same by highway-env's own physics
    actions_error_mm: float
    crashed_flags: int  # of the crashes: highway-env says `crashed` of the same pair


def highway_rows(
    windows: Mapping[str, Sequence[Scenario]],
    planners: Sequence[AnyPlanner],
    methods: Sequence[str],
    progress: Progress = SILENT,
) -> list[HighwayRow]:
    """A row for each planner, method and environment; `windows` are by environment."""
    rows = []
    for planner in map(PlannerUnderTest.of, planners):
        for config in map(preset, methods):
            for environment, found in windows.items():
                results = attack_each(found, config, planner)
                each = progress.each(results, f"{config.method} in {environment}", len(found))
                rows.append(highway_row(environment, config, planner.name, [case for some in each for case in some]))
    return rows


def highway_row(environment: str, config: AttackConfig, ego: str, attacked: Sequence[Scenario]) -> HighwayRow:
    """Scores of an attack on windows of `environment`."""
    judged = [s for s in attacked if s.attack and s.attack.outcome != "already_colliding"]
    crashes = [s for s in judged if s.crash]
    won = len({s.attack.case for s in crashes if s.attack})
    n = len({s.attack.case for s in judged if s.attack})
    track, actions = (
        transfer_row(mode, crashes, list(replay_each(crashes, "highway", mode=mode))) for mode in ("track", "actions")
    )
    return HighwayRow(
        environment=environment,
        method=config.method,
        ego=ego,
        n=n,
        successes=won,
        success_percent=percent(won, n),
        interval_percent=percent_interval(won, n),
        track_same=track.same_crash,
        track_error_mm=track.position_error_mm,
        actions_same=actions.same_crash,
        actions_error_mm=actions.position_error_mm,
        crashed_flags=track.own_list,
    )
