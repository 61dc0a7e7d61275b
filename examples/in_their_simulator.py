"""Drive an exported case with a planner's own tools, and say which road user it touches first.

The Python that has `commonroad-idm-planner` (`idm`) or `fiss-planner[commonroad]` (`fiss`) runs this, not ours; the
last word is for how long it drives [s]:

    regents export suite/CASE --to commonroad -o exported/
    other/bin/python in_their_simulator.py idm exported/ 6
"""

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.scenario.scenario import Scenario

CYCLE = 11  # steps that `commonroad-idm-planner` drives along each plan
Way = Iterator[tuple[int, Rectangle]]  # where an ego is at each step


def idm(file: Path, steps: int) -> Way:
    """The drive of `commonroad-idm-planner`, among those that are there from the start."""
    from commonroad_idm_planner.idm_easy_api import solve_planning_problem

    scenario, problems = CommonRoadFileReader(str(file)).open()
    (problem,) = problems.planning_problem_dict.values()
    later = [other for other in scenario.dynamic_obstacles if other.initial_state.time_step > 0]
    scenario.remove_obstacle(later)  # the package asks where they are before they have come, and fails
    goal = problem.goal.state_list[0]
    goal.time_step = Interval(goal.time_step.end, goal.time_step.end)  # it drives on beyond its target, as in the case
    planner = solve_planning_problem(scenario, problem, planning_cycle_max=steps // CYCLE)
    size = planner.config.vehicle_length, planner.config.vehicle_width
    for state in planner.trajectory_over_scenario.state_list:
        yield state.time_step, Rectangle(*size, state.position, state.orientation)


def fiss(file: Path, steps: int) -> Way:
    """The drive of FISS+ in the benchmark of `fiss-planner`, which ends at a collision, a kerb or the target."""
    from fiss_planner.commonroad.benchmark import Options, run_scenario

    told = Options(planner="fiss_plus", prediction="lane_following", max_steps=steps)  # no look into the future
    row, record = run_scenario(str(file), told, record=True)
    print(f"fiss-planner: {row['status']}")
    for step, (place, yaw) in enumerate(zip(record["ego"], record["yaw"], strict=True)):
        yield step, Rectangle(*record["vehicle"], np.array(place), yaw)


PLANNERS = {"idm": idm, "fiss": fiss}


def touched(scenario: Scenario, way: Way) -> tuple[int, int] | None:
    """The first step at which the ego touches another road user, and that one's number."""
    for step, ego in way:
        for other in scenario.dynamic_obstacles:
            there = other.occupancy_at_time(step)
            if there is not None and there.shape.shapely_object.intersects(ego.shapely_object):
                return step, other.obstacle_id
    return None


def main(planner: str, folder: str, seconds: float) -> None:
    """Say which road user the ego touches first, by the names of the case."""
    file = Path(folder, "planning.xml")
    scenario, _ = CommonRoadFileReader(str(file)).open()
    with Path(folder, "ids.csv").open(newline="") as rows:
        ids = {int(row["number"]): f"{row['id']} ({row['role']})" for row in csv.DictReader(rows)}
    hit = touched(scenario, PLANNERS[planner](file, round(seconds / scenario.dt)))
    print("no collision" if hit is None else f"collision at {hit[0] * scenario.dt:.1f} s with {ids[hit[1]]}")


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("planner", choices=PLANNERS)
    asked.add_argument("folder")
    asked.add_argument("seconds", type=float)
    main(**vars(asked.parse_args()))
