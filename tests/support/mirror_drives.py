"""The drive of a planner in a case, in the mirror."""

from regents_cosim.planners.under_test import AnyPlanner
from regents_cosim.replays.mirror import MirrorController
from regents_cosim.scenario import Scenario, Tracks


def replay_in_mirror(scenario: Scenario, planner: AnyPlanner) -> Tracks:
    """The tracks of `scenario`, its ego driven in closed loop by `planner`."""
    with MirrorController(planner) as driver:
        return driver.drive(scenario).tracks
