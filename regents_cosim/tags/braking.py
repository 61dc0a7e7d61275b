"""Tag for an adversary that brakes in front of the ego."""

import numpy as np

from regents_cosim.tags.meeting import Meeting

# ISO 15622: adaptive cruise control need not brake harder, so a vehicle that follows by it cannot react
_HARD_M_S2 = 3.5
_LASTING_S = 0.5


def hard_brake(meeting: Meeting) -> bool:
    """The other, ahead in the ego's way and in it to the end, brakes by 3.5 m/s² or more over half a second."""
    over = max(round(_LASTING_S / meeting.scenario.dt), 1)
    if len(meeting.steps) <= over:
        return False
    speed = meeting.scenario.tracks.speed[meeting.other, meeting.steps]
    lost = speed[:-over] - speed[over:]
    # an agent that left the ego's way has not braked in front of it
    stays = np.arange(len(speed)) >= (meeting.entry or 0)
    leads = stays & meeting.in_way & meeting.in_front & meeting.same_way
    hard = lost >= _HARD_M_S2 * _LASTING_S - 1e-9
    return bool((hard & leads[:-over] & leads[over:] & (np.diff(meeting.steps)[: len(lost)] == 1)).any())
