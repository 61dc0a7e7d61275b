"""Searches for crashes that differ: in the speed with which, and the time when, the adversary comes to the ego.

A search may begin with lawful drives that meet the ego, or with the log alone. A change of the actions there has ten
numbers, as in `attacks.sampled_search`. Each candidate has a grid, which keeps the best change of each bin of the two
measures. Those candidates have a turn first that have filled most cells with a crash for their turns so far.
"""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np

from regents_cosim.archive.axes import Axes, Cell
from regents_cosim.archive.crash import crash_of
from regents_cosim.attacks.actions import to_actions
from regents_cosim.attacks.attacked_cases import attacked_case, failed_case
from regents_cosim.attacks.attempts import Candidate
from regents_cosim.attacks.candidates import candidates_or_failure
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.sampled_search import KNOTS
from regents_cosim.attacks.searches import descents
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.benchmarks.elite_grid import Elite, EliteGrid, Gain, Proposal
from regents_cosim.benchmarks.emitters import BATCH, CmaMe, CmaMega, Emitter, RandomEmitter
from regents_cosim.benchmarks.measured_changes import MEASURES, end_with, look_around, try_changes
from regents_cosim.benchmarks.runs import judged_run
from regents_cosim.checks.names import file_name
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.evaluation.crashes.scores import MethodRun, Results
from regents_cosim.mirror.bicycle import Controls
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.verdicts.judge import is_telling

DiverseName = Literal["cma-mega", "cma-me", "qd-random", "cma-mega-log", "cma-me-log", "qd-random-log"]
_FROM_LOG = "-log"  # ends the names of those that begin with the log alone
_BINS = (2.5, 1.0)  # of the measures: m/s, s
_SIZE = 2 * KNOTS


def require_jax(planner: PlannerUnderTest, name: DiverseName) -> None:
    """Raise RegentsError for a planner that does not drive in the compiled loop."""
    if not isinstance(planner.loop, JaxPlanner):
        raise RegentsError(f"{name} needs a planner in JAX, {planner.name!r} is not: leave out --diverse {name}")


def quality_diversity_run(
    windows: Sequence[Scenario],
    planner: PlannerUnderTest,
    name: DiverseName,
    config: AttackConfig,
    axes: Axes,
    rollouts: Sequence[int],
    seed: int,
    progress: Progress = SILENT,
) -> MethodRun:
    """Crashes of every window, one in each cell of the map, by the rules of `config`.

    They are found with at most as many roll-outs as are given for the window.
    """
    require_jax(planner, name)
    rules = replace(config, method=name, optimiser="adam", replan_every=1)
    setup = AttackSetup(rules, planner.loop, planner.name, None)
    begin = perf_counter()
    pairs = progress.each(zip(windows, rollouts, strict=True), f"{name} against {planner.name}", len(windows))
    found: list[Results] = [_window(window, setup, name, axes, most, seed) for window, most in pairs]
    seconds = perf_counter() - begin
    return judged_run(name, planner.name, max(rollouts, default=0), found, seconds, progress)


def _window(
    window: Scenario, setup: AttackSetup, name: DiverseName, axes: Axes, most: int, seed: int
) -> list[Scenario]:
    """The accepted crashes of a window; where there are none, the window as it was."""
    candidates = candidates_or_failure(setup, window, setup.loop())
    if isinstance(candidates, DriveError):
        return [failed_case(setup, window, candidates)]
    unattacked, spent, crashes = _unattacked(setup, candidates[0]), 1, list[Scenario]()
    if unattacked.attack and unattacked.attack.outcome == "no_collision":
        searches = [_Search(one, number, setup, not name.endswith(_FROM_LOG)) for number, one in enumerate(candidates)]
        spent += _explore(searches, name, most - spent, zlib.crc32(f"{window.id} {seed}".encode()))
        crashes = list(_one_of_each_cell(searches, axes))
    return [
        replace(case, attack=replace(case.attack, rollouts=spent)) for case in crashes or [unattacked] if case.attack
    ]


def _unattacked(setup: AttackSetup, candidate: Candidate) -> Scenario:
    """A look at the window as it was recorded: a planner that collides there is not attacked."""
    (seen,) = descents(setup, [(candidate.scenario, candidate.job)], 0)
    return attacked_case(setup, candidate.scenario, candidate.job, seen)


