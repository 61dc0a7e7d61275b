"""What a careful driver sees coming, at every step of the ego's own drive at once.

All others are expected to go on with the present speed and turn, the ego along its own path. The ego and who leads in
its way are expected to brake on as they do, until they stand; to expect that of who crosses would be careless. A risk
is an overlap of the two within some seconds. Suspected of it are those that cross, those in the way that the ego is
about to sweep, and those beside it that have left the middle of every lane which runs their way: who keeps to a lane
is expected to go on doing so.

Source of the wandering zone: UN Regulation 157, Annex 3 (01 series), performance models: a lane change is perceived
when a vehicle's centre is more than 0.375 m from the middle of its lane. The rest generalises the
regulation's cut-in, cut-out and deceleration from a lane to any road.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.frames import wrap
from regents_cosim.mirror.bicycle import CURVATURE_LIMIT
from regents_cosim.planners.reference.parameters import CAREFUL, FORESIGHT, Foresight
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.ego_path import EgoPath
from regents_cosim.verdicts.lane_keeping import from_lane_centre

_LEAST_TRAVEL_M = 0.05  # below, a turn is noise


@dataclass(frozen=True, eq=False)
class _Pairs:
    """A step and an agent each."""

    step: Int[np.ndarray, " pair"]
    agent: Int[np.ndarray, " pair"]

    def take(self, chosen: Bool[np.ndarray, " pair"]) -> "_Pairs":
        return _Pairs(self.step[chosen], self.agent[chosen])


def risks(
    scenario: Scenario, path: EgoPath, agent: int, steps: int, foresight: Foresight = FORESIGHT
) -> Bool[np.ndarray, " step"]:
    """Whether `agent` is seen as a risk at each of the first `steps` steps, were the ego to go on as it does then."""
    return all_risks(scenario, path, [agent], steps, foresight)[agent]


def all_risks(
    scenario: Scenario, path: EgoPath, agents: Sequence[int], steps: int, foresight: Foresight = FORESIGHT
) -> Bool[np.ndarray, "agent step"]:
    """The same of several agents; nothing is said of others."""
    found = np.zeros((len(scenario.agents), steps), bool)
    pairs = _in_reach(scenario, agents, steps, foresight)
    if not len(pairs.step):
        return found
    place = _place(scenario, path, pairs)
    meets_s, meets_turn = _meeting(scenario, path, pairs, place.leads, foresight)
    meets = np.isfinite(meets_s)
    pairs, place = pairs.take(meets), place.take(meets)
    suspected = _suspected(scenario, pairs, place, meets_s[meets], meets_turn[meets], foresight)
    found[pairs.agent[suspected], pairs.step[suspected]] = True
    return found


@dataclass(frozen=True, eq=False)
class _PlaceOnPath:
    """Where agents are as seen from the ego's path."""

    ahead: Bool[np.ndarray, " pair"]  # their centres, of the ego's
    in_way: Bool[np.ndarray, " pair"]  # and their boxes reach into what the ego will sweep
    leads: Bool[np.ndarray, " pair"]  # and they run the same way

    def take(self, chosen: Bool[np.ndarray, " pair"]) -> "_PlaceOnPath":
        return _PlaceOnPath(self.ahead[chosen], self.in_way[chosen], self.leads[chosen])


def _in_reach(scenario: Scenario, agents: Sequence[int], steps: int, foresight: Foresight) -> _Pairs:
    """Those that the ego could meet at all within the time that is looked ahead."""
    tracks = scenario.tracks
    x, y, speed, valid = (values[:, :steps] for values in (tracks.x, tracks.y, tracks.speed, tracks.valid))
    size = np.array([np.hypot(agent.length, agent.width) for agent in scenario.agents])[:, None]
    reach = (speed + speed[:1]) * foresight.ego_times_s[-1] + 0.5 * (size + size[:1])
    near = valid & ((x - x[:1]) ** 2 + (y - y[:1]) ** 2 <= reach**2)
    near &= np.isin(np.arange(len(near)), agents)[:, None]
    agent, step = np.nonzero(near)
    return _Pairs(step, agent)


def _meeting(
    scenario: Scenario, path: EgoPath, pairs: _Pairs, brakes_on: Bool[np.ndarray, " pair"], foresight: Foresight
) -> tuple[Float[np.ndarray, " pair"], Float[np.ndarray, " pair"]]:
    """In how many seconds the two would first overlap, infinite where they would not, and the turn between them then.

    The ego's instants run ahead of the other's and behind them by the slack.
    """
    slack, time = foresight.slack, foresight.times_s
    other = _going_on(scenario, pairs, time, brakes_on, foresight)
    ego = _ego_going_on(scenario, path, foresight.ego_times_s, foresight)
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
    return first, np.abs(wrap(turn))


def _boxes(poses: list[np.ndarray], sizes: Float[np.ndarray, "#pair 2"]) -> Boxes:
    """Boxes of sizes [length, width] at x, y, yaw and height."""
    x, y, yaw, z = poses
    return Boxes(x, y, yaw, sizes[:, 0], sizes[:, 1], z)


def _since(scenario: Scenario, step: Int[np.ndarray, " pair"], over_s: float) -> Int[np.ndarray, " pair"]:
    """The step that lies so far back."""
    return np.maximum(step - max(round(over_s / scenario.dt), 1), 0)


