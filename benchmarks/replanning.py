"""`python -m benchmarks replan`: what it changes to let the planner drive in every k-th iteration only."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import preset
from regents_cosim.mirror.world import padded_agents
from regents_cosim.planners.time_limits import ACT_TIMEOUT_S
from regents_cosim.planners.under_test import AnyPlanner, PlannerUnderTest
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress


@dataclass(frozen=True)
class ReplanRow:
    """Attacks with the planner driving every `every` iterations, beside those of the first row."""

    planner: str
    method: str
    every: int
    n: int
    collisions: int
    same_outcome: int  # windows that end as in the first row
    same_adversary: int  # of the windows with a collision in both rows: it is with the same agent
    both_collide: int
    mean_iterations: float
    s_per_scenario: float  # wall clock, all cores, compilation left out
    act_median_ms: float | None  # of a planner outside the mirror
    act_p99_ms: float | None  # the greatest of any case


def replan_rows(
    windows: Sequence[Scenario],
    planner: AnyPlanner,
    every: Sequence[int],
    method: str,
    *,
    act_timeout_s: float = ACT_TIMEOUT_S,
    progress: Progress = SILENT,
) -> list[ReplanRow]:
    """A row for each of `every`, all beside the first; programs are compiled before the clock starts."""
    given, rows, first = PlannerUnderTest.of(planner), list[ReplanRow](), list[Scenario]()
    for one in every:
        config = preset(method, replan_every=one)
        for _ in attack(_one_of_each_shape(windows), config, given, act_timeout_s=act_timeout_s, progress=False):
            pass  # compiles
        begin = perf_counter()
        results = attack(windows, config, given, act_timeout_s=act_timeout_s, progress=False)
        attacked = list(progress.each(results, f"every {one}", len(windows)))
        first = first or attacked
        rows.append(replan_row(one, attacked, first, perf_counter() - begin))
    return rows


def replan_row(every: int, attacked: Sequence[Scenario], first: Sequence[Scenario], seconds: float) -> ReplanRow:
    """A row from the results of the same windows, in the same order; `first` are those of the first row."""
    records, others = _records(attacked), _records(first)
    both = [(mine, theirs) for mine, theirs in zip(records, others, strict=True) if mine.collision and theirs.collision]
    times = [record.act_time for record in records if record.act_time]
    return ReplanRow(
        planner=records[0].planner,
        method=records[0].method,
        every=every,
        n=len(records),
        collisions=sum(record.outcome == "collision" for record in records),
        same_outcome=sum(mine.outcome == theirs.outcome for mine, theirs in zip(records, others, strict=True)),
        same_adversary=sum(_adversary(mine) == _adversary(theirs) for mine, theirs in both),
        both_collide=len(both),
        mean_iterations=round(sum(record.iterations for record in records) / len(records), 1),
        s_per_scenario=round(seconds / len(records), 3),
        act_median_ms=sorted(time.median_ms for time in times)[len(times) // 2] if times else None,
        act_p99_ms=max(time.p99_ms for time in times) if times else None,
    )


def _records(attacked: Sequence[Scenario]) -> list[AttackRecord]:
    return [case.attack for case in attacked if case.attack]


def _adversary(record: AttackRecord) -> str:
    return record.collision.agent if record.collision else ""


def _one_of_each_shape(windows: Sequence[Scenario]) -> list[Scenario]:
    """A scenario for each of the shapes that programs are compiled for."""
    return list({(padded_agents(len(w.agents)), w.tracks.steps): w for w in windows}.values())
