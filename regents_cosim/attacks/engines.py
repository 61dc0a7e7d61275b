"""Distribute the scenarios of an attack over threads, over processes of planners, or into one program."""

import itertools
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.descent.batched_search import search_batched
from regents_cosim.attacks.descent.pursuit import RunClosedLoops, in_compiled_loop, on_pool, pursue
from regents_cosim.attacks.descent.search import LOOKED_AT, descend, look_at
from regents_cosim.attacks.descent.search_state import SearchResult, StartLooks
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.moves import Asked, Descend, LookAt, MakeMoves, Move
from regents_cosim.attacks.planner_drives import PlannerDrives
from regents_cosim.attacks.sampling.ego_as_driven import EgoAsDriven
from regents_cosim.attacks.searches import search_together
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.planners.hosting.host_pool import HostPool
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.system.workers import cores


def search_one(setup: AttackSetup, scenario: Scenario) -> list[Scenario]:
    """Attack one scenario with a planner in JAX; gives one result, or one for every distinct adversary."""
    assert setup.planner is not None
    if setup.config.traffic.replan_every > 1:
        return _driven_now_and_then(setup, [scenario], in_compiled_loop(setup.planner, setup.planner_name))[0]
    return search_together(setup, [scenario], by_program(setup))[0]


def on_hosts(
    scenarios: Iterable[Scenario], setup: AttackSetup, batch: int, hosts: HostPool
) -> Iterator[list[Scenario]]:
    """Attack with planners outside the mirror: batches in one process, or one process per core."""
    together = side_by_side(hosts)
    workers = 1 if together else cores()
    rest = iter(scenarios)
    # Searches wait for drives, and drives for nothing: so the planner has as many copies as there are drivers.
    with ThreadPoolExecutor(workers) as drivers, ThreadPoolExecutor(workers) as pool:
        drives = on_pool(hosts, drivers, together)
        waiting: deque[Future[list[list[Scenario]]]] = deque()
        while some := list(itertools.islice(rest, batch if together else 1)):
            waiting.append(pool.submit(_driven_now_and_then, setup, some, drives))
            if len(waiting) >= batch:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()


def side_by_side(hosts: HostPool) -> bool:
    """Whether a planner decides for several scenarios at once."""
    with hosts.lend() as host:
        try:
            return host.batches()
        except DriveError:
            return False  # each case will report the error


def _driven_now_and_then(setup: AttackSetup, some: list[Scenario], run: RunClosedLoops) -> list[list[Scenario]]:
    drives = PlannerDrives(run, setup.config.traffic.drives)
    return search_together(setup, some, by_closed_loops(setup, drives), drives)


def in_batches(scenarios: Iterable[Scenario], setup: AttackSetup, batch: int) -> Iterator[list[Scenario]]:
    """Attack `batch` scenarios at a time in one program."""
    rest = iter(scenarios)
    with ThreadPoolExecutor(cores()) as pool:
        while some := list(itertools.islice(rest, batch)):
            yield from search_together(setup, some, _by_batches(setup, batch), pool=pool)


# --- who makes the moves of a search -------------------------------------------------------------


def by_program(setup: AttackSetup) -> MakeMoves:
    """Make one move after the other, with a planner in JAX that drives in every roll-out."""
    return lambda asked: [_made(setup, job, move) for _, job, move in asked]


def _made(setup: AttackSetup, job: SearchJob, move: Move) -> SearchEnd:
    planner, config, extra_cost = setup.planner, setup.config, setup.extra_cost
    assert planner is not None
    if isinstance(move, Descend):
        return SearchEnd(descend(job._replace(start=move.start), planner, config, move.updates, extra_cost))
    found, tried = look_at(job, planner, move.drives, move.number, config, extra_cost)
    return SearchEnd(found, tried=tried)


