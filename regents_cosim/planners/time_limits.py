"""Time limits of a planner outside the mirror, and when it is given up."""

import threading

from regents_cosim.checks.ranges import Range
from regents_cosim.errors import DriveError

ACT_TIMEOUT_S = 10.0  # for one decision
MAKE_TIMEOUT_S = 60.0  # for its imports and its construction
RESET_TIMEOUT_S = 30.0  # for one `reset`
ACT_TIMEOUT = Range(1e-3, 86400.0, "seconds that a planner may take over one decision")


class Deadlines:
    """The deadlines that all processes of one planner share; usable from any thread.

    A planner that hangs when it is made, or in its first `reset`, is given up: all further drives fail at once. A
    planner that has answered a `reset` before is given up when it hangs in two `reset`s in a row.
    """

    def __init__(self, act_timeout_s: float = ACT_TIMEOUT_S) -> None:
        """A longer limit for decisions also lengthens the other limits. Raises RegentsError."""
        ACT_TIMEOUT.check("act-timeout", act_timeout_s)
        self.act_s = act_timeout_s
        self.make_s = max(MAKE_TIMEOUT_S, act_timeout_s)
        self.reset_s = max(RESET_TIMEOUT_S, act_timeout_s)
        self._lock = threading.Lock()
        self._chances = 1  # to hang in `reset`
        self._given_up: DriveError | None = None

    def check(self) -> None:
        """Raise DriveError where the planner has been given up."""
        if self._given_up is not None:
            raise DriveError(f"{self._given_up}; it was not asked again (more time: `act_timeout`)")

    def hung(self, failure: DriveError, in_reset: bool) -> DriveError:
        """Note that the planner hung in `reset`, or when it was made, and return the error to raise."""
        with self._lock:
            self._chances = self._chances - 1 if in_reset else 0
            if self._chances <= 0:
                self._given_up = failure
        return DriveError(str(failure), failure.trace)

    def has_reset(self) -> None:
        """Note that the planner answered a `reset`."""
        with self._lock:
            self._chances = 2
