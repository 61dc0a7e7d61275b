"""How many windows have a telling crash to be found at all: by any method, or with ten times the budget."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from regents_cosim.attacks.methods.presets import METHODS, OURS, AttackConfig
from regents_cosim.benchmarks.runs import ComparedMethod, one_run
from regents_cosim.evaluation.crashes.scores import MethodRun, Results, collided_before, is_flawless, is_telling
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.progress import Progress


@dataclass(frozen=True)
class Ceiling:
    """The windows of a planner with a known telling crash; an estimate where not all windows were tried again."""

    planner: str
    places: str
    methods: tuple[str, ...]  # that tried again
    n: int  # windows in which the planner does not collide before the attack
    solved: int  # with a telling crash by some run
    tried: int  # of the others, again
    more: int  # of these, with success
    share: float  # of n: solved, and as large a part of the others as of those that were tried again
    of_ceiling: dict[str, float]  # what each method finds of that share
    flawless: int  # windows of n with a flawless crash by some run, also of those that tried again


def ceiling(
    planner: str,
    places: str,
    runs: Sequence[MethodRun],
    again: Sequence[MethodRun],
    files: Collection[str] | None = None,
) -> Ceiling:
    """The ceiling over the windows from `files`, or over all."""
    runs, again = ([run for run in some if run.planner == planner] for some in (runs, again))
    spoilt = {_window(results) for run in runs for results in run.windows if collided_before(results)}
    every = {
        _window(results) for results in runs[0].windows if files is None or results[0].provenance.file in files
    } - spoilt
    found = {run.method: _with(is_telling, run) & every for run in runs}
    solved = set().union(*found.values())
    tried = {_window(results) for run in again for results in run.windows} & every - solved
    more = set().union(*(_with(is_telling, run) for run in again)) & tried
    rate = len(more) / len(tried) if tried else 0.0
    most = len(solved) + rate * (len(every) - len(solved))
    return Ceiling(
        planner=planner,
        places=places,
        methods=tuple(dict.fromkeys(run.method for run in again)),
        n=len(every),
        solved=len(solved),
        tried=len(tried),
        more=len(more),
        share=most / len(every) if every else 0.0,
        of_ceiling={method: len(mine) / most for method, mine in found.items() if most},
        flawless=len(set().union(*(_with(is_flawless, run) for run in (*runs, *again))) & every),
    )


def unsolved(windows: Sequence[Scenario], runs: Sequence[MethodRun]) -> list[Scenario]:
    """The windows without a telling crash in any run, in which the planner does not collide before the attack."""
    over = set().union(*(_with(is_telling, run) for run in runs))
    over |= {_window(results) for run in runs for results in run.windows if collided_before(results)}
    return [window for window in windows if window.id not in over]


def with_ten_times(config: AttackConfig) -> AttackConfig:
    """A copy of a method with ten times the roll-outs: twice the candidates, five times the starts and the attempts."""
    return config.but(
        nearest=2 * config.candidates.nearest,
        starts=5 * config.tries.starts,
        attempts=5 * config.tries.attempts,
        sampled=5 * config.tries.sampled,
        adversaries="one",
    )


def runs_again(
    places: Sequence[list[Scenario]],
    planner: PlannerUnderTest,
    methods: Sequence[str],
    runs: Sequence[MethodRun],
    most: int | None,
    output: Path | None,
    progress: Progress,
) -> Iterator[MethodRun]:
    """Ten times the budget for the windows of each place in which no run has a telling crash, `most` of each at most.

    One method after the other, each where those before it found nothing.
    """
    for windows in places:
        left, made = unsolved(windows, runs)[:most], []
        for method in methods:
            left = unsolved(left, made)
            if left:
                config = with_ten_times(METHODS[method].by_protocol_of(OURS))
                column = ComparedMethod(f"{method} with ten times the roll-outs", config)
                made.append(one_run(left, planner, column, output, progress))
                yield made[-1]


def _with(which: Callable[[Scenario], bool], run: MethodRun) -> set[str]:
    """The windows with a crash of some kind."""
    return {_window(results) for results in run.windows if any(map(which, results))}


def _window(results: Results) -> str:
    """The id of the window that was attacked."""
    attack = results[0].attack
    return attack.case if attack else results[0].id
