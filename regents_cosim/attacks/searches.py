"""Run the searches on one scenario, or on several together, from their candidates to the resulting cases."""

import itertools
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import equinox as eqx
import numpy as np

from regents_cosim.attacks.attacked_cases import attacked_case, cases_of, failed_case, outcome_of
from regents_cosim.attacks.candidates import candidates_or_failure
from regents_cosim.attacks.descent.pursuit import RunClosedLoops
from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.methods.attempts import USUAL
from regents_cosim.attacks.methods.moves import Descend, MakeMoves, Move, search_in_turns
from regents_cosim.attacks.planner_drives import PlannerDrives
from regents_cosim.attacks.sampling.gentler import gentler_drives
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.mirror.programs.jax_settings import in_float32
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.planners.jax_planner import foreign
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.judge import says_enough
from regents_cosim.verdicts.usualness import usualness


@in_float32
def search_together(
    setup: AttackSetup,
    scenarios: list[Scenario],
    make: MakeMoves,
    drives: RunClosedLoops,
    pool: Executor | None = None,
) -> list[list[Scenario]]:
    """The results of several scenarios whose moves are made together; `pool` prepares them.

    Where the planner raises an error in their shared program, each scenario is run alone.
    """
    try:
        with foreign(setup.planner_name, scenarios[0].id):
            return _search(setup, scenarios, make, drives, pool)
    except DriveError as failure:
        if len(scenarios) == 1:
            return [[failed_case(setup, scenarios[0], failure)]]
    return [search_together(setup, [scenario], make, drives)[0] for scenario in scenarios]


def _search(
    setup: AttackSetup, scenarios: list[Scenario], make: MakeMoves, drives: RunClosedLoops, pool: Executor | None
) -> list[list[Scenario]]:
    prepare = partial(candidates_or_failure, setup, drives=drives)
    found = list((pool.map if pool else map)(prepare, scenarios))
    candidates = [one for mine in found if not isinstance(mine, DriveError) for one in mine]
    method = setup.config
    searches = [method.begin(one) for one in candidates]
    counted = drives if isinstance(drives, PlannerDrives) else None
    left = counted.left if counted else None
    one_is_enough = method.candidates.adversaries == "one"
    ended = iter(search_in_turns(candidates, searches, _judged(setup, make), one_is_enough, left))
    made = counted.made if counted else lambda _: 0
    return [
        [failed_case(setup, scenario, mine)]
        if isinstance(mine, DriveError)
        else cases_of(setup, scenario, mine, list(itertools.islice(ended, len(mine))), made(scenario))
        for scenario, mine in zip(scenarios, found, strict=True)
    ]


def _judged(setup: AttackSetup, make: MakeMoves) -> MakeMoves:
    """The moves, with the verdict of the host where it decides which crashes are wanted."""
    acceptance = setup.config.acceptance
    if acceptance.accept != "telling" and not acceptance.at_least_usual and setup.wanted is None:
        return make

    def judged(asked: Sequence[tuple[Scenario, SearchJob, Move]]) -> list[SearchEnd]:
        found = list[SearchEnd]()
        for (scenario, job, move), one in zip(asked, make(asked), strict=True):
            ended = _if_wanted(setup, scenario, job, one, isinstance(move, Descend) and move.every_hit)
            found.append(_if_usual(setup, scenario, job, _gentler(setup, make, scenario, job, ended)))
        return found

    return judged


def _gentler(setup: AttackSetup, make: MakeMoves, scenario: Scenario, job: SearchJob, ended: SearchEnd) -> SearchEnd:
    """The end of a move, or a better one: the same crash by an adversary that drives more gently."""
    found, outside = ended.found, setup.planner is None or setup.config.traffic.replan_every > 1
    if outside or setup.config.acceptance.accept != "telling" or not ended.accepted or ended.merit % 1.0 >= USUAL:
        return ended
    assert isinstance(found, SearchResult)
    look = gentler_drives(attacked_case(setup, scenario, job, ended), job, found)
    if look is None:
        return ended
    (looked,) = make([(scenario, job, look)])
    better = _if_wanted(setup, scenario, job, looked, every_hit=False)
    effort = replace(ended, looks=ended.looks + look.number)
    if not isinstance(better.found, SearchResult) or not better.accepted or better.merit <= ended.merit:
        return effort
    made = eqx.tree_at(lambda one: (one.iterations, one.history), better.found, (found.iterations, found.history))
    return replace(effort, found=made, merit=better.merit)


def _if_wanted(setup: AttackSetup, scenario: Scenario, job: SearchJob, ended: SearchEnd, every_hit: bool) -> SearchEnd:
    """The end of a move, accepted only if its crash is of a wanted kind and, as far as known, telling.

    The device is stricter than the host, so every crash of a mere look is judged.
    """
    found, telling = ended.found, setup.config.acceptance.accept == "telling"
    if not isinstance(found, SearchResult) or not (ended.hit if every_hit and telling else ended.accepted):
        return ended
    if not every_hit and outcome_of(found) != "collision":
        return ended
    taken, spoilt = _with_verdict(ended, True), _with_verdict(ended, False)
    case = attacked_case(setup, scenario, job, taken)
    if setup.wanted is not None and not setup.wanted.of_crash(case):
        return spoilt
    if telling and says_enough(case, setup.config.acceptance.adversary_may) is False:
        return spoilt
    return replace(taken, merit=_merit(setup, case)) if telling else taken


def _if_usual(setup: AttackSetup, scenario: Scenario, job: SearchJob, ended: SearchEnd) -> SearchEnd:
    """The end of a move, accepted only if its adversary drives as usually as asked for, as far as known."""
    least = setup.config.acceptance.at_least_usual
    if not least or not ended.accepted or not isinstance(ended.found, SearchResult):
        return ended
    usual = usualness(attacked_case(setup, scenario, job, ended))
    return ended if usual is None or usual >= least else _with_verdict(ended, False)


def _with_verdict(ended: SearchEnd, accepted: bool) -> SearchEnd:
    """The end of a move whose crash the host accepts, or does not."""
    found = eqx.tree_at(lambda one: one.accepted, ended.found, on_device(accepted, np.bool_))
    return replace(ended, found=found, refused=not accepted)


def _merit(setup: AttackSetup, case: Scenario) -> float:
    """The merit of a telling crash (`SearchEnd.merit`); what is not known counts as good."""
    usual = usualness(case)
    by_mistake = setup.config.acceptance.adversary_may == "mistakes" and says_enough(case, "none") is False
    return (not by_mistake) + (USUAL if usual is None else min(0.01 * usual, 0.999))
