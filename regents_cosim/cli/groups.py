"""The groups of options in `--help`, in their order; an option is in the same group in every command.

Those in `Advanced` are settings where a command takes `--config` (`settings.py`).
"""

from cyclopts import Group, Parameter

TRAFFIC = Group("Traffic", sort_key=1)
PLANNER = Group("Planner", sort_key=2)
BASELINE = Group("Baseline", sort_key=3)
TRAINING = Group("Training", sort_key=3)
SEARCH = Group("Search", sort_key=4)
OUTPUT = Group("Output", sort_key=5)
RUN = Group("Run", sort_key=6)
ADVANCED = Group("Advanced", sort_key=7)

OfTraffic, OfPlanner, OfTraining, OfSearch, OfOutput, OfRun, Advanced = (
    Parameter(group=group) for group in (TRAFFIC, PLANNER, TRAINING, SEARCH, OUTPUT, RUN, ADVANCED)
)
