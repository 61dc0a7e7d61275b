"""Fault: who is to blame for a collision, by a table of rules; the first that matches decides.

The safe distance and the duty of whoever cuts in follow RSS, Responsibility-Sensitive Safety (Shalev-Shwartz, Shammah
and Shashua 2017, "On a formal model of safe and scalable self-driving cars"); the rest follows the Vienna Conventions
of 1968 on Road Traffic and on Road Signs and Signals. No rule decides what the data does not tell, such as
who had priority at a crossing without lights.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
import shapely

from regents_cosim.boxes import Boxes, corners, same_level
from regents_cosim.frames import wrap
from regents_cosim.levels import beyond_road, height_on
from regents_cosim.limits import ALONG_RAD, OFF_ROAD_M, STANDING_M_S
from regents_cosim.planners.lane_matching import match_lanes
from regents_cosim.roadmap import Lane
from regents_cosim.scenario import Collision, Fault, Scenario

Blamed = Literal["ego", "adversary", "both", "nobody"]


@dataclass(frozen=True)
class SafeDistance:
    """RSS's parameters: the reaction time and accelerations that a careful driver may be expected to have."""

    response_s: float = 0.5  # how long the follower may go on accelerating before it brakes
    accel: float = 2.0  # [m/s^2] the follower's meanwhile
    brake: float = 4.0  # [m/s^2] that the follower is at least capable of
    hardest_brake: float = 8.0  # [m/s^2] of the leader


def safe_distance(follower: float, leader: float, limits: SafeDistance = SafeDistance()) -> float:
    """The gap [m] that a follower needs at these speeds [m/s] so as never to touch a leader that brakes its hardest.

    Source: RSS, Definition 1 and Lemma 2: v t + a t^2 / 2 + (v + a t)^2 / (2 b) - w^2 / (2 c), at least 0, with the
    response time t, the follower's speed v, acceleration a and braking b, the leader's speed w and braking c.
    """
    t, gained = limits.response_s, follower + limits.response_s * limits.accel
    way = follower * t + 0.5 * limits.accel * t**2 + gained**2 / (2.0 * limits.brake)
    return max(way - leader**2 / (2.0 * limits.hardest_brake), 0.0)


# --- what a rule may ask ---------------------------------------------------------------------------

_EGO = 0
_MERGED_S = 2.0  # whoever came into the lane no longer ago has cut in
_STOOD_S = 1.0
_AGAINST_RAD = np.deg2rad(135.0)


