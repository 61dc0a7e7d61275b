"""The robustness margin: the smallest share of an attack that makes a planner collide.

The other road users move along straight lines from their recorded positions (share 0) to the attacked ones (share 1),
so that their velocities and accelerations are averages of the two: a bound that both keep, such as a friction circle,
holds for every share. The margin is the least share at which the planner, driving again, collides. It falls before a
planner starts to crash in the attack itself, and continues to fall afterwards.

It is not assumed that a planner which collides at one share collides at every greater one. It is assumed that colliding
shares form intervals of a quarter or more. Shorter ones can be missed, so the margin is an upper bound, with a
resolution of a sixteenth.
"""

from dataclasses import replace

import numpy as np

from regents_cosim.collisions import first_contact
from regents_cosim.errors import DriveError
from regents_cosim.evaluation.drives.driving import DriveResult, failed_drive
from regents_cosim.geometry.frames import wrap
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.scenario import Scenario, Tracks

_COARSE = (0.25, 0.5, 0.75, 1.0)
_HALVINGS = 2  # of the quarter before the first colliding share


def attack_margin(scenario: Scenario, driver: MirrorController) -> float | None:
    """The least share of the attack at which the planner collides, in (0, 1]; None where it never does.

    It takes up to six drives. None also for scenarios without an attack. Raises DriveError.
    """
    if scenario.log is None:
        return None

    def collides(weaker: Scenario) -> bool:
        return first_contact(weaker.agents, driver.drive(weaker).tracks) is not None

    hit = next((share for share in _COARSE if collides(weakened(scenario, share))), None)
    if hit is None:
        return None
    safe = hit - 0.25
    for _ in range(_HALVINGS):
        middle = 0.5 * (safe + hit)
        safe, hit = (safe, middle) if collides(weakened(scenario, middle)) else (middle, hit)
    return hit


def with_margin(scenario: Scenario, drive: DriveResult, driver: MirrorController) -> tuple[DriveResult, float | None]:
    """The drive and its margin; a planner that fails in a weaker attack has failed in the case."""
    if drive.error:
        return drive, None
    try:
        return drive, attack_margin(scenario, driver)
    except DriveError as failure:
        return failed_drive(scenario, f"{failure} (with less of the attack)", failure.trace), None


def weakened(scenario: Scenario, share: float) -> Scenario:
    """The scenario with only a `share` of its attack; the ego's own track stays."""
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
