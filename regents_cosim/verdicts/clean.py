"""Find the flaws of a crash; a strictly clean crash has none and so says something about the planner.

A pedestrian may be anywhere, turns on the spot and needs no tyres. So the road does not bind it, "into the rear"
depends on the face of the ego alone, and three checks replace those of a vehicle: a pedestrian that just stands there,
or runs into the side of the ego, says nothing about the planner. Source: the crash types that FHWA distinguishes by the
pedestrian's action ("walked into vehicle" among them: Hunter, Stutts, Pein and Cox 1996, Pedestrian and Bicycle Crash
Types of the Early 1990's), and art. 20(6) of the Vienna Convention on Road Traffic: pedestrians step onto a carriageway
only where they impede none, and do not linger there.

All checks use the tracks up to and including the step of contact, with exact boxes. `attacks.accept.acceptance` makes
the same checks on the device, by the same rules (`norms.clean`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from jaxtyping import Bool

from regents_cosim.geometry.boxes import Boxes, in_between, overlap, there_between
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.norms import clean, limits
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.collisions import Face, met_face, runs_into_side, touching
from regents_cosim.scenario.judgement import Flaw
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Scenario, Tracks, boxes_of
from regents_cosim.verdicts.leaving_road import leaves_road

_EGO = 0
_SPEED_ROUNDING_M_S = 0.01


def flaws(attacked: Scenario) -> tuple[Flaw, ...] | None:
    """The flaws of the crash of an attacked scenario, empty for a strictly clean one; None without a crash."""
    hit = attacked.crash
    if hit is None or attacked.log is None:
        return None
    crash = CrashTracks(attacked, attacked.log, hit)
    return tuple(flaw for flaw, spoils in _SPOILS.items() if spoils(crash))


@dataclass(frozen=True, eq=False)
class CrashTracks:
    """A collision with the tracks that led to it."""

    case: Scenario
    log: Tracks
    hit: Collision

    @cached_property
    def adversary(self) -> int:
        """Index of the road user that collides with the ego."""
        return self.case.index(self.hit.agent)

    @cached_property
    def boxes(self) -> Boxes:
        """Boxes [agent time] of all agents up to the contact."""
        shape, until = self.case.tracks.x.shape, self.hit.step + 1
        return Boxes(*(np.broadcast_to(values, shape)[:, :until] for values in self.case.boxes))

    @cached_property
    def valid(self) -> Bool[np.ndarray, "agent time"]:
        """Which agents are present, up to the contact."""
        return self.case.tracks.valid[:, : self.hit.step + 1]

    @cached_property
    def strangers(self) -> Bool[np.ndarray, "agent agent"]:
        """Pairs of agents that never touch in the log."""
        return np.logical_not(touches_in(self.case, self.log))

    @cached_property
    def others(self) -> Bool[np.ndarray, " agent"]:
        """All agents except the ego and the adversary."""
        return ~np.isin(np.arange(len(self.case.agents)), (_EGO, self.adversary))

    @cached_property
    def met_at(self) -> float:
        """The middle of the overlap at first touch, along the ego: 0 at its rear end, 1 at its front."""
        pair = np.array((_EGO, self.adversary))
        steps = clean.last_step(np, self.valid[pair].all(axis=0), self.hit.step)
        finer = in_between(self.boxes.at(np.ix_(pair, steps)), limits.SUB_STEPS)
        first = int(np.argmax(overlap(finer.at(0), finer.at(1))))
        x, y, yaw, length, width, _ = finer.at((slice(None), first))
        return float(clean.contact_share(np, x, y, np.cos(yaw), np.sin(yaw), 0.5 * length, 0.5 * width))

    @cached_property
    def on_foot(self) -> bool:
        """Whether the adversary is a pedestrian."""
        return self.case.agents[self.adversary].kind == "pedestrian"

    @cached_property
    def face(self) -> Face:
        """The face of the ego that the adversary meets."""
        return met_face(self.case.agents, self.case.tracks, self.adversary, self.hit.step)

    @cached_property
    def turn(self) -> float:
        """The angle between both headings at the contact [rad]."""
        yaw = self.case.tracks.yaw[:, self.hit.step]
        return abs(float(wrap(yaw[self.adversary] - yaw[_EGO])))

    def ahead(self, step: int) -> float:
        """How far the adversary's centre is ahead of the ego's [m]; negative behind it."""
        ego, other = (self.boxes.at((agent, step)) for agent in (_EGO, self.adversary))
        return float(ahead_and_left(np, other.x - ego.x, other.y - ego.y, ego.yaw)[0])


def touches_in(case: Scenario, tracks: Tracks) -> Bool[np.ndarray, "agent agent"]:
    """Which pairs of agents touch along the given tracks, at the steps or between them."""
    return touching(boxes_of(case.agents, tracks), tracks.valid, limits.SUB_STEPS)


def hardest(tracks: Tracks, agent: int, end: int, dt: float) -> float:
    """The greatest acceleration [m/s^2] of an agent before step `end` (`norms.clean.hardest`), 0 if none."""
    speed, yaw, valid = (values[agent, :end] for values in (tracks.speed, tracks.yaw, tracks.valid))
    return max(float(clean.hardest(np, speed, np.unwrap(yaw), valid, dt)), 0.0)


# --- the checks ----------------------------------------------------------------------------------


def _unattributed(crash: CrashTracks) -> bool:
    """The adversary was not controlled by the attack, or stays within 1 mm of its log."""
    now, log, agent = crash.case.tracks, crash.log, crash.adversary
    upto = slice(crash.hit.step + 1)
    both = now.valid[agent, upto] & log.valid[agent, upto]
    away = np.hypot(now.x[agent, upto] - log.x[agent, upto], now.y[agent, upto] - log.y[agent, upto])
    return not crash.hit.attributed or not np.any(both & (away > limits.MOVED_M))


def _off_road(crash: CrashTracks) -> bool:
    box, own = crash.boxes.at(crash.adversary), crash.adversary
    if crash.on_foot:
        return False
    log = boxes_of(crash.case.agents, crash.log).at(own), crash.log.valid[own]
    return leaves_road(crash.case.road, box, crash.valid[own], log)


def _hits_others(crash: CrashTracks) -> bool:
    """The adversary touches a third party that it does not touch in its log, at a step or between two."""
    near = crash.others & crash.strangers[crash.adversary]
    finer, there = in_between(crash.boxes, limits.SUB_STEPS), there_between(crash.valid, limits.SUB_STEPS)
    return bool(np.any(overlap(finer.at(crash.adversary), finer.at(near)) & there[near] & there[crash.adversary]))


def _bystanders_collide(crash: CrashTracks) -> bool:
    """Two others touch at a step that do not touch in the log, at least one of them a motor vehicle."""
    vehicle = np.array([agent.kind in VEHICLE_KINDS for agent in crash.case.agents])
    counts = crash.strangers & crash.others & crash.others[:, None] & (vehicle | vehicle[:, None])
    return bool(np.any(counts & touching(crash.boxes, crash.valid, 1)))


def _rear_ends_ego(crash: CrashTracks) -> bool:
    """The adversary, in the ego's direction if it is no pedestrian, meets the rear face of the ego."""
    if crash.on_foot:
        return crash.face == "rear"
    return bool(clean.rear_ends_ego(np.cos(crash.turn), crash.met_at, crash.ahead(crash.hit.step)))