@dataclass(frozen=True, eq=False)
class Crash:
    """The collision of a scenario, and what led to it."""

    scenario: Scenario
    hit: Collision

    @cached_property
    def other(self) -> int:
        """Index of whom the ego met."""
        return next(i for i, agent in enumerate(self.scenario.agents) if agent.id == self.hit.agent)

    @cached_property
    def before(self) -> int:
        """The last step without contact."""
        return max(self.hit.step - 1, 0)

    def name(self, agent: int) -> str:
        """In words."""
        return "the ego" if agent == _EGO else "the adversary"

    def speed(self, agent: int, step: int) -> float:
        """Speed [m/s]."""
        return float(self.scenario.tracks.speed[agent, step])

    def turn(self, step: int) -> float:
        """By how much the two headings differ [rad]."""
        yaw = self.scenario.tracks.yaw
        return abs(float(wrap(yaw[self.other, step] - yaw[_EGO, step])))

    def gaps(self, follower: int, leader: int, step: int) -> tuple[float, float]:
        """Bumper to bumper [m] along the follower's heading, and side to side [m]; negative where they overlap."""
        tracks, agents = self.scenario.tracks, self.scenario.agents
        dx, dy = (float(v[leader, step] - v[follower, step]) for v in (tracks.x, tracks.y))
        yaw = float(tracks.yaw[follower, step])
        ahead, left = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
        turn = float(wrap(tracks.yaw[leader, step] - yaw))
        cos, sin = abs(np.cos(turn)), abs(np.sin(turn))
        one, two = agents[follower], agents[leader]
        along = 0.5 * (one.length + two.length * cos + two.width * sin)
        across = 0.5 * (one.width + two.length * sin + two.width * cos)
        return ahead - along, abs(left) - across

    @cached_property
    def lately(self) -> int:
        """The step 2 s before the last one without contact, or the first at which both are there."""
        there = self.scenario.tracks.valid[[_EGO, self.other]].all(axis=0)
        return max(self.before - round(_MERGED_S / self.scenario.dt), int(np.argmax(there)))

    def cut_in(self, follower: int, leader: int) -> int | None:
        """The step, in the last 2 s, at which two that were side by side came into one lane; None if it was earlier."""
        apart = [k for k in range(self.lately, self.before + 1) if self.gaps(follower, leader, k)[1] > 0.0]
        return min(apart[-1] + 1, self.before) if apart else None

    def drifted(self, agent: int) -> float:
        """How far [m] the agent moved across its road lately."""
        steps = np.arange(self.lately, self.before)
        road = np.array([self._road_heading(agent, int(step)) for step in steps])
        dx, dy = (
            np.diff(v[agent, self.lately : self.before + 1]) for v in (self.scenario.tracks.x, self.scenario.tracks.y)
        )
        return abs(float(np.sum(dy * np.cos(road) - dx * np.sin(road))))

    def off_road(self, agent: int) -> float:
        """How far [m] its furthest corner is off the road at the crash."""
        at = [np.broadcast_to(v, self.scenario.tracks.x.shape)[agent, self.hit.step] for v in self.scenario.boxes]
        box = Boxes(*at)
        return float(beyond_road(self.scenario.road, corners(box), box.z).max())

    def lanes(self, agent: int) -> list[Lane | None]:
        """The lane under its front at every valid step up to the crash."""
        steps = np.flatnonzero(self.scenario.tracks.valid[agent, : self.hit.step + 1])
        return match_lanes(self.scenario.road, self._front(agent), self.scenario.tracks.z[agent, steps])

    def wrong_way(self, agent: int) -> float | None:
        """By how much [rad] it drives against the only lanes there, at the crash; None where it does not."""
        at, lanes = self._lanes_at(agent, self.hit.step)
        lanes = [lane for lane in lanes if shapely.LineString(lane.centre).distance(at) < 0.5 * lane.width]
        yaw = self.scenario.tracks.yaw[agent, self.hit.step]
        turns = [abs(float(wrap(_heading(lane, at) - yaw))) for lane in lanes]
        return min(turns) if turns and min(turns) > _AGAINST_RAD else None

    def red_light(self, agent: int) -> tuple[str, float] | None:
        """The signal that it passed on red, and when [s]; None where it did not."""
        matched = self.lanes(agent)
        steps = np.flatnonzero(self.scenario.tracks.valid[agent, : self.hit.step + 1])
        lights = {light.id: light for light in self.scenario.signals}
        for (before, after), step in zip(itertools.pairwise(matched), steps[1:], strict=True):
            if before is None or after is None or before is after:
                continue
            for link in self.scenario.road.exits[before.id]:
                light = lights.get(link.signal) if link.signal and link.target == after.id else None
                if light is not None and light.letters(int(step))[link.link] in "ru":
                    return light.id, float(step * self.scenario.dt)
        return None

    def _road_heading(self, agent: int, step: int) -> float:
        """Heading [rad] of the nearest lane that runs the agent's way, or its own where there is none."""
        at, lanes = self._lanes_at(agent, step)
        yaw = float(self.scenario.tracks.yaw[agent, step])
        along = [lane for lane in lanes if abs(float(wrap(_heading(lane, at) - yaw))) < ALONG_RAD]
        return _heading(min(along, key=lambda lane: shapely.LineString(lane.centre).distance(at)), at) if along else yaw

    def _lanes_at(self, agent: int, step: int) -> tuple[shapely.Point, list[Lane]]:
        """Where the agent is, and the lanes of its level near it."""
        road, tracks = self.scenario.road, self.scenario.tracks
        x, y, z = (float(values[agent, step]) for values in (tracks.x, tracks.y, tracks.z))
        at = shapely.Point(x, y)
        near = [road.lanes[i] for i in road.centre_lines.query(at, predicate="dwithin", distance=_LANE_REACH_M)]
        return at, [lane for lane in near if same_level(height_on(lane, np.array([x, y])), z)]

    def _front(self, agent: int) -> np.ndarray:
        tracks = self.scenario.tracks
        steps = np.flatnonzero(tracks.valid[agent, : self.hit.step + 1])
        half, yaw = 0.5 * self.scenario.agents[agent].length, tracks.yaw[agent, steps]
        return np.stack(
            [tracks.x[agent, steps] + half * np.cos(yaw), tracks.y[agent, steps] + half * np.sin(yaw)], axis=-1
        )


