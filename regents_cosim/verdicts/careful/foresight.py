"""The risks that a careful driver foresees (`norms.foresight`), for every step of the ego's own drive at once.

Only pairs of a step and a road user that could meet at all are looked at, in double precision and with exact boxes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.careful import FORESIGHT, seen_over_steps
from regents_cosim.norms.foresight import (
    PlaceOnPath,
    along_arc,
    between_lanes,
    can_wait,
    comes_over,
    crosses,
    drifts,
    further,
    is_suspected,
    motion_over,
    place_of,
)
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import EgoPath
from regents_cosim.verdicts.careful.lane_keeping import from_lane_centre, to_yield_line


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of a step and an agent."""

    step: Int[np.ndarray, " pair"]
    agent: Int[np.ndarray, " pair"]

    def take(self, chosen: Bool[np.ndarray, " pair"]) -> "_Pairs":
        return _Pairs(self.step[chosen], self.agent[chosen])


def all_risks(scenario: Scenario, path: EgoPath, agents: Sequence[int], steps: int) -> Bool[np.ndarray, "agent step"]:
    """Whether `agents` are seen as risks at each of the first `steps` steps, if the ego continues as it does then.

    False for all others.
    """
    found = np.zeros((len(scenario.agents), steps), bool)
    pairs = _in_reach(scenario, agents, steps)
    if not len(pairs.step):
        return found
    place = _place(scenario, path, pairs)
    meets_s, turn_cos = _meeting(scenario, path, pairs, place.leads)
    meets = np.isfinite(meets_s)
    pairs, place = pairs.take(meets), PlaceOnPath(*(values[meets] for values in place))
    meets_s, turn_cos = meets_s[meets], turn_cos[meets]
    crossing = crosses(turn_cos)
    wanders, waits = _wanders(scenario, pairs, place, ~crossing), _waits(scenario, pairs, crossing)
    over, (_, braking) = _comes_over(scenario, path)[pairs.step], _motion(scenario, pairs)
    suspected = is_suspected(np, place, meets_s, turn_cos, wanders, waits, braking, over)
    found[pairs.agent[suspected], pairs.step[suspected]] = True
    return found


def expected_ways(
    scenario: Scenario,
    path: EgoPath,
    agents: Int[np.ndarray, " agent"],
    step: int,
    ahead_s: Float[np.ndarray, " ahead"],
) -> list[Float[np.ndarray, "agent ahead"]]:
    """X, y, yaw and height at which the driver expects agents so many seconds after a step, by what it shows then."""
    pairs = _Pairs(np.full(len(agents), step), agents)
    return _going_on(scenario, pairs, ahead_s, _place(scenario, path, pairs).leads)


def _in_reach(scenario: Scenario, agents: Sequence[int], steps: int) -> _Pairs:
    """The pairs that can meet at all within the time that is looked ahead."""
    tracks = scenario.tracks
    x, y, speed, valid = (values[:, :steps] for values in (tracks.x, tracks.y, tracks.speed, tracks.valid))
    size = np.array([np.hypot(agent.length, agent.width) for agent in scenario.agents])[:, None]
    reach = (speed + speed[:1]) * FORESIGHT.ego_times_s[-1] + 0.5 * (size + size[:1])
    near = valid & ((x - x[:1]) ** 2 + (y - y[:1]) ** 2 <= reach**2)
    near &= np.isin(np.arange(len(near)), agents)[:, None]
    agent, step = np.nonzero(near)
    return _Pairs(step, agent)


def _meeting(
    scenario: Scenario, path: EgoPath, pairs: _Pairs, brakes_on: Bool[np.ndarray, " pair"]
) -> tuple[Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]]:
    """Seconds until the two would first overlap (infinite: never), and the cosine of the angle between them then.

    The ego's instants are shifted against the other's by up to the slack, both ways.
    """
    slack, time = FORESIGHT.slack, FORESIGHT.times_s
    other = _going_on(scenario, pairs, time, brakes_on)
    x, y, yaw = path.at(path.driven[:, None] + _ego_further(scenario, FORESIGHT.ego_times_s))
    ego = x, y, yaw, scenario.heights.of(0, x, y)  # at every time from every step on
    size = np.array([(agent.length, agent.width) for agent in scenario.agents])
    reach = 0.5 * (np.hypot(*size[pairs.agent].T) + np.hypot(*size[0]))[:, None]
    first, turn = np.full(len(pairs.step), np.inf), np.zeros(len(pairs.step))
    for shift in range(-slack, slack + 1):
        at = np.arange(len(time)) + shift
        there = at >= 0
        mine = [values[pairs.step][:, at[there]] for values in ego]
        theirs = [values[:, there] for values in other]
        close = (mine[0] - theirs[0]) ** 2 + (mine[1] - theirs[1]) ** 2 <= reach**2
        row, column = np.nonzero(close)
        if not len(row):
            continue
        pose, box = ([values[row, column] for values in poses] for poses in (mine, theirs))
        hit = overlap(_boxes(pose, size[:1]), _boxes(box, size[pairs.agent[row]]))
        row, seconds = row[hit], time[there][column[hit]]
        order = np.lexsort((seconds, row))
        row, index = np.unique(row[order], return_index=True)
        seconds, turned = seconds[order][index], (box[2] - pose[2])[hit][order][index]
        sooner = seconds < first[row]
        first[row[sooner]], turn[row[sooner]] = seconds[sooner], turned[sooner]
    return first, np.cos(turn)


