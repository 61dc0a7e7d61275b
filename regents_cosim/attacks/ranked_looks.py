"""Looks at many drives for a planner that is dear to ask: a stand-in for it ranks them, and it drives the best itself.

The stand-in is the ego as the planner drove near these states before (`sampling.ego_as_driven`), in the compiled
mirror. What it says of a drive is an estimate of the cost alone: only a drive of the planner is accepted, and the
planner's own costs take the place of the estimates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attacks.descent.pursuit import pursue
from regents_cosim.attacks.descent.search import LOOKED_AT, look_at
from regents_cosim.attacks.descent.search_state import StartLooks
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.moves import LookAt
from regents_cosim.attacks.planner_drives import PlannerDrives
from regents_cosim.attacks.sampling.ego_as_driven import EgoAsDriven
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.mirror.bicycle import ControlArrays
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.scenario import Scenario

_MOST_DRIVEN = 3  # drives of which the stand-in expects an accepted crash; otherwise the planner makes the best one


def look_by_rank(
    setup: AttackSetup,
    drives: PlannerDrives,
    asked: Sequence[tuple[Scenario, SearchJob, LookAt]],
    shares: Sequence[int],
) -> list[SearchEnd]:
    """What the looks led to; for each the planner makes at most as many drives as its share."""
    ranked = [_ranked(setup, drives, *one) for one in asked]
    chosen = [one.best[: min(share, _MOST_DRIVEN)] for one, share in zip(ranked, shares, strict=True)]
    jobs = [
        (scenario, job._replace(start=_row(move.drives, index)))
        for (scenario, job, move), mine in zip(asked, chosen, strict=True)
        for index in mine.tolist()
    ]
    driven = iter(pursue(jobs, setup.config, 1, drives, 0, setup.extra_cost))
    return [one.after(mine, [next(driven) for _ in mine]) for one, mine in zip(ranked, chosen, strict=True)]


@dataclass(frozen=True, eq=False)
class _Ranked:
    """What the stand-in says of some drives."""

    cost: Float[np.ndarray, " drive"]
    terms: Float[np.ndarray, "drive term"]
    expected: Bool[np.ndarray, " drive"]  # to be accepted

    @property
    def best(self) -> Int[np.ndarray, " chosen"]:
        """The drives that are expected to be accepted, the cheapest first, or else the cheapest one."""
        order = np.lexsort((self.cost, ~self.expected))
        return order[: max(int(self.expected.sum()), 1)]

    def after(self, chosen: Int[np.ndarray, " chosen"], driven: Sequence[SearchEnd]) -> SearchEnd:
        """The look, with what the planner's own drives of the `chosen` ones show."""
        cost, terms, accepted = self.cost.copy(), self.terms.copy(), np.zeros(LOOKED_AT, bool)
        seconds = [second for one in driven for second in one.seconds]
        for index, one in zip(chosen.tolist(), driven, strict=True):
            if one.failed or one.tried is None:
                return SearchEnd(one.found, seconds)
            cost[index], terms[index] = np.asarray(one.tried.cost)[0], np.asarray(one.tried.terms)[0]
            accepted[index] = one.accepted
        told = min(zip(chosen.tolist(), driven, strict=True), key=lambda pair: (not pair[1].accepted, cost[pair[0]]))
        accepted[[index for index in chosen.tolist() if index != told[0]]] = False
        return SearchEnd(told[1].found, seconds, tried=_looks(cost, terms, accepted))


def _ranked(setup: AttackSetup, drives: PlannerDrives, scenario: Scenario, job: SearchJob, move: LookAt) -> _Ranked:
    """What the stand-in says of each drive of a look; a single one is not ranked."""
    found = _Ranked(np.full(LOOKED_AT, np.inf), np.zeros((LOOKED_AT, 3)), np.zeros(LOOKED_AT, bool))
    if move.number == 1:
        return _Ranked(np.zeros(LOOKED_AT), found.terms, found.expected)
    job = job._replace(memory=drives.near(scenario, job))
    first = 0
    while first < move.number:  # a look ends with a drive that is accepted
        left = _from(move.drives, first)
        _, seen = look_at(job, EgoAsDriven(), left, move.number - first, setup.config, setup.extra_cost)
        accepted = np.asarray(seen.accepted)
        made = int(np.argmax(accepted)) + 1 if accepted.any() else move.number - first
        rows = slice(first, first + made)
        found.cost[rows], found.terms[rows] = np.asarray(seen.cost)[:made], np.asarray(seen.terms)[:made]
        found.expected[rows] = accepted[:made]
        first += made
    return found


def _looks(
    cost: Float[np.ndarray, " drive"], terms: Float[np.ndarray, "drive term"], accepted: Bool[np.ndarray, " drive"]
) -> StartLooks:
    return StartLooks(on_device(cost, np.float32), on_device(terms, np.float32), on_device(accepted, np.bool_))


def _from(drives: ControlArrays, first: int) -> ControlArrays:
    """The drives in turn, from a later one on."""
    return jax.tree.map(lambda values: on_device(np.roll(np.asarray(values), -first, axis=0), np.float32), drives)


def _row(drives: ControlArrays, index: int) -> ControlArrays:
    return jax.tree.map(lambda values: on_device(np.asarray(values)[index], np.float32), drives)
