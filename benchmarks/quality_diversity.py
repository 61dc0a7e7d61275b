"""Searches for crashes that differ, run on windows to be held against others: attacked, judged, verified, timed."""

from collections.abc import Sequence
from time import perf_counter

from regents_cosim.attacks.methods.presets import OURS, AttackConfig
from regents_cosim.benchmarks.runs import judged_run
from regents_cosim.evaluation.crashes.scores import MethodRun, Results
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.archive.axes import Axes
from regents_cosim.runs.archive.illumination import METHOD, illuminate_each
from regents_cosim.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress


def quality_diversity_run(
    windows: Sequence[Scenario],
    planner: PlannerUnderTest,
    config: AttackConfig,
    axes: Axes,
    rollouts: Sequence[int],
    seed: int,
    progress: Progress = SILENT,
) -> MethodRun:
    """Crashes of every window, one in each cell of the map, by the rules of `config`.

    They are found with at most as many roll-outs as are given for the window.
    """
    begin = perf_counter()
    rules = OURS.by_protocol_of(config)
    searched = illuminate_each(zip(windows, rollouts, strict=True), rules, planner, axes, seed)
    found: list[Results] = list(progress.each(searched, f"{METHOD} against {planner.name}", len(windows)))
    seconds = perf_counter() - begin
    return judged_run(METHOD, planner.name, max(rollouts, default=0), found, seconds, progress)
