"""IDM with a bug on purpose, as somebody might commit it: half the time headway."""

from regents_cosim.planners.idm import IDM


class BuggyIDM(IDM):
    """Follows its leader at half the distance."""

    time_headway: float = 0.5  # [s] was 1.0
