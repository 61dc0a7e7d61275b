"""Run the searches on one scenario, or on several together, from their candidates to the resulting cases."""

import itertools
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import equinox as eqx
import numpy as np

from regents_cosim.attacks.attacked_cases import attacked_case, cases_of, failed_case, outcome_of
from regents_cosim.attacks.attempts import RunSearches, Searchers, attempt
from regents_cosim.attacks.batched_search import search_batched
from regents_cosim.attacks.candidates import candidates_or_failure
from regents_cosim.attacks.job import SearchEnd, SearchJob
from regents_cosim.attacks.pursuit import RunClosedLoops, pursue
from regents_cosim.attacks.sampled_search import search_by_samples
from regents_cosim.attacks.search import descend
from regents_cosim.attacks.search_state import SearchResult
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.mirror.jax_settings import in_float32
from regents_cosim.mirror.on_device import on_device
from regents_cosim.planners.jax_planner import JaxPlanner, foreign
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.judge import is_telling


def search_one(setup: AttackSetup, scenario: Scenario) -> list[Scenario]:
    """Attack one scenario with a planner in JAX; gives one result, or one for every distinct adversary."""
    assert isinstance(setup.planner, JaxPlanner)
    loop = setup.loop()
    if setup.config.optimiser != "adam":
        return search_together(setup, [scenario], partial(sampled_searches, setup), loop)[0]
    run = pursuits(setup, loop) if setup.config.replan_every > 1 else partial(descents, setup)
    return search_together(setup, [scenario], run, loop)[0]


@in_float32
def search_together(
    setup: AttackSetup,
    scenarios: list[Scenario],
    run: RunSearches,
    drives: RunClosedLoops,
    pool: Executor | None = None,
) -> list[list[Scenario]]:
    """The results of several scenarios whose descents run together; `pool` prepares them.

    Where the planner raises an error in their shared program, each scenario is run alone.
    """
    try:
        with foreign(setup.planner_name, scenarios[0].id):
            return _search(setup, scenarios, run, drives, pool)
    except DriveError as failure:
        if len(scenarios) == 1:
            return [[failed_case(setup, scenarios[0], failure)]]
    return [search_together(setup, [scenario], run, drives)[0] for scenario in scenarios]


def _search(
    setup: AttackSetup, scenarios: list[Scenario], run: RunSearches, drives: RunClosedLoops, pool: Executor | None
) -> list[list[Scenario]]:
    prepare = partial(candidates_or_failure, setup, drives=drives)
    jobs = list((pool.map if pool else map)(prepare, scenarios))
    made = [one for mine in jobs if not isinstance(mine, DriveError) for one in mine]
    sampling = _sampling(setup)
    config = setup.config if sampling else setup.config.descending()
    searchers = Searchers(_told(setup, run), _told(setup, sampling or run))
    ended = iter(attempt(made, searchers, config))
    return [
        [failed_case(setup, scenario, mine)]
        if isinstance(mine, DriveError)
        else cases_of(setup, scenario, mine, list(itertools.islice(ended, len(mine))))
        for scenario, mine in zip(scenarios, jobs, strict=True)
    ]


def _sampling(setup: AttackSetup) -> RunSearches | None:
    """The function for searches that sample; None where none does."""
    if not setup.samples:
        return None
    return partial(sampled_searches, replace(setup, config=replace(setup.config, optimiser="cma-es")))


def _told(setup: AttackSetup, run: RunSearches) -> RunSearches:
    """The searches, with the verdict of the host where a telling crash or a certain kind of crash is wanted."""
    if setup.config.accept != "telling" and setup.wanted is None:
        return run
    return lambda jobs, most: [
        _if_wanted(setup, *job, one, looked=most == 0) for job, one in zip(jobs, run(jobs, most), strict=True)
    ]


def _if_wanted(setup: AttackSetup, scenario: Scenario, job: SearchJob, ended: SearchEnd, looked: bool) -> SearchEnd:
    """The end of a search, accepted only if its crash is of a wanted kind and, as far as known, telling.

    The device is stricter than the host, so every crash of a mere look is judged.
    """
    found, telling = ended.found, setup.config.accept == "telling"
    if not isinstance(found, SearchResult) or not (bool(found.hit) if looked and telling else ended.accepted):
        return ended
    if not looked and outcome_of(found) != "collision":
        return ended
    taken, spoilt = (
        replace(ended, found=eqx.tree_at(lambda one: one.accepted, found, on_device(accepted, np.bool_)))
        for accepted in (True, False)
    )
    case = attacked_case(setup, scenario, job, taken)
    if setup.wanted is not None and not setup.wanted.of_crash(case):
        return spoilt
    return spoilt if telling and is_telling(case, lawful=setup.config.law == "strict") is False else taken


def descents(setup: AttackSetup, jobs: Sequence[tuple[Scenario, SearchJob]], iterations: int) -> list[SearchEnd]:
    """Run one descent after the other, with a planner in JAX that drives in every iteration."""
    assert isinstance(setup.planner, JaxPlanner)
    planner = setup.planner
    return [SearchEnd(descend(job, planner, setup.config, iterations, setup.extra_cost)) for _, job in jobs]


def sampled_searches(
    setup: AttackSetup, jobs: Sequence[tuple[Scenario, SearchJob]], iterations: int
) -> list[SearchEnd]:
    """Run searches without gradients."""
    assert isinstance(setup.planner, JaxPlanner)
    return search_by_samples(jobs, setup.planner, setup.config, iterations, setup.extra_cost)


def pursuits(setup: AttackSetup, drives: RunClosedLoops) -> RunSearches:
    """Descents whose planner drives every few iterations."""
    return lambda jobs, most: pursue(jobs, setup.config, setup.config.replan_every, drives, most, setup.extra_cost)


def batched_searches(setup: AttackSetup, batch: int) -> RunSearches:
    """Descents of at most `batch` scenarios at a time in one program."""
    assert isinstance(setup.planner, JaxPlanner)
    planner = setup.planner

    def run(jobs: Sequence[tuple[Scenario, SearchJob]], iterations: int) -> list[SearchEnd]:
        found = search_batched((job for _, job in jobs), planner, setup.config, batch, iterations, setup.extra_cost)
        return [SearchEnd(one) for one in found]

    return run