def _boxes(poses: list[np.ndarray], sizes: Float[np.ndarray, "#pair 2"]) -> Boxes:
    """Boxes of sizes [length, width] at x, y, yaw and height."""
    x, y, yaw, z = poses
    return Boxes(x, y, yaw, sizes[:, 0], sizes[:, 1], z)


def _motion(scenario: Scenario, pairs: _Pairs) -> tuple[Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]]:
    """Curvature [1/m] and braking [m/s^2] of agents over the time just past (`FORESIGHT.over_s`)."""
    tracks, now = scenario.tracks, (pairs.agent, pairs.step)
    since = np.maximum(pairs.step - seen_over_steps(np, scenario.dt), 0)
    then, passed_s = (pairs.agent, since), np.maximum(pairs.step - since, 1) * scenario.dt
    turned, lost = wrap(tracks.yaw[now] - tracks.yaw[then]), tracks.speed[then] - tracks.speed[now]
    return motion_over(np, turned, lost, tracks.speed[now], tracks.valid[then], passed_s)


def _going_on(
    scenario: Scenario, pairs: _Pairs, time: Float[np.ndarray, " ahead"], brakes_on: Bool[np.ndarray, " pair"]
) -> list[Float[np.ndarray, "pair ahead"]]:
    """Predicted x, y, yaw and height of agents that continue as they do; those that `brakes_on` marks brake on."""
    at, tracks = (pairs.agent, pairs.step), scenario.tracks
    x, y, yaw, z, speed = (values[at][:, None] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z, tracks.speed))
    curvature, braking = _motion(scenario, pairs)
    way = further(np, speed, np.where(brakes_on, braking, 0.0)[:, None], time)
    x, y, yaw = along_arc(np, x, y, yaw, curvature[:, None] * way, way)
    return [x, y, yaw, z + 0.0 * time]


def _ego_further(scenario: Scenario, time: Float[np.ndarray, " ahead"]) -> Float[np.ndarray, "step ahead"]:
    """Distances [m] of the ego from every step on, if it continues braking as it does."""
    steps = np.arange(scenario.tracks.steps)
    _, braking = _motion(scenario, _Pairs(steps, 0 * steps))
    return further(np, scenario.tracks.speed[0][:, None], braking[:, None], time)


def _wanders(
    scenario: Scenario, pairs: _Pairs, place: PlaceOnPath, asked: Bool[np.ndarray, " pair"]
) -> Bool[np.ndarray, " pair"]:
    """Which of the pairs `asked` have left the middle of their lane for the ego's way."""
    tracks, at = scenario.tracks, (pairs.agent[asked], pairs.step[asked])
    off_m = from_lane_centre(scenario.road, *(values[at] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z)))
    found = np.zeros(len(pairs.step), bool)
    found[asked] = drifts(np, off_m, PlaceOnPath(*(values[asked] for values in place)))
    return found


def _waits(scenario: Scenario, pairs: _Pairs, asked: Bool[np.ndarray, " pair"]) -> Bool[np.ndarray, " pair"]:
    """Which of the pairs `asked` have to let the ego pass, and can still wait for it."""
    tracks, at = scenario.tracks, (pairs.agent[asked], pairs.step[asked])
    line_m = to_yield_line(scenario, *(values[at] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z)))
    half_length = 0.5 * np.array([agent.length for agent in scenario.agents])[at[0]]
    found = np.zeros(len(pairs.step), bool)
    found[asked] = can_wait(line_m, half_length, tracks.speed[at])
    return found


def _place(scenario: Scenario, path: EgoPath, pairs: _Pairs) -> PlaceOnPath:
    tracks, at = scenario.tracks, (pairs.agent, pairs.step)
    half = 0.5 * np.array([(agent.length, agent.width) for agent in scenario.agents])
    along, aside, yaw = path.project(tracks.x[at], tracks.y[at])
    ahead = along - path.driven[pairs.step]
    half_length, half_width = half[pairs.agent].T
    return place_of(np, ahead, aside, tracks.yaw[at] - yaw, half_length, half_width, (half[0, 0], half[0, 1]))


def _comes_over(scenario: Scenario, path: EgoPath) -> Bool[np.ndarray, " step"]:
    """Whether the ego is about to leave the middle of its lane for another, at every step."""
    reach = path.driven + _ego_further(scenario, FORESIGHT.ego_times_s[-1:])[:, 0]
    near = path.distance <= reach.max()
    x, y, yaw = (values[near] for values in (path.x, path.y, path.yaw))
    between = between_lanes(np.abs(from_lane_centre(scenario.road, x, y, yaw, scenario.heights.of(0, x, y))))
    return comes_over(between, path.distance[near], path.driven, reach)