def by_closed_loops(setup: AttackSetup, drives: PlannerDrives) -> MakeMoves:
    """Make moves side by side, with a planner that drives every few iterations, and the most promising samples."""
    every = setup.config.traffic.replan_every

    def descents(jobs: list[tuple[Scenario, SearchJob]], updates: int) -> list[SearchEnd]:
        return pursue(jobs, setup.config, every, drives, updates, setup.extra_cost)

    def make(asked: Sequence[Asked]) -> list[SearchEnd]:
        shares = drives.shares([scenario for scenario, _, _ in asked])
        within = [(one, job, _within(move, every * (shares[one] - 1))) for one, job, move in asked]
        return _by_kind(within, partial(look_by_rank, setup, drives, shares), descents)

    return make


def _within(move: Move, updates: int) -> Move:
    """A move with at most so many updates."""
    return move._replace(updates=min(move.updates, updates)) if isinstance(move, Descend) else move


def _by_batches(setup: AttackSetup, batch: int) -> MakeMoves:
    """Make descents of at most `batch` candidates at a time in one program, and looks one after the other."""
    planner, alone = setup.planner, by_program(setup)
    assert planner is not None

    def descents(jobs: list[tuple[Scenario, SearchJob]], updates: int) -> list[SearchEnd]:
        if len(jobs) == 1 and not updates:  # a mere look, as before each search, needs no batch
            return alone([(scenario, job, Descend(job.start)) for scenario, job in jobs])
        found = search_batched((job for _, job in jobs), planner, setup.config, batch, updates, setup.extra_cost)
        return [SearchEnd(one) for one in found]

    return lambda asked: _by_kind(asked, alone, descents)


def _by_kind(
    asked: Sequence[Asked],
    looks: MakeMoves,
    descents: Callable[[list[tuple[Scenario, SearchJob]], int], list[SearchEnd]],
) -> list[SearchEnd]:
    """Make all looks at several drives together, then all descents of as many updates."""
    kinds: dict[int | None, list[int]] = {None: []}
    for index, (_, _, move) in enumerate(asked):
        kinds.setdefault(move.updates if isinstance(move, Descend) else None, []).append(index)
    ended: dict[int, SearchEnd] = {}
    for updates, some in kinds.items():
        mine = [asked[index] for index in some]
        if updates is None:
            found = looks(mine)
        else:
            found = descents([(scenario, job._replace(start=move[0])) for scenario, job, move in mine], updates)
        ended.update(zip(some, found, strict=True))
    return [ended[index] for index in range(len(asked))]


# Looks at many drives for a planner that is dear to ask: a stand-in for it ranks them, and it drives the best itself.
# The stand-in is the ego as the planner drove near these states before (`sampling.ego_as_driven`), in the compiled
# mirror. What it says of a drive is an estimate of the cost alone: only a drive of the planner is accepted, and the
# planner's own costs take the place of the estimates.
_MOST_DRIVEN = 3  # drives of which the stand-in expects an accepted crash; without any it may be the best one,
_NEARER = 0.25  # if that is nearer than all that the planner has made, by this share of its distance


def look_by_rank(
    setup: AttackSetup, drives: PlannerDrives, shares: Mapping[Scenario, int], asked: Sequence[Asked]
) -> list[SearchEnd]:
    """What looks at several drives led to; the planner makes at most as many drives as the share of their scenario."""
    looks = [(scenario, job, move) for scenario, job, move in asked if isinstance(move, LookAt)]
    ranked = [_ranked(setup, drives, *one) for one in looks]
    chosen = [
        one.best[: min(shares[scenario], _MOST_DRIVEN)] for one, (scenario, _, _) in zip(ranked, looks, strict=True)
    ]
    jobs = [
        (scenario, job._replace(start=_row(move.drives, index)))
        for (scenario, job, move), mine in zip(looks, chosen, strict=True)
        for index in mine.tolist()
    ]
    driven = iter(pursue(jobs, setup.config, 1, drives, 0, setup.extra_cost))
    return [one.after(mine, [next(driven) for _ in mine]) for one, mine in zip(ranked, chosen, strict=True)]