def _from_behind(crash: CrashTracks) -> bool:
    """The adversary was behind the ego a second before and meets the rear part of it, whatever its heading by then."""
    since = int(clean.behind_since(np, crash.valid[crash.adversary], crash.hit.step, crash.case.dt))
    return clean.comes_from_behind(crash.met_at, crash.ahead(since), 0.5 * crash.case.ego.length)


def _ego_stands(crash: CrashTracks) -> bool:
    return bool(crash.case.tracks.speed[_EGO, crash.hit.step] < limits.STANDING_M_S)


def _too_hard(crash: CrashTracks) -> bool:
    """The adversary needs more grip than dry asphalt gives, and more than its log needed."""
    return not crash.on_foot and _harder_than(crash, limits.MOST_ACCEL_M_S2)


def _harder_than(crash: CrashTracks, most: float) -> bool:
    """Whether the adversary needs a higher acceleration than `most` [m/s^2], and than its log did."""
    needed = hardest(crash.case.tracks, crash.adversary, crash.hit.step + 1, crash.case.dt)
    in_log = hardest(crash.log, crash.adversary, crash.log.steps, crash.case.dt)
    return bool(clean.harder_than(np, needed, most, in_log))


def _person_stood(crash: CrashTracks) -> bool:
    """The pedestrian has not moved for a second."""
    tracks, own = crash.case.tracks, crash.adversary
    return crash.on_foot and bool(clean.stood(np, tracks.speed[own], tracks.valid[own], crash.hit.step, crash.case.dt))


def _into_side(crash: CrashTracks) -> bool:
    """The pedestrian meets a side of the ego, and closes the gap by itself."""
    case, hit = crash.case, crash.hit
    return crash.on_foot and runs_into_side(case.agents, case.tracks, crash.adversary, hit.step, case.dt)


def _beyond_walking(crash: CrashTracks) -> bool:
    """The pedestrian is faster, or accelerates harder, than people do and than it did in its log."""
    if not crash.on_foot:
        return False
    now, log = crash.case.tracks.speed[crash.adversary, : crash.hit.step + 1], crash.log.speed[crash.adversary]
    fastest = max(limits.MOST_SPEED_M_S["pedestrian"], float(log.max()))
    return bool(now.max() > fastest + _SPEED_ROUNDING_M_S) or _harder_than(crash, limits.MOST_WALKING_M_S2)


_SPOILS: MappingProxyType[Flaw, Callable[[CrashTracks], bool]] = MappingProxyType(
    {
        Flaw.UNATTRIBUTED: _unattributed,
        Flaw.OFF_ROAD: _off_road,
        Flaw.HITS_OTHERS: _hits_others,
        Flaw.BYSTANDERS_COLLIDE: _bystanders_collide,
        Flaw.REAR_ENDS_EGO: _rear_ends_ego,
        Flaw.FROM_BEHIND: _from_behind,
        Flaw.EGO_STANDS: _ego_stands,
        Flaw.TOO_HARD: _too_hard,
        Flaw.PERSON_STOOD: _person_stood,
        Flaw.INTO_SIDE: _into_side,
        Flaw.BEYOND_WALKING: _beyond_walking,
    }
)
