"""What the law forbids the other, as the offences of `verdicts.offences` have it."""

from regents_cosim.tags.meeting import Meeting


def run_red_light(meeting: Meeting) -> bool:
    """The other passes the stop line of its movement on red, in the last 5 s."""
    return meeting.other in meeting.crash.acts("red_light", within_s=5.0)


def wrong_way(meeting: Meeting) -> bool:
    """In the last second the other's centre is where only oncoming traffic may be, or more than 17 % of its body."""
    return any(meeting.other in meeting.crash.late_acts(name) for name in ("against_direction", "oncoming_lanes"))
