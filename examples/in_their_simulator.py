"""Drive an exported case with the own tools of `commonroad-idm-planner`, and say which road user it touches first.

The Python that has that package runs this, not ours; the last word is for how long it drives [s]:

    regents export suite/CASE --to commonroad -o exported/
    other/bin/python in_their_simulator.py exported/ 6
"""

import csv
import sys
from collections.abc import Iterator
from pathlib import Path

from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.scenario.scenario import Scenario
from commonroad_idm_planner.idm_easy_api import solve_planning_problem

CYCLE = 11  # steps that the package drives along each plan


def drive(scenario: Scenario, problem: PlanningProblem, steps: int) -> Iterator[tuple[int, Rectangle]]:
    """Where its ego is at each step, among those that are there from the start."""
    later = [other for other in scenario.dynamic_obstacles if other.initial_state.time_step > 0]
    scenario.remove_obstacle(later)  # the package asks where they are before they have come, and fails
    goal = problem.goal.state_list[0]
    goal.time_step = Interval(goal.time_step.end, goal.time_step.end)  # it drives on beyond its target, as in the case
    planner = solve_planning_problem(scenario, problem, planning_cycle_max=steps // CYCLE)
    size = planner.config.vehicle_length, planner.config.vehicle_width
    for state in planner.trajectory_over_scenario.state_list:
        yield state.time_step, Rectangle(*size, state.position, state.orientation)


def main(folder: str, seconds: str) -> None:
    """Say which road user the ego touches first, by the names of the case."""
    scenario, problems = CommonRoadFileReader(str(Path(folder, "planning.xml"))).open()
    (problem,) = problems.planning_problem_dict.values()
    with Path(folder, "ids.csv").open(newline="") as rows:
        ids = {row["number"]: f"{row['id']} ({row['role']})" for row in csv.DictReader(rows)}
    steps = round(float(seconds) / scenario.dt)
    for step, ego in drive(scenario, problem, steps):
        for other in scenario.dynamic_obstacles:
            there = other.occupancy_at_time(step)
            if there is not None and there.shape.shapely_object.intersects(ego.shapely_object):
                print(f"collision at {step * scenario.dt:.1f} s with {ids[str(other.obstacle_id)]}")
                return
    print("no collision")


if __name__ == "__main__":
    main(*sys.argv[1:])