def _curvature(scenario: Scenario, pairs: _Pairs, over_s: float) -> Float[np.ndarray, " pair"]:
    """Of the ways of agents [1/m] over the time just past, no tighter than a vehicle can turn."""
    tracks, since = scenario.tracks, _since(scenario, pairs.step, over_s)
    turned = wrap(tracks.yaw[pairs.agent, pairs.step] - tracks.yaw[pairs.agent, since])
    moved = tracks.speed[pairs.agent, pairs.step] * (pairs.step - since) * scenario.dt
    known = tracks.valid[pairs.agent, since] & (moved > _LEAST_TRAVEL_M)
    curvature = np.where(known, turned, 0.0) / np.where(known, moved, 1.0)
    return np.clip(curvature, -CURVATURE_LIMIT, CURVATURE_LIMIT)


def _braking(scenario: Scenario, pairs: _Pairs, over_s: float) -> Float[np.ndarray, " pair"]:
    """Of agents [m/s^2] over the time just past; 0 where they gain speed."""
    tracks, since = scenario.tracks, _since(scenario, pairs.step, over_s)
    lost = tracks.speed[pairs.agent, since] - tracks.speed[pairs.agent, pairs.step]
    known = tracks.valid[pairs.agent, since]
    return np.where(known, np.maximum(lost, 0.0), 0.0) / (np.maximum(pairs.step - since, 1) * scenario.dt)


def _further(
    scenario: Scenario,
    pairs: _Pairs,
    time: Float[np.ndarray, " ahead"],
    brakes_on: Bool[np.ndarray, " pair"],
    over_s: float,
) -> Float[np.ndarray, "pair ahead"]:
    """How far agents come [m] with their present speed; some of them brake on as they do, until they stand."""
    speed = scenario.tracks.speed[pairs.agent, pairs.step][:, None]
    braking = np.where(brakes_on, _braking(scenario, pairs, over_s), 0.0)[:, None]
    until = np.minimum(time, speed / np.maximum(braking, 1e-9))
    return (speed - 0.5 * braking * until) * until


def _going_on(
    scenario: Scenario,
    pairs: _Pairs,
    time: Float[np.ndarray, " ahead"],
    brakes_on: Bool[np.ndarray, " pair"],
    foresight: Foresight,
) -> list[Float[np.ndarray, "pair ahead"]]:
    """Agents that go on as they do: x, y, yaw and the height of where they are."""
    at, tracks = (pairs.agent, pairs.step), scenario.tracks
    x, y, yaw, z = (values[at][:, None] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z))
    further = _further(scenario, pairs, time, brakes_on, foresight.over_s)
    half_turn = 0.5 * _curvature(scenario, pairs, foresight.over_s)[:, None] * further
    chord = further * np.sinc(half_turn / np.pi)
    return [
        x + chord * np.cos(yaw + half_turn),
        y + chord * np.sin(yaw + half_turn),
        yaw + 2.0 * half_turn,
        z + 0.0 * time,
    ]


def _ego_going_on(
    scenario: Scenario, path: EgoPath, time: Float[np.ndarray, " ahead"], foresight: Foresight
) -> list[Float[np.ndarray, "step ahead"]]:
    """The ego along its path, from every step on: x, y, yaw and height."""
    steps = np.arange(scenario.tracks.steps)
    further = _further(scenario, _Pairs(steps, 0 * steps), time, steps >= 0, foresight.over_s)
    x, y, yaw = path.at(path.driven[:, None] + further)
    return [x, y, yaw, scenario.heights.of(0, x, y)]


def _suspected(
    scenario: Scenario,
    pairs: _Pairs,
    place: _PlaceOnPath,
    meets_s: Float[np.ndarray, " pair"],
    meets_turn: Float[np.ndarray, " pair"],
    foresight: Foresight,
) -> Bool[np.ndarray, " pair"]:
    """Those of which the meeting is expected, of those that would meet the ego if they went on."""
    same_way = meets_turn < FORESIGHT.along_rad
    crosses = ~same_way & (meets_turn <= FORESIGHT.against_rad)
    wanders = _wanders(scenario, pairs, ~crosses)
    leads = place.in_way & same_way & ~wanders
    brakes_hard = _braking(scenario, pairs, foresight.over_s) > CAREFUL.lead_braking_m_s2
    ahead_s = np.where(brakes_hard, foresight.ahead_s, foresight.lead_s)
    suspected = np.where(leads, meets_s <= ahead_s, crosses | place.in_way | wanders)
    return suspected & (place.ahead | ~same_way)


def _wanders(scenario: Scenario, pairs: _Pairs, asked: Bool[np.ndarray, " pair"]) -> Bool[np.ndarray, " pair"]:
    """Which of those `asked` for are out of the middle of every lane that runs their way."""
    tracks, at = scenario.tracks, (pairs.agent[asked], pairs.step[asked])
    away = from_lane_centre(scenario.road, *(values[at] for values in (tracks.x, tracks.y, tracks.yaw, tracks.z)))
    found = np.zeros(len(pairs.step), bool)
    found[asked] = away > CAREFUL.wandering_m
    return found


def _place(scenario: Scenario, path: EgoPath, pairs: _Pairs) -> _PlaceOnPath:
    tracks, at = scenario.tracks, (pairs.agent, pairs.step)
    length, width = np.array([(agent.length, agent.width) for agent in scenario.agents])[pairs.agent].T
    along, across, yaw = path.project(tracks.x[at], tracks.y[at])
    turn = tracks.yaw[at] - yaw
    breadth = 0.5 * (np.abs(np.sin(turn)) * length + np.abs(np.cos(turn)) * width)
    ahead = along > path.driven[pairs.step]
    in_way = ahead & (np.abs(across) - breadth < 0.5 * scenario.ego.width)
    return _PlaceOnPath(ahead, in_way, in_way & (np.cos(turn) > np.cos(FORESIGHT.along_rad)))
