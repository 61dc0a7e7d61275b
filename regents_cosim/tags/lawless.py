"""Tags for an adversary that breaks the law: by the offences of `verdicts.law.offences`, or by its place alone."""

import numpy as np

from regents_cosim.geometry.boxes import Boxes
from regents_cosim.norms.limits import STANDING_M_S
from regents_cosim.tags.meeting import Meeting
from regents_cosim.verdicts.law.oncoming import oncoming_share

_LATE_S = 1.0
_BODY_SHARE = 0.17  # as in `verdicts`: 0.3 m of a car 1.8 m wide
_STEPS = 2


def run_red_light(meeting: Meeting) -> bool:
    """The other passes the stop line of its movement on red, in the last 5 s."""
    return meeting.other in meeting.crash.acts("red_light", within_s=5.0)


def wrong_way(meeting: Meeting) -> bool:
    """In the last second more than 17 % of the other's body is where only oncoming traffic may be, and it moves."""
    drive = meeting.drive(meeting.other)
    late = drive.steps >= meeting.step - round(_LATE_S / meeting.scenario.dt)
    body = Boxes(*(np.broadcast_to(values, late.shape)[late] for values in drive.box))
    # The law allows only an agent's own ways; here an agent on another way through a junction is not wrong-way.
    share = oncoming_share(meeting.scenario.road, body)
    return bool((share > _BODY_SHARE).sum() >= _STEPS and drive.speed[late].max() > STANDING_M_S)
