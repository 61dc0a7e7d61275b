"""Turn the results of the searches on a scenario into attacked cases."""

from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np

from regents_cosim.attacks.descent.search_state import SearchResult
from regents_cosim.attacks.job import Candidate, SearchEnd, SearchJob
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.checks.names import distinct_word, file_name, word
from regents_cosim.errors import DriveError
from regents_cosim.mirror.world import to_tracks
from regents_cosim.planners.jax_planner import require_finite
from regents_cosim.scenario.attack_record import ActTime, AttackRecord, Collision, Outcome
from regents_cosim.scenario.collisions import collision_at, first_contact
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario, Tracks

_LABEL = 40  # most characters of a planner or an adversary in the id of a case
_COST_TERMS = ("ego", "pair", "road")


def cases_of(
    setup: AttackSetup,
    scenario: Scenario,
    candidates: Sequence[Candidate],
    ended: list[SearchEnd | None],
    drives: int = 0,
) -> list[Scenario]:
    """The results of the searches on a scenario, as cases; the planner made so many `drives` for them."""
    made = [(candidate.job, one) for candidate, one in zip(candidates, ended, strict=True) if one]
    failures = [failure for _, one in made if (failure := failure_of(setup.planner_name, scenario.id, one))]
    joint = len(candidates) == 1
    cases = [failed_case(setup, scenario, failures[0])] if failures else _distinct(setup, scenario, made, joint)
    time = _act_time([second for _, one in made for second in one.seconds])
    made_of_them = sum(
        one.looks + one.earlier + int(one.found.iterations) for _, one in made if isinstance(one.found, SearchResult)
    )
    kinds = frozenset[str]().union(*(candidate.kinds for candidate in candidates))
    promised = tuple(sorted(kinds)) if setup.chooses_drives else None
    return [
        replace(
            case, attack=replace(case.attack, act_time=time, rollouts=made_of_them, drives=drives, promised=promised)
        )
        for case in cases
        if case.attack
    ]


def _distinct(
    setup: AttackSetup, scenario: Scenario, made: list[tuple[SearchJob, SearchEnd]], joint: bool
) -> list[Scenario]:
    """One case for every adversary, the best and accepted ones first, or a single case without a collision.

    Where one adversary is enough, the best alone.
    """
    attacked = [attacked_case(setup, scenario, job, one) for job, one in made]
    by_adversary: dict[str, Scenario] = {}
    for case, _ in sorted(
        zip(attacked, made, strict=True), key=lambda pair: (pair[1][1].accepted, pair[1][1].merit), reverse=True
    ):
        record = case.attack
        if joint or record is None or record.outcome == "already_colliding":
            return [case]
        by_adversary.setdefault(record.collision.agent if record.collision else "", case)
    missed = by_adversary.pop("", scenario)
    if missed.attack:
        records = [case.attack for case in attacked if case.attack]
        tried = tuple(sorted(name for record in records for name in record.candidates))
        spoilt = any(record.spoilt for record in records)
        missed = replace(missed, attack=replace(missed.attack, candidates=tried, spoilt=spoilt))
    hits = [_named_after_adversary(hit) for hit in by_adversary.values()]
    return hits[: 1 if setup.config.candidates.adversaries == "one" else None] or [missed]


def attacked_case(setup: AttackSetup, scenario: Scenario, job: SearchJob, ended: SearchEnd) -> Scenario:
    """The result of a descent, as a case."""
    found = ended.found
    assert isinstance(found, SearchResult)
    outcome = outcome_of(found)
    # A search that met only flawed collisions shows nothing: the traffic stays as it was.
    as_it_was = outcome == "diverged" or (found.hit and not found.accepted)
    tracks = scenario.tracks if as_it_was else to_tracks(found.motion, found.controls, scenario)
    collision = _collision(scenario, tracks, found) if found.accepted and outcome != "diverged" else None
    struck = collision.agent if collision and outcome == "collision" else None
    agents = tuple(replace(a, role="adversary") if a.id == struck else a for a in scenario.agents)
    record = replace(
        _record(setup, scenario, outcome),
        iterations=ended.earlier + int(found.iterations),
        collision=collision,
        spoilt=bool(found.hit) and not found.accepted,
        candidates=tuple(scenario.agents[index].id for index in np.flatnonzero(job.searched.candidate)),
        cost_history=dict(zip(_COST_TERMS, _history(found), strict=True)),
    )
    return replace(
        scenario, id=_name(setup, scenario), agents=agents, tracks=tracks, attack=record, log=scenario.tracks
    )


