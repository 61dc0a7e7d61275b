"""The drives that touch no other agent agree with a box test at every step, for any batch size."""

import numpy as np
from scenes import moving, platoon

from regents_cosim.attacks.starts.meeting import MeetingDrives
from regents_cosim.attacks.starts.other_traffic import OtherTraffic
from regents_cosim.geometry.boxes import Boxes, overlap

AGENT, FIRST, STEPS, DRIVES = 4, 3, 60, 150


def some_drives(made, seed):
    """Several drives of one vehicle that diverge from its present state."""
    rng, tracks, seconds = np.random.default_rng(seed), made.tracks, 0.1 * np.arange(STEPS)
    speed = tracks.speed[AGENT, FIRST] * rng.uniform(0.2, 1.8, (DRIVES, 1)) + 0.0 * seconds
    yaw = np.clip(rng.normal(0.0, 0.15, (DRIVES, 1)) * seconds, -0.6, 0.6)
    x = tracks.x[AGENT, FIRST] + np.cumsum(speed * np.cos(yaw) * 0.1, axis=1)
    y = tracks.y[AGENT, FIRST] + np.cumsum(speed * np.sin(yaw) * 0.1, axis=1)
    meets = rng.integers(5, STEPS, DRIVES)
    return MeetingDrives(meets, np.zeros(DRIVES), np.zeros(DRIVES), np.zeros(DRIVES, bool), x, y, yaw, speed)


def touches_nobody(made, drives, row):
    others = [k for k in range(len(made.agents)) if k not in (0, AGENT)]
    for step in range(drives.meets[row] + 1):
        mine = Boxes(drives.x[row, step], drives.y[row, step], drives.yaw[row, step], 4.6, 1.8)
        at = others, FIRST + step
        its = Boxes(made.tracks.x[at], made.tracks.y[at], made.tracks.yaw[at], 4.6, 1.8)
        if np.any(overlap(mine, its) & made.tracks.valid[at]):
            return False
    return True


def test_those_that_touch_nobody_are_found_in_order():
    made = platoon(seed=3)
    made = moving(made, 7, valid=np.arange(made.tracks.steps) >= 25)  # enters later
    drives, order = some_drives(made, seed=1), np.random.default_rng(2).permutation(DRIVES)
    wanted = np.ones(DRIVES, bool)
    wanted[::7] = False
    found = list(OtherTraffic(made, AGENT).left_alone(drives, order, FIRST, wanted))
    assert found == [row for row in order.tolist() if wanted[row] and touches_nobody(made, drives, row)]
    assert 20 < len(found) < 100