@dataclass(frozen=True, eq=False)
class RankedDrives:
    """What the stand-in says of some drives."""

    cost: Float[np.ndarray, " drive"]
    terms: Float[np.ndarray, "drive term"]
    expected: Bool[np.ndarray, " drive"]  # to be accepted
    least: float  # cost of the best drive before
    last: SearchResult | None = None  # of the last drive

    @property
    def best(self) -> Int[np.ndarray, " chosen"]:
        """The drives that are expected to be accepted, the cheapest first, or else the cheapest one if it is nearer."""
        order = np.lexsort((self.cost, ~self.expected))
        nearer = self.cost[order[0]] < self.least - _NEARER * self.terms[order[0], 0]
        return order[: int(self.expected.sum()) or int(nearer)]

    def after(self, chosen: Int[np.ndarray, " chosen"], driven: Sequence[SearchEnd]) -> SearchEnd:
        """The look, with what the planner's own drives of the `chosen` ones show."""
        cost, terms, accepted = self.cost.copy(), self.terms.copy(), np.zeros(LOOKED_AT, bool)
        if not driven:
            assert self.last is not None
            return SearchEnd(self.last, tried=_looks(cost, terms, accepted), estimated=True)
        seconds = [second for one in driven for second in one.seconds]
        for index, one in zip(chosen.tolist(), driven, strict=True):
            if one.failed or one.tried is None:
                return SearchEnd(one.found, seconds)
            cost[index], terms[index] = np.asarray(one.tried.cost)[0], np.asarray(one.tried.terms)[0]
            accepted[index] = one.accepted
        told = min(zip(chosen.tolist(), driven, strict=True), key=lambda pair: (not pair[1].accepted, cost[pair[0]]))
        accepted[[index for index in chosen.tolist() if index != told[0]]] = False
        return SearchEnd(told[1].found, seconds, tried=_looks(cost, terms, accepted))


def _ranked(
    setup: AttackSetup, drives: PlannerDrives, scenario: Scenario, job: SearchJob, move: LookAt
) -> RankedDrives:
    """What the stand-in says of each drive of a look; a single one is not ranked."""
    cost, terms, expected = np.full(LOOKED_AT, np.inf), np.zeros((LOOKED_AT, 3)), np.zeros(LOOKED_AT, bool)
    if move.number == 1:
        return RankedDrives(np.zeros(LOOKED_AT), terms, expected, np.inf)
    job = job._replace(memory=drives.near(scenario, job))
    first, last = 0, None
    while first < move.number:  # a look ends with a drive that is accepted
        left = _from(move.drives, first)
        last, seen = look_at(job, EgoAsDriven(), left, move.number - first, setup.config, setup.extra_cost)
        made = seen.made(move.number - first)
        rows = slice(first, first + made)
        cost[rows], terms[rows] = np.asarray(seen.cost)[:made], np.asarray(seen.terms)[:made]
        expected[rows] = np.asarray(seen.accepted)[:made]
        first += made
    return RankedDrives(cost, terms, expected, move.least, last)


def _looks(
    cost: Float[np.ndarray, " drive"], terms: Float[np.ndarray, "drive term"], accepted: Bool[np.ndarray, " drive"]
) -> StartLooks:
    return StartLooks(on_device(cost, np.float32), on_device(terms, np.float32), on_device(accepted, np.bool_))


def _from(drives: ControlArrays, first: int) -> ControlArrays:
    """The drives in turn, from a later one on."""
    return jax.tree.map(lambda values: on_device(np.roll(np.asarray(values), -first, axis=0), np.float32), drives)


def _row(drives: ControlArrays, index: int) -> ControlArrays:
    return jax.tree.map(lambda values: on_device(np.asarray(values)[index], np.float32), drives)
