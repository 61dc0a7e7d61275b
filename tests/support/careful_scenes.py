"""Cut-ins and what the careful driver does in them."""

import numpy as np
from scenes import DT, TIME, crash, moved, scene, straight_road

from regents_cosim.verdicts.careful.careful_driver import careful_verdict

WIDTH = 3.2


def careful(attacked):
    return careful_verdict(attacked)[0]


def cut_in(gap, lateral, speed=15.0, other=10.0):
    """A slower car that comes over from the next lane, `gap` m ahead of the ego when it sets out after 1 s."""
    start = gap + 4.6 + (speed - other) * 1.0
    made = scene((0, 0, speed), (start, WIDTH, other), road=straight_road(2))
    return crash(made, aside(made, lateral, other))


def comes_over(ahead, speed=12.0, lateral=1.0):
    """An ego that changes lanes from 3 s on, into one that drives as fast, `ahead` m ahead of it on the next lane."""
    made = scene((0, 0, speed), (ahead, WIDTH, speed), road=straight_road(2))
    y = np.clip(lateral * (TIME - 3.0), 0.0, WIDTH)
    return crash(made, moved(made, 0, y=y, yaw=np.append(0.0, np.arctan2(np.diff(y) / DT, speed))))


def aside(made, lateral, speed):
    """The tracks of `made` with a second car that comes over by a lane, from 1 s on, and points where it goes."""
    y = WIDTH - np.clip(lateral * (TIME - 1.0), 0.0, WIDTH)
    return moved(made, 1, y=y, yaw=np.append(0.0, np.arctan2(np.diff(y) / DT, speed)))