_LANE_REACH_M = 5.0


def _heading(lane: Lane, at: shapely.Point) -> float:
    """Heading of a lane where it is nearest [rad]."""
    line = shapely.LineString(lane.centre)
    s = min(float(line.project(at)), line.length - 0.5)
    (x0, y0), (x1, y1) = (line.interpolate(max(s + ahead, 0.0)).coords[0] for ahead in (0.0, 0.5))
    return float(np.arctan2(y1 - y0, x1 - x0))


# --- the rules -------------------------------------------------------------------------------------


class Verdict(NamedTuple):
    """What a rule found."""

    at_fault: Blamed
    reason: str


@dataclass(frozen=True)
class Rule:
    """One row of the table."""

    name: str
    source: str
    decide: Callable[[Crash], Verdict | None]  # None where the rule does not apply


def _red_light(crash: Crash) -> Verdict | None:
    passed = {agent: crash.red_light(agent) for agent in (_EGO, crash.other)}
    said = [
        f"{crash.name(agent)} passed signal {found[0]} on red at {found[1]:.1f} s"
        for agent, found in passed.items()
        if found
    ]
    if not said:
        return None
    blamed: Blamed = "both" if len(said) == 2 else "ego" if passed[_EGO] else "adversary"
    return Verdict(blamed, " and ".join(said))


def _off_road(crash: Crash) -> Verdict | None:
    off = {agent: crash.off_road(agent) for agent in (_EGO, crash.other)}
    return _by_each(crash, {a: f"{m:.1f} m off the road" for a, m in off.items() if m > OFF_ROAD_M})


def _wrong_way(crash: Crash) -> Verdict | None:
    against = {agent: crash.wrong_way(agent) for agent in (_EGO, crash.other)}
    return _by_each(
        crash,
        {
            a: f"{np.rad2deg(turn):.0f} degrees off the direction of its lane at {crash.speed(a, crash.before):.1f} m/s"
            for a, turn in against.items()
            if turn is not None and crash.speed(a, crash.before) > STANDING_M_S
        },
    )


def _by_each(crash: Crash, found: dict[int, str]) -> Verdict | None:
    """Blame those of whom something was found."""
    if not found:
        return None
    blamed: Blamed = "both" if len(found) == 2 else "ego" if _EGO in found else "adversary"
    return Verdict(blamed, " and ".join(f"{crash.name(agent)} was {what}" for agent, what in found.items()))


def _cut_in(crash: Crash) -> Verdict | None:
    """Somebody came into the lane of somebody behind, closer than the safe distance."""
    found = _followed(crash)
    if found is None:
        return None
    follower, leader = found
    since = crash.cut_in(follower, leader)
    if since is None or crash.drifted(leader) <= crash.drifted(follower):
        return None
    gap, _ = crash.gaps(follower, leader, since)
    speeds = crash.speed(follower, since), crash.speed(leader, since)
    needed = safe_distance(*speeds)
    if gap >= needed:
        return None
    when = since * crash.scenario.dt
    return Verdict(
        "ego" if leader == _EGO else "adversary",
        f"{crash.name(leader)} cut in at {when:.1f} s with a gap of {max(gap, 0.0):.1f} m, safe are {needed:.1f} m "
        f"({crash.name(follower)} at {speeds[0]:.1f} m/s, {crash.name(leader)} at {speeds[1]:.1f} m/s)",
    )


def _side_swipe(crash: Crash) -> Verdict | None:
    """Two side by side: whoever moved sideways more."""
    if crash.turn(crash.before) > ALONG_RAD or crash.hit.kind != "side_swipe":
        return None
    moved = {agent: crash.drifted(agent) for agent in (_EGO, crash.other)}
    seconds = (crash.before - crash.lately) * crash.scenario.dt
    said = f"in {seconds:.1f} s the ego moved {moved[_EGO]:.1f} m sideways, the adversary {moved[crash.other]:.1f} m"
    if max(moved.values()) < _SIDEWAYS_M:
        return None
    if min(moved.values()) >= _SIDEWAYS_M:
        return Verdict("both", said)
    return Verdict("ego" if moved[_EGO] > moved[crash.other] else "adversary", said)


