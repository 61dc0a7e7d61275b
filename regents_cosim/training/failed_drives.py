"""Finds cases that a planner fails and could have passed: its own drive into a collision, and one that avoids it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from regents_cosim.attack_record import AttackRecord
from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.judgement import Flaw
from regents_cosim.mirror.camera import PAPERS
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.escape.manoeuvres import BANK, ManoeuvreBank
from regents_cosim.verdicts.judge import judge

# A planner that sees one instant can learn to brake firmly once there is something to brake for. It cannot learn to
# brake as early as a driver that knows the future. The gentlest of these manoeuvres begins as late as such braking
# allows, and at most 3 s before the crash. (With earlier onsets AIM-BEV learnt to brake at nothing.)
BRAKING = replace(
    BANK, accels=(-6.0, -4.0), lasting_s=(None,), shifts=(), lateral_accels=(), onsets_s=((1.0, 0.1), (3.0, 0.2))
)


def failed_drives(
    scenarios: Iterable[Scenario],
    drives: Iterable[Tracks],
    planner: str,
    view_m: float = PAPERS.view_m,
) -> Iterator[Scenario | None]:
    """Put each drive of `planner` into its case, and judge it by `BRAKING`; a drive without a collision gives None.

    A manoeuvre counts only if it begins while the other road user is in the ego's view, which reaches
    `view_m` to each side: before that there is nothing to brake for. All others drive as in the case.
    """
    for scenario, tracks in zip(scenarios, drives, strict=True):
        crash = as_driven(scenario, tracks, planner)
        yield judge(crash, _in_view(BRAKING, crash, view_m)) if crash else None


def teachable(failed: Sequence[Scenario | None]) -> list[Scenario]:
    """The failures that the planner could have avoided, without those in which another hit it from behind."""
    return [
        case for case in failed if case is not None and case.evasion is not None and not _BEHIND & set(_flaws(case))
    ]


_BEHIND: frozenset[Flaw] = frozenset({Flaw.REAR_ENDS_EGO, Flaw.FROM_BEHIND})


def as_driven(scenario: Scenario, tracks: Tracks, planner: str) -> Scenario | None:
    """The case with `tracks`, in which `planner` drives the ego, and its collision; None without a collision."""
    contact = first_contact(scenario.agents, tracks)
    if contact is None:
        return None
    log = scenario.recorded_tracks
    agent = contact[0]
    attacked = any(
        not np.array_equal(getattr(tracks, name)[agent], getattr(log, name)[agent]) for name in ("x", "y", "speed")
    )
    hit = collision_at(scenario.agents, tracks, contact, scenario.dt, attributed=attacked)
    record = scenario.attack or AttackRecord(scenario.id, "none", planner, "collision", 0)
    return replace(
        scenario,
        tracks=tracks,
        attack=replace(record, planner=planner, outcome="collision", collision=hit),
        log=log,
        judgement=None,
        evasion=None,
    )


def _in_view(bank: ManoeuvreBank, crash: Scenario, view_m: float) -> ManoeuvreBank:
    """The manoeuvres of `bank` that begin once the other road user is in the ego's view and stays there."""
    seen_s = _seen_s(crash, view_m)
    return replace(bank, onsets_s=tuple((min(until_s, seen_s), spacing_s) for until_s, spacing_s in bank.onsets_s))


def _seen_s(crash: Scenario, view_m: float) -> float:
    """The time before the collision during which the ego's view always has the centre of the other road user [s]."""
    hit = crash.attack.collision if crash.attack else None
    if hit is None:
        return 0.0
    tracks, other, until = crash.tracks, [agent.id for agent in crash.agents].index(hit.agent), hit.step + 1
    dx, dy = tracks.x[other, :until] - tracks.x[0, :until], tracks.y[other, :until] - tracks.y[0, :until]
    cos, sin = np.cos(tracks.yaw[0, :until]), np.sin(tracks.yaw[0, :until])
    hidden = np.maximum(np.abs(dx * cos + dy * sin), np.abs(dy * cos - dx * sin)) > view_m
    since = int(np.flatnonzero(hidden)[-1]) + 1 if hidden.any() else 0
    return (hit.step - since) * crash.dt


def _flaws(case: Scenario) -> tuple[Flaw, ...]:
    return case.judgement.flaws if case.judgement else ()