def failed_case(setup: AttackSetup, scenario: Scenario, failure: DriveError) -> Scenario:
    """The case of a planner that failed: the traffic as recorded, and the planner's error."""
    record = replace(_record(setup, scenario, "planner_error"), planner_error=f"{failure}\n{failure.trace}".strip())
    return replace(scenario, id=_name(setup, scenario), attack=record, log=scenario.tracks)


def _record(setup: AttackSetup, scenario: Scenario, outcome: Outcome) -> AttackRecord:
    """The record of an attack before its search."""
    config = setup.config
    settings, slower = config.noted, {agent.kind for agent in scenario.agents[1:]} - VEHICLE_KINDS
    if slower & config.candidates.kinds:  # without any, cases do not depend on that setting
        settings |= {"adversary_kinds": ",".join(config.candidates.adversary_kinds)}
    return AttackRecord(
        case=scenario.id,
        method=config.method,
        planner=setup.planner_name,
        outcome=outcome,
        iterations=0,
        settings=settings,
        dynamics=setup.dynamics(scenario),
    )


def _name(setup: AttackSetup, scenario: Scenario) -> str:
    """The id of an attacked case, with the last part of the planner's name."""
    return file_name(scenario.id, setup.config.method, word(setup.planner_name.rpartition(":")[2], _LABEL))


def _named_after_adversary(attacked: Scenario) -> Scenario:
    """A crash with its adversary's name in its id."""
    adversary = next(agent.id for agent in attacked.agents if agent.role == "adversary")
    return replace(attacked, id=file_name(attacked.id, distinct_word(adversary, _LABEL)))


def outcome_of(found: SearchResult) -> Outcome:
    """The outcome of a search as a word."""
    if not found.finite:
        return "diverged"
    if found.accepted:
        return "collision" if int(found.iterations) > 0 or np.asarray(found.changed).any() else "already_colliding"
    return "no_collision" if found.any_candidate else "no_candidate"


def _collision(scenario: Scenario, tracks: Tracks, found: SearchResult) -> Collision:
    """The first contact, by the exact boxes of the host."""
    contact = first_contact(scenario.agents, tracks)
    if contact is None:
        raise RuntimeError(f"case {scenario.id}: the mirror saw a collision that the exact boxes do not confirm")
    return collision_at(scenario.agents, tracks, contact, scenario.dt, bool(np.asarray(found.changed)[contact[0]]))


def _history(found: SearchResult) -> list[tuple[float, ...]]:
    """The costs before each update, per term, without non-finite values, which JSON cannot hold."""
    rounded = np.asarray(found.history, float)[: int(found.iterations)].round(6)
    rounded = rounded[np.isfinite(rounded).all(axis=1)]
    return [tuple(term.tolist()) for term in rounded.T]


def failure_of(name: str, case: str, ended: SearchEnd) -> DriveError | None:
    """The failure of a planner, if any; one in JAX fails by a non-finite answer, others were checked before."""
    if isinstance(ended.found, DriveError):
        return ended.found
    try:
        require_finite(jax.tree.map(lambda values: np.asarray(values)[0], ended.found.controls), name, case)
    except DriveError as failure:
        return failure
    return None


def _act_time(seconds: list[float]) -> ActTime | None:
    """Median and 99th percentile of the decision times; None for a planner in JAX."""
    if not seconds:
        return None
    median, p99 = (round(1e3 * float(value), 4) for value in np.percentile(seconds, [50, 99]))
    return ActTime(median, p99, len(seconds))