_SIDEWAYS_M = 0.5


def _rear_end(crash: Crash) -> Verdict | None:
    """Whoever follows keeps the distance, and stops before whoever stands."""
    found = _followed(crash)
    if found is None:
        return None
    follower, leader = found
    since = crash.lately
    gap, _ = crash.gaps(follower, leader, since)
    v, w = crash.speed(follower, since), crash.speed(leader, since)
    ran = f"{crash.name(follower)} ran into {crash.name(leader)} at {crash.speed(follower, crash.before):.1f} m/s, "
    if crash.speed(leader, since) < STANDING_M_S:
        ran += f"which stood {max(gap, 0.0):.1f} m ahead of it"
    else:
        ran += f"which drove {crash.speed(leader, crash.before):.1f} m/s;"
        ran += f" {(crash.before - since) * crash.scenario.dt:.1f} s before the gap was {max(gap, 0.0):.1f} m"
        ran += f", safe were {safe_distance(v, w):.1f} m"
    return Verdict("ego" if follower == _EGO else "adversary", ran)


def _followed(crash: Crash) -> tuple[int, int] | None:
    """(follower, leader) just before a collision of two that drove the same way, one behind the other."""
    if crash.turn(crash.before) > ALONG_RAD:
        return None
    for follower, leader in ((_EGO, crash.other), (crash.other, _EGO)):
        along, across = crash.gaps(follower, leader, crash.before)
        if along > across:
            return follower, leader
    return None


def _standing(crash: Crash) -> Verdict | None:
    """One of them had stood for a while, wherever the other one came from."""
    first = max(crash.before - round(_STOOD_S / crash.scenario.dt), 0)
    speeds = crash.scenario.tracks.speed[[_EGO, crash.other], first : crash.before + 1]
    stood = [bool(np.all(own < STANDING_M_S)) for own in speeds]
    if all(stood) or not any(stood):
        return None
    mover, target = (crash.other, _EGO) if stood[0] else (_EGO, crash.other)
    ran = f"{crash.name(mover)} ran into {crash.name(target)} at {crash.speed(mover, crash.before):.1f} m/s, "
    return Verdict("ego" if mover == _EGO else "adversary", f"{ran}which had stood for {_STOOD_S:.1f} s")


def _unclear(crash: Crash) -> Verdict:
    v, w = (crash.speed(agent, crash.before) for agent in (_EGO, crash.other))
    return Verdict(
        "nobody",
        f"{crash.hit.kind} at {crash.hit.time_s:.1f} s, the ego at {v:.1f} m/s, the adversary at {w:.1f} m/s: "
        "the data does not tell who had to give way",
    )


RULES: tuple[Rule, ...] = (
    Rule(
        "red_light", "Signs and Signals, art. 23(1)(a)(ii): a red light means that traffic may not proceed", _red_light
    ),
    Rule("off_road", "Road Traffic, art. 10: position on the carriageway", _off_road),
    Rule("wrong_way", "Road Traffic, art. 10: on the side of its direction of traffic", _wrong_way),
    Rule("cut_in", "Road Traffic, art. 11 and 14; RSS: do not cut in recklessly", _cut_in),
    Rule("side_swipe", "Road Traffic, art. 14: changing lanes must endanger nobody", _side_swipe),
    Rule("rear_end", "Road Traffic, art. 13(5): keep a sufficient distance; RSS", _rear_end),
    Rule("standing", "Road Traffic, art. 13(1): be able to stop before any foreseeable obstruction", _standing),
    Rule("unclear", "Road Traffic, art. 18 needs signs and priorities, which no case holds", _unclear),
)


def fault(attacked: Scenario) -> Fault | None:
    """Who is to blame for the collision of an attacked scenario, by the first of RULES that applies; None without."""
    hit = attacked.attack.collision if attacked.attack and attacked.attack.outcome == "collision" else None
    if hit is None:
        return None
    crash = Crash(attacked, hit)
    for rule in RULES:
        verdict = rule.decide(crash)
        if verdict is not None:
            return Fault(verdict.at_fault, rule.name, verdict.reason)
    raise AssertionError("the last rule always applies")
