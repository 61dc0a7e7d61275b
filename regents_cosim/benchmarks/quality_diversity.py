"""Searches for crashes that differ: in the speed with which, and the time when, the adversary comes to the ego.

A change of a candidate's actions has ten numbers, as in `attacks.sampled_search`. Each candidate has a grid, which
keeps the best change of each bin of the two measures; changes with a crash that is accepted are better than all others.
"""

import itertools
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Literal

import jax.numpy as jnp
import numpy as np

from regents_cosim.attacks.attacked_cases import attacked_case, failed_case
from regents_cosim.attacks.attempts import Candidate
from regents_cosim.attacks.candidates import candidates_or_failure
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.presets import AttackConfig
from regents_cosim.attacks.sampled_search import KNOTS
from regents_cosim.attacks.searches import descents
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.benchmarks.elite_grid import Change, Changes, EliteGrid, Gain
from regents_cosim.benchmarks.emitters import BATCH, CmaMe, CmaMega, Emitter, RandomEmitter
from regents_cosim.benchmarks.measured_changes import MEASURES, end_with, look_around, try_changes
from regents_cosim.benchmarks.runs import judged_run
from regents_cosim.checks.names import file_name
from regents_cosim.errors import DriveError, RegentsError
from regents_cosim.evaluation.crashes.scores import MethodRun, Results
from regents_cosim.planners.jax_planner import JaxPlanner
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.scenario import Scenario
from regents_cosim.system.progress import SILENT, Progress
from regents_cosim.verdicts.judge import is_telling

EmitterName = Literal["qd-random", "cma-me", "cma-mega"]
_BINS = (2.5, 1.0)  # of the measures: m/s, s
_ACCEPTED = 1e3  # more than any cost
_SIZE = 2 * KNOTS


def require_jax(planner: PlannerUnderTest, name: EmitterName) -> None:
    """Raise RegentsError for a planner that does not drive in the compiled loop."""
    if not isinstance(planner.loop, JaxPlanner):
        raise RegentsError(f"{name} needs a planner in JAX, {planner.name!r} is not: leave out --diverse {name}")


def quality_diversity_run(
    windows: Sequence[Scenario],
    planner: PlannerUnderTest,
    name: EmitterName,
    config: AttackConfig,
    rollouts: Sequence[int],
    seed: int,
    progress: Progress = SILENT,
) -> MethodRun:
    """Crashes of every window, found with at most as many roll-outs as are given for it, by the rules of `config`."""
    require_jax(planner, name)
    rules = replace(config, method=name, optimiser="adam", replan_every=1)
    setup = AttackSetup(rules, planner.loop, planner.name, None)
    begin = perf_counter()
    pairs = progress.each(zip(windows, rollouts, strict=True), f"{name} against {planner.name}", len(windows))
    found: list[Results] = [_window(window, setup, name, most, seed) for window, most in pairs]
    return judged_run(name, planner.name, max(rollouts, default=0), found, perf_counter() - begin, progress)


def _window(window: Scenario, setup: AttackSetup, name: EmitterName, most: int, seed: int) -> list[Scenario]:
    """The accepted crashes of a window; where there are none, the window as it was."""
    candidates = candidates_or_failure(setup, window, setup.loop())
    if isinstance(candidates, DriveError):
        return [failed_case(setup, window, candidates)]
    unattacked, spent, crashes = _unattacked(setup, candidates[0]), 1, list[Scenario]()
    if unattacked.attack and unattacked.attack.outcome == "no_collision":
        searches = [_Search(one, number, setup) for number, one in enumerate(candidates)]
        spent += _explore(searches, name, most - spent, zlib.crc32(f"{window.id} {seed}".encode()))
        crashes = [crash for search in searches for crash in search.crashes()]
    return [
        replace(case, attack=replace(case.attack, rollouts=spent)) for case in crashes or [unattacked] if case.attack
    ]


def _unattacked(setup: AttackSetup, candidate: Candidate) -> Scenario:
    """A look at the window as it was recorded: a planner that collides there is not attacked."""
    (seen,) = descents(setup, [(candidate.scenario, candidate.job)], 0)
    return attacked_case(setup, candidate.scenario, candidate.job, seen)


@dataclass(frozen=True, eq=False)
class _Search:
    """Of one candidate, from the drive that promises most, or from its log."""

    candidate: Candidate
    number: int  # of the candidate
    setup: AttackSetup
    grid: EliteGrid = field(default_factory=EliteGrid)

    @property
    def _given(self) -> tuple[SearchJob, JaxPlanner, AttackConfig]:
        planner, starts = self.setup.planner, self.candidate.starts
        assert isinstance(planner, JaxPlanner)
        job = self.candidate.job._replace(start=starts[0]) if starts else self.candidate.job
        return job, planner, self.setup.config.compiled()

    def try_all(self, changes: Changes) -> list[Gain]:
        """What changes add to the grid."""
        rows, accepted = map(np.asarray, try_changes(*self._given, _device(changes)))
        return [self._add(*one) for one in zip(changes, rows, accepted.tolist(), strict=True)]

    def slopes(self, change: Change) -> np.ndarray:
        """The gradients there; the change itself is added to the grid."""
        rows, accepted, slopes = map(np.asarray, look_around(*self._given, _device(change)))
        self._add(change, rows, bool(accepted))
        return np.nan_to_num(slopes.astype(float), posinf=0.0, neginf=0.0)

    def crashes(self) -> Iterator[Scenario]:
        """Those of the grid, as cases; where a telling crash is wanted, the verdict on the host has the last word."""
        config = self.setup.config
        for at, (value, change) in enumerate(self.grid.cells.values()):
            case = self._case(change, at) if value > 0.5 * _ACCEPTED else None
            if case is None or case.attack is None or case.attack.outcome != "collision":
                continue
            if config.accept != "telling" or is_telling(case, lawful=config.law == "strict") is not False:
                yield case

    def _add(self, change: Change, rows: np.ndarray, accepted: bool) -> Gain:
        if not np.isfinite(rows).all():
            return Gain(False, -np.inf)
        cell = tuple(int(place) for place in rows[1:] // np.array(_BINS))
        return self.grid.add(cell, float(rows[0]) + _ACCEPTED * accepted, change)

    def _case(self, change: Change, at: int) -> Scenario:
        job, planner, config = self._given
        found = end_with(job, planner, config, _device(change))
        case = attacked_case(self.setup, self.candidate.scenario, job, SearchEnd(found))
        return replace(case, id=file_name(case.id, str(self.number), str(at)))


def _device(changes: np.ndarray) -> jnp.ndarray:
    return jnp.asarray(changes, jnp.float32)


def _explore(searches: Sequence[_Search], name: EmitterName, most: int, seed: int) -> int:
    """Give the candidates a batch each in turn while there are roll-outs left; how many were spent."""
    emitters = [_emitter(search, name, seed + search.number) for search in searches]
    spent = 0
    for search, emitter in itertools.cycle(zip(searches, emitters, strict=True)):
        if spent + emitter.looks + BATCH > most:
            break
        changes = emitter.ask()
        emitter.tell(changes, search.try_all(changes))
        spent += emitter.looks + BATCH
    return spent


def _emitter(search: _Search, name: EmitterName, seed: int) -> Emitter:
    if name == "qd-random":
        return RandomEmitter(_SIZE, seed)
    if name == "cma-me":
        return CmaMe(search.grid, _SIZE, seed)
    return CmaMega(search.grid, _SIZE, MEASURES, seed, search.slopes)
