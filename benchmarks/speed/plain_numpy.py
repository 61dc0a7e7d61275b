"""The cost of KING written as its equations read, in NumPy and Python loops: what the benchmark compares with."""

import numpy as np

from regents_cosim.geometry.boxes import Boxes, corners, distance
from regents_cosim.mirror.road_field import CELL_M
from regents_cosim.mirror.world import World


def roll_out(world: World, agents: int) -> np.ndarray:
    """Poses and speeds [agent, time, 4] of the first `agents` under the world's controls, step by step."""
    accel, curvature = np.asarray(world.controls.accel), np.asarray(world.controls.curvature)
    steps = accel.shape[1]
    dt = float(world.dt)
    states = np.zeros((agents, steps + 1, 4))
    begin = (world.start.x, world.start.y, world.start.yaw, world.start.speed)
    states[:, 0] = np.stack([np.asarray(v)[:agents] for v in begin], 1)
    for agent in range(agents):
        for k in range(steps):
            x, y, yaw, speed = states[agent, k]
            after = max(speed + accel[agent, k] * dt, 0.0)
            travelled = 0.5 * (speed + after) * dt
            turned = yaw + curvature[agent, k] * travelled
            mid = 0.5 * (yaw + turned)
            states[agent, k + 1] = x + travelled * np.cos(mid), y + travelled * np.sin(mid), turned, after
    return states


def cost(world: World, agents: int, pair_weight: float, road_weight: float, reach_m: float) -> float:
    """C_ego_col + lambda_col C_adv_col + lambda_dev C_adv_dev of the first `agents`, without a gradient."""
    states = roll_out(world, agents)
    times = states.shape[1]
    length, width = 2.0 * np.asarray(world.half_length), 2.0 * np.asarray(world.half_width)

    def box(agent: int) -> Boxes:
        x, y, yaw, _ = states[agent].T
        return Boxes(x, y, yaw, np.full(times, length[agent]), np.full(times, width[agent]))

    boxes = [box(agent) for agent in range(agents)]
    ego = min(float(distance(boxes[0], boxes[i]).mean()) for i in range(1, agents))
    pair, road = reach_m, 0.0
    for i in range(1, agents):
        for j in range(i + 1, agents):
            pair = min(pair, float(distance(boxes[i], boxes[j]).min()))
        road += off_road(world, corners(boxes[i])) / times
    return ego - pair_weight * pair + road_weight * road


def off_road(world: World, points: np.ndarray) -> float:
    """Sum of the road field, bilinear between its cells, at points [..., 2]."""
    rows, columns = np.asarray(world.road.shape).tolist()
    field = np.asarray(world.road.cells)[: rows * columns, 0].reshape(rows, columns)
    u, v = np.moveaxis((points - np.asarray(world.road.corner)) / CELL_M, -1, 0)
    column, row = np.clip(u.astype(int), 0, columns - 2), np.clip(v.astype(int), 0, rows - 2)
    s, t = u - column, v - row
    lower = field[row, column] * (1.0 - s) + field[row, column + 1] * s
    upper = field[row + 1, column] * (1.0 - s) + field[row + 1, column + 1] * s
    return float((lower * (1.0 - t) + upper * t).sum())
