"""Harmless neighbours: the scene of a crash with so little of its attack left that a careful driver passes safely.

In a suite of crashes only, a planner that always brakes scores best. So each crash gets a harmless neighbour, in which
a planner has to make progress.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from regents_cosim.checks.names import file_name
from regents_cosim.evaluation.drives.driving import DriveResult, drive_and_keep
from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.scenario.attack_record import CAREFUL_COMPLETION, HARMLESS_SHARE, AttackRecord
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.system.workers import cores
from regents_cosim.verdicts.clean import touches_in

_SHARES = (0.75, 0.5, 0.25, 0.0)  # of the attack that is left; the largest harmless one is taken
# The shipped IDM's comfortable deceleration. A cruise control may brake by 3.5 m/s^2 (ISO 15622); most drivers find 3.4
# comfortable (AASHTO Green Book, stopping sight distance). The careful driver exceeds this only where it sees a risk.
_CALM_BRAKING_M_S2 = 3.0
_GETS_ON = 0.5  # least share of the recorded way, where the recorded ego does not stand


def harmless_neighbour(crash: Scenario, careful: MirrorController) -> Scenario | None:
    """The scene of a crash with the greatest share of its attack that is harmless; None where no share is.

    Harmless means: the careful driver keeps 1 m from all others, never brakes by more than 3 m/s^2 and makes progress,
    and no two others touch that did not in the log. The case holds the careful driver's drive, and notes its
    completion.
    """
    for share in _SHARES:
        scene = weakened(replace(crash, judgement=None, evasion=None), share)
        drive, tracks = drive_and_keep(scene, careful)
        if tracks is not None and _passes(drive) and _calm(tracks, scene.dt) and not _others_touch(scene):
            return replace(_noted(scene, crash, share, drive), tracks=tracks)
    return None


def harmless_neighbours(crashes: Sequence[Scenario], planner: PlannerUnderTest) -> dict[str, Scenario]:
    """The harmless neighbours of those crashes that have one, by the id of the crash, for this careful driver."""
    with MirrorController(planner) as careful, ThreadPoolExecutor(cores()) as pool:
        found = pool.map(partial(harmless_neighbour, careful=careful), crashes)
        return {crash.id: one for crash, one in zip(crashes, found, strict=True) if one is not None}


def _passes(drive: DriveResult) -> bool:
    room = drive.min_gap_m is None or drive.min_gap_m >= CAREFUL.room_m
    return drive.hits is None and room and drive.completion >= _GETS_ON


def _calm(tracks: Tracks, dt: float) -> bool:
    braking = -np.diff(tracks.speed[0]) / dt
    return bool(braking.max(initial=0.0) <= _CALM_BRAKING_M_S2 + 1e-3)  # single precision


def _others_touch(scene: Scenario) -> bool:
    assert scene.log is not None
    new = touches_in(scene, scene.tracks) & ~touches_in(scene, scene.log)
    return bool(new[1:, 1:].any())


def _noted(scene: Scenario, crash: Scenario, share: float, drive: DriveResult) -> Scenario:
    assert crash.attack is not None
    record = AttackRecord(
        case=crash.attack.case,
        method=crash.attack.method,
        planner=crash.attack.planner,
        outcome="no_collision",
        iterations=crash.attack.iterations,
        candidates=crash.attack.candidates,
        settings={HARMLESS_SHARE: share, CAREFUL_COMPLETION: round(drive.completion, 4)},
        dynamics=crash.attack.dynamics,
    )
    return replace(scene, id=file_name(crash.id, "harmless"), attack=record)


def weakened(scenario: Scenario, share: float) -> Scenario:
    """The scenario with only a `share` of its attack; the ego's own track stays.

    The others move along straight lines from their recorded positions (share 0) to the attacked ones (share 1), so that
    their velocities and accelerations are averages of the two: a bound that both keep, such as a friction circle, holds
    for every share.
    """
    log, attacked = scenario.log, scenario.tracks
    if log is None or share == 1.0:
        return scenario
    both = log.valid & attacked.valid
    velocity = [track.speed * np.exp(1j * track.yaw) for track in (log, attacked)]
    speed = np.abs(velocity[0] + share * (velocity[1] - velocity[0]))
    mixed = {
        "x": log.x + share * (attacked.x - log.x),
        "y": log.y + share * (attacked.y - log.y),
        "yaw": log.yaw + share * wrap(attacked.yaw - log.yaw),
        "speed": speed,
    }
    others = np.arange(len(scenario.agents))[:, None] > 0
    values = {name: np.where(others & both, value, getattr(attacked, name)) for name, value in mixed.items()}
    return replace(scenario, tracks=scenario.with_heights(Tracks(**values, valid=attacked.valid)))