@dataclass(frozen=True, eq=False)
class _Search:
    """Of one candidate."""

    candidate: Candidate
    number: int  # of the candidate
    setup: AttackSetup
    by_drives: bool  # whether it begins with drives as well
    grid: EliteGrid = field(default_factory=EliteGrid)

    @cached_property
    def starts(self) -> Controls:
        """What may be changed: actions [start searched step], those of the log last."""
        job = self.candidate.job
        log = job.searched.rows(to_actions(job.world.controls))
        drives = self.candidate.starts if self.by_drives else ()
        return jax.tree.map(lambda *each: np.stack(each), *drives, log)

    def __len__(self) -> int:
        return len(self.starts.accel)

    @property
    def _given(self) -> tuple[SearchJob, JaxPlanner, AttackConfig]:
        planner = self.setup.planner
        assert isinstance(planner, JaxPlanner)
        return self.candidate.job, planner, self.setup.config.compiled()

    def _of(self, proposal: Proposal) -> tuple[SearchJob, JaxPlanner, AttackConfig]:
        job, planner, config = self._given
        return job._replace(start=self._starting([proposal.start], 0)), planner, config

    def _starting(self, chosen: Sequence[int], at: slice | int = slice(None)) -> Controls:
        return jax.tree.map(lambda values: jnp.asarray(values[np.asarray(chosen)][at], jnp.float32), self.starts)

    def look(self) -> None:
        """Try every start as it is."""
        unchanged = [Proposal(start, np.zeros(_SIZE)) for start in range(len(self))]
        for at in range(0, len(unchanged), BATCH):
            self.try_all(unchanged[at : at + BATCH])

    def try_all(self, proposals: Sequence[Proposal]) -> list[Gain]:
        """What up to a batch of them adds to the grid."""
        padded = [*proposals, *[proposals[-1]] * (BATCH - len(proposals))]
        starts = self._starting([one.start for one in padded])
        changes = np.stack([one.change for one in padded])
        rows, accepted = map(np.asarray, try_changes(*self._given, starts, _device(changes)))
        return [self._add(*one) for one in zip(proposals, rows[: len(proposals)], accepted.tolist(), strict=False)]

    def slopes(self, proposal: Proposal) -> np.ndarray:
        """The gradients there; the proposal itself is added to the grid."""
        rows, accepted, slopes = map(np.asarray, look_around(*self._of(proposal), _device(proposal.change)))
        self._add(proposal, rows, bool(accepted))
        return np.nan_to_num(slopes.astype(float), posinf=0.0, neginf=0.0)

    def _add(self, proposal: Proposal, rows: np.ndarray, accepted: bool) -> Gain:
        if not np.isfinite(rows).all():
            return Gain(False, False, -np.inf, False)
        cell = tuple(int(place) for place in rows[1:] // np.array(_BINS))
        return self.grid.add(cell, Elite(accepted, float(rows[0]), proposal))

    def case(self, at: int, proposal: Proposal) -> Scenario:
        """An elite as a case, called by its place among those of the grid."""
        job, planner, config = self._of(proposal)
        found = end_with(job, planner, config, _device(proposal.change))
        case = attacked_case(self.setup, self.candidate.scenario, job, SearchEnd(found))
        return replace(case, id=file_name(case.id, str(self.number), str(at)))


def _device(changes: np.ndarray) -> jnp.ndarray:
    return jnp.asarray(changes, jnp.float32)


def _explore(searches: Sequence[_Search], name: DiverseName, most: int, seed: int) -> int:
    """Look at all starts, then give the candidates batches while there are roll-outs left; how many were spent."""
    spent = 0
    for search in searches:
        if spent + len(search) <= most:
            search.look()
            spent += len(search)
    emitters = [_emitter(search, name, seed + search.number) for search in searches]
    turns = [0] * len(searches)
    while spent + emitters[0].looks + BATCH <= most:
        at = max(range(len(searches)), key=lambda one: (searches[one].grid.crashes + 1) / (turns[one] + 1))
        proposals = emitters[at].ask()
        emitters[at].tell(proposals, searches[at].try_all(proposals))
        turns[at] += 1
        spent += emitters[at].looks + BATCH
    return spent


def _emitter(search: _Search, name: DiverseName, seed: int) -> Emitter:
    kind = name.removesuffix(_FROM_LOG)
    if kind == "qd-random":
        return RandomEmitter(len(search), _SIZE, seed)
    if kind == "cma-me":
        return CmaMe(search.grid, _SIZE, seed)
    return CmaMega(search.grid, _SIZE, MEASURES, seed, search.slopes)


def _one_of_each_cell(searches: Iterable[_Search], axes: Axes) -> Iterator[Scenario]:
    """Of the crashes that were found in a window the first of each cell, those of the best value before others.

    Where a telling crash is wanted, the verdict on the host has the last word.
    """
    found = [(search, at, one) for search in searches for at, one in enumerate(search.grid.cells.values()) if one.crash]
    filled = set[Cell]()
    for search, at, one in sorted(found, key=lambda entry: -entry[2].value):
        case, config = search.case(at, one.proposal), search.setup.config
        crash = crash_of(case)
        if crash is None or axes.cell(crash) in filled:
            continue
        if config.accept != "telling" or is_telling(case, lawful=config.law == "strict") is not False:
            filled.add(axes.cell(crash))
            yield case
