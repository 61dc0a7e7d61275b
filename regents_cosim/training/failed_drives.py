"""Finds cases that a planner fails and a careful driver passes: its collision, and the drive that avoids it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.planners.aim_bev.camera import PAPERS
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.collisions import collision_at, first_contact
from regents_cosim.scenario.judgement import Flaw
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.judge import judge


def failed_drives(
    scenarios: Iterable[Scenario], drives: Iterable[Tracks], planner: str, view_m: float = PAPERS.view_m
) -> Iterator[Scenario | None]:
    """Put each drive of `planner` into its case, and judge it; a drive without a collision gives None.

    The evasion is dropped if it begins before the other road user is in the ego's view, which reaches `view_m` to each
    side: until then there is nothing to brake for. All others drive as in the case.
    """
    for scenario, tracks in zip(scenarios, drives, strict=True):
        crash = _as_driven(scenario, tracks, planner)
        yield _if_in_view(judge(crash), view_m) if crash else None


def teachable(failed: Sequence[Scenario | None]) -> list[Scenario]:
    """The failures with an evasion to learn from, without those in which another hit it from behind."""
    avoided = [case for case in failed if case is not None and case.evasion is not None]
    return [case for case in avoided if case.judgement is None or not _BEHIND & set(case.judgement.flaws)]


_BEHIND: frozenset[Flaw] = frozenset({Flaw.REAR_ENDS_EGO, Flaw.FROM_BEHIND})


def _as_driven(scenario: Scenario, tracks: Tracks, planner: str) -> Scenario | None:
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


def _if_in_view(crash: Scenario, view_m: float) -> Scenario:
    """The crash, without an evasion that begins before the other road user is in the ego's view and stays there."""
    begins = crash.evades_from
    return crash if begins is None or begins >= _seen_from(crash, view_m) else replace(crash, evasion=None)


def _seen_from(crash: Scenario, view_m: float) -> int:
    """The step from which on the ego's view has the centre of the other road user, up to the collision."""
    hit = crash.collision
    assert hit is not None
    tracks, other, until = crash.tracks, crash.index(hit.agent), hit.step + 1
    dx, dy = tracks.x[other, :until] - tracks.x[0, :until], tracks.y[other, :until] - tracks.y[0, :until]
    hidden = np.abs(ahead_and_left(np, dx, dy, tracks.yaw[0, :until])).max(axis=0) > view_m
    return int(np.flatnonzero(hidden)[-1]) + 1 if hidden.any() else 0
