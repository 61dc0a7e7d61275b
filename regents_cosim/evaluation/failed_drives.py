"""Cases that a planner fails, and could have passed: its own drive into a collision, and the drive that avoids it."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.errors import DriveError
from regents_cosim.evaluation.judgement import judge
from regents_cosim.evaluation.manoeuvres import BANK, Bank
from regents_cosim.replays.mirror import Wheel
from regents_cosim.scenario import AttackRecord, Scenario, Tracks

# What a planner that sees one instant can learn: to brake once there is something to brake for, firmly rather than
# as early as only who knows the future would. The gentlest of these begins as late as such braking allows, and at
# most 3 s before the crash. (With earlier onsets AIM-BEV learnt to brake at nothing.)
BRAKING = replace(
    BANK, accels=(-6.0, -4.0), lasting_s=(None,), shifts=(), lateral_accels=(), onsets_s=((1.0, 0.1), (3.0, 0.2))
)


def failed_drives(scenarios: Sequence[Scenario], planner: str, bank: Bank = BRAKING) -> Iterator[Scenario | None]:
    """For each case: where `planner` collides in it, the case with that drive, judged by `bank`; else None.

    Everybody else drives as in the case. A case in which the planner itself fails counts as None. Raises
    PlannerError where the planner cannot be found.
    """
    with Wheel(planner) as wheel, ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(partial(_failed, wheel=wheel, planner=planner, bank=bank), scenarios)


def teachable(failed: Sequence[Scenario | None]) -> list[Scenario]:
    """Failures that the planner could have avoided, but for those in which it was run into from behind."""
    return [
        case for case in failed if case is not None and case.evasion is not None and "rear_ends_ego" not in _flaws(case)
    ]


def as_driven(scenario: Scenario, tracks: Tracks, planner: str) -> Scenario | None:
    """The case with `tracks`, in which `planner` drives the ego, and the collision there; None where there is none."""
    contact = first_contact(scenario.agents, tracks)
    if contact is None:
        return None
    original = scenario.tracks if scenario.original is None else scenario.original
    agent = contact[0]
    attacked = any(
        not np.array_equal(getattr(tracks, name)[agent], getattr(original, name)[agent]) for name in ("x", "y", "speed")
    )
    hit = collision_at(scenario.agents, tracks, contact, scenario.dt, attributed=attacked)
    record = scenario.attack or AttackRecord(scenario.id, "none", planner, "collision", 0)
    return replace(
        scenario,
        tracks=tracks,
        attack=replace(record, planner=planner, outcome="collision", collision=hit),
        original=original,
        judgement=None,
        evasion=None,
    )


def _failed(scenario: Scenario, wheel: Wheel, planner: str, bank: Bank) -> Scenario | None:
    try:
        crash = as_driven(scenario, wheel.drive(scenario).tracks, planner)
    except DriveError:
        return None
    return judge(crash, bank) if crash else None


def _flaws(case: Scenario) -> tuple[str, ...]:
    return case.judgement.flaws if case.judgement else ()
