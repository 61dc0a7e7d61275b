"""Searches that continue after the first crash of a window and give one crash per cell of a map of behaviours.

Each candidate has its own search (`attacks.sampling`). All starts are tried first. Then the next turn always goes to
the candidate whose grid has gained the most bins with a crash per turn.
"""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from regents_cosim.attacks.attacked_cases import cases_of, failed_case, named_after_adversary
from regents_cosim.attacks.candidates import candidates_or_failure
from regents_cosim.attacks.engines import by_program, in_threads
from regents_cosim.attacks.job import Candidate
from regents_cosim.attacks.methods.moves import Descend
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.attacks.sampling.candidate_search import SIZE, CandidateSearch
from regents_cosim.attacks.sampling.emitters import BATCH, CmaMe
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.checks.names import file_name
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.planners.jax_planner import foreign
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.runs.archive.axes import Axes, Cell
from regents_cosim.runs.archive.crash import Crash, crash_of
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.judge import says_enough

METHOD = "cma-me"  # 20.2 cells, focused 7.8: means of 4 held-out seeds of 6 windows, as many roll-outs
ROLLOUTS = 2000  # roll-outs per window by default


def obstacle(config: AttackConfig, planner: PlannerUnderTest) -> str:
    """The reason why searches with `config` cannot continue after a crash; empty where they can."""
    if planner.loop is None:
        return f"planner {planner.name!r} is not in JAX"
    if config.candidates.search == "joint":
        return f"{config.method} searches for all candidates at once"
    if not config.descends:
        return f"{config.method} ends at its first crash"
    if config.traffic.replan_every > 1 or config.steps.gradient != "adversary":
        return "`replan_every` or `gradient` is set"
    return ""


def require_possible(config: AttackConfig, planner: PlannerUnderTest) -> None:
    """Raise RegentsError where searches cannot continue after a crash."""
    if why := obstacle(config, planner):
        raise RegentsError(
            f"searches that go on after a crash are for planners in JAX, by the rules of focused: here {why}"
        )


def illuminate_each(
    windows: Iterable[tuple[Scenario, int]],
    config: AttackConfig,
    planner: PlannerUnderTest,
    axes: Axes,
    seed: int = 0,
    batch: int = 32,
) -> Iterator[list[Scenario]]:
    """Attack each window with its number of roll-outs; yields the crashes of each window in order, one per map cell.

    A window without a crash is returned unattacked. `config` decides which crashes are accepted and which road users
    are candidates. At most `batch` windows are in work before the first is handed on. Raises RegentsError where the
    search cannot continue after a crash.
    """
    require_possible(config, planner)
    rules = config.but(method=METHOD, replan_every=1)
    setup = AttackSetup(rules, planner.loop, planner.name, None)
    return in_threads(windows, partial(_illuminated, setup, axes, seed), batch)


@in_float32
def _illuminated(setup: AttackSetup, axes: Axes, seed: int, given: tuple[Scenario, int]) -> list[Scenario]:
    """The crashes found in a window within the given roll-outs, or the unattacked window if none."""
    window, most = given
    try:
        with foreign(setup.planner_name, window.id):
            return _search(setup, axes, window, most, zlib.crc32(f"{window.id} {seed}".encode()))
    except DriveError as failure:
        return [failed_case(setup, window, failure)]


def _search(setup: AttackSetup, axes: Axes, window: Scenario, most: int, seed: int) -> list[Scenario]:
    candidates = candidates_or_failure(setup, window, setup.loop())
    if isinstance(candidates, DriveError):
        raise candidates
    unattacked, spent, crashes = _unattacked(setup, candidates[0]), 1, list[Scenario]()
    if unattacked.attack and unattacked.attack.outcome == "no_collision":
        searches = [CandidateSearch(one, setup) for one in candidates]
        spent += _explore(searches, most - spent, seed)
        crashes = [
            replace(case, id=file_name(case.id, str(number)))
            for number, case in enumerate(_one_of_each_cell(searches, setup.config, axes), start=1)
        ]
    return [
        replace(case, attack=replace(case.attack, rollouts=spent)) for case in crashes or [unattacked] if case.attack
    ]


def _unattacked(setup: AttackSetup, candidate: Candidate) -> Scenario:
    """Run the window as it was recorded: a planner that collides or fails there is not attacked."""
    looked = by_program(setup)([(candidate.scenario, candidate.job, Descend(candidate.job.start))])
    (case,) = cases_of(setup, candidate.scenario, [candidate], list(looked))
    return case


def _explore(searches: Sequence[CandidateSearch], most: int, seed: int) -> int:
    """Try all starts, then give batches to the candidates while roll-outs are left; returns the number spent."""
    spent = 0
    for search in searches:
        if spent + len(search) <= most:
            search.look()
            spent += len(search)
    emitters = [CmaMe(search.grid, SIZE, seed + number) for number, search in enumerate(searches)]
    turns = [0] * len(searches)
    while spent + BATCH <= most:
        at = max(range(len(searches)), key=lambda one: (searches[one].grid.crashes + 1) / (turns[one] + 1))
        proposals = emitters[at].ask()
        emitters[at].tell(proposals, searches[at].try_all(proposals))
        turns[at] += 1
        spent += BATCH
    return spent


@dataclass(frozen=True)
class _Found:
    """A crash of a grid with its values for the map."""

    case: Scenario
    crash: Crash


def _one_of_each_cell(searches: Iterable[CandidateSearch], config: AttackConfig, axes: Axes) -> Iterator[Scenario]:
    """For each cell the crash of the window that deviates least from the log, among the best in quality.

    Where a telling crash is wanted, the verdict on the host has the last word.
    """
    found = [
        _Found(named_after_adversary(case), crash)
        for search in searches
        for one in search.grid.cells.values()
        if one.crash and (crash := crash_of(case := search.case(one.proposal)))
    ]
    filled = set[Cell]()
    for one in sorted(found, key=lambda one: one.crash.order):
        cell = axes.cell(one.crash)
        if cell not in filled and _is_accepted(one.case, config):
            filled.add(cell)
            yield one.case


def _is_accepted(case: Scenario, config: AttackConfig) -> bool:
    return config.acceptance.accept != "telling" or says_enough(case, config.acceptance.adversary_may) is not False
