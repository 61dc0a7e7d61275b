"""The offences of the adversary and the ego up to the crash, each found by one small measure.

Sources: Vienna Convention on Road Traffic (1968), art. 10 (side of the road), 11 and 14 (lanes), 13 (speed and
distance), 18 (giving way); Convention on Road Signs and Signals, art. 23 (lights). The numbers are those of `limits` or
stand beside their measures. An act that a road user's log shows to the same degree is no offence.
"""

import numpy as np
import shapely
from jaxtyping import Bool, Float

from regents_cosim.geometry.boxes import corners
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.maps.levels import beyond_road
from regents_cosim.maps.roadmap import Connection, Lane, RoadMap
from regents_cosim.norms.following import time_to_collision
from regents_cosim.norms.grades import Conduct, OffenceName
from regents_cosim.norms.limits import (
    AGAINST_RAD,
    ALONG_RAD,
    ASSUMED_LIMIT_M_S,
    CUT_IN_BRAKE_M_S2,
    CUT_IN_S,
    HEAD_ON_SHARE,
    INTRUSION_M,
    LANE_CHANGE_S,
    OFF_ROAD_M,
    ONCOMING_SHARE,
    ONCOMING_STEPS,
    OVER_LIMIT,
    STANDING_M_S,
)
from regents_cosim.scenario.judgement import Law, Offence
from regents_cosim.scenario.scenario import RED, Scenario, Tracks
from regents_cosim.verdicts.law.drive import (
    AgentDrive,
    Measure,
    OffendingAct,
    agent_drive,
    gaps,
    logged,
    red_for_s,
    together_since,
)
from regents_cosim.verdicts.law.lane_pieces import lane_lines, lane_pieces
from regents_cosim.verdicts.law.lawful_ways import OFF_WAY_M
from regents_cosim.verdicts.law.needless_braking import brakes_needlessly
from regents_cosim.verdicts.law.offences_on_foot import MEASURES_ON_FOOT, stepped_in_log, unknown_on_foot
from regents_cosim.verdicts.law.oncoming import oncoming
from regents_cosim.verdicts.law.priority import gives_no_way, knows_who_gives_way

_NONE_SHARE = 0.015  # about one sample of a body
_OFF_WAY_S = 0.25
_NEAR_JUNCTION_M = 3.0  # so near to its lanes an agent is still inside the junction
_OVER_EDGE_S = 1.0
_MARKING_M = 0.12  # width of a lane marking (German RMS): a body may be on it
_CUT_IN_AGO_S = 2.0
_FOLLOW_S = 0.9  # German StVO, Bussgeldkatalog 12.6: half of half the speedometer's reading in metres
_FOLLOWS_S = 3.0
_FOLLOW_M_S = 5.0
_CAMERA_ERROR_M_S = 3.0 / 3.6  # German Mess- und Eichverordnung: 3 km/h are subtracted below 100 km/h
_SAME = 1e-6


def law_of(attacked: Scenario) -> Law | None:
    """The offences of adversary and ego up to the contact, as far as the map shows them; None without a crash."""
    hit = attacked.crash
    if hit is None:
        return None
    other = attacked.index(hit.agent)
    one, two = (agent_drive(attacked, agent, hit.step) for agent in (other, 0))
    its, own = _unknown(attacked, other), _unknown(attacked)
    unknown: dict[OffenceName, None] = dict.fromkeys((*own, *its, "gives_no_way"))
    if knows_who_gives_way(one, two):
        del unknown["gives_no_way"]
    return Law(_offences(one, two, its), _offences(two, one, own), tuple(unknown))


def is_unlawful(scenario: Scenario, moved: Tracks, agent: int, step: int) -> bool:
    """Whether an agent of a recording that meets the ego at `step` breaks the law grossly; both move along `moved`."""
    own, ego = (AgentDrive(scenario, one, moved, step) for one in (agent, 0))
    return Law(_offences(own, ego, _unknown(scenario, agent)), ()).conduct is Conduct.GROSS


def _offences(drive: AgentDrive, partner: AgentDrive, unknown: tuple[OffenceName, ...]) -> tuple[Offence, ...]:
    log, found = logged(drive.scenario, drive.agent), list[Offence]()
    dt = drive.scenario.dt
    for name, (measure, unit) in _measures(drive).items():
        act = None if name in unknown else measure(drive, partner)
        if act is None or (name == "steps_out" and stepped_in_log(drive, act)):
            continue
        before = measure(log, None)
        if before is None or act.amount > before.amount + _SAME:
            found.append(Offence(name, round(act.step * dt, 9), round(act.steps * dt, 9), round(act.amount, 3), unit))
    return tuple(found)


def acts(
    attacked: Scenario, name: OffenceName, step: int, agents: tuple[int, int], since: int = 0
) -> dict[int, OffendingAct]:
    """The acts of one kind of two agents that met at `step`, from step `since` on, whatever their logs did.

    Agents are missing where nothing was found, the data does not show it, or the offence does not apply to them.
    """
    one, two = (agent_drive(attacked, agent, step, since) for agent in agents)
    found = {agent: _act(name, *drives) for agent, drives in zip(agents, ((one, two), (two, one)), strict=True)}
    return {agent: act for agent, act in found.items() if act is not None}


def _act(name: OffenceName, drive: AgentDrive, partner: AgentDrive) -> OffendingAct | None:
    measures = _measures(drive)
    if name not in measures or name in _unknown(drive.scenario, drive.agent):
        return None
    return measures[name][0](drive, partner)


def _measures(drive: AgentDrive) -> dict[OffenceName, tuple[Measure, str]]:
    """The measures that apply to an agent; those for lanes do not apply to pedestrians."""
    return MEASURES_ON_FOOT if drive.on_foot else MEASURES


def _unknown(attacked: Scenario, agent: int = 0) -> tuple[OffenceName, ...]:
    """The offences of an agent that the map and the signals cannot show."""
    if attacked.agents[agent].kind == "pedestrian":
        return unknown_on_foot(attacked)
    road = attacked.road
    without_lanes: list[OffenceName] = ["oncoming_lanes", "against_direction", "leaves_lane", "brakes_needlessly"]
    names = list[OffenceName]() if road.lanes else without_lanes
    if not knows_lights(attacked):
        names.append("red_light")
    if not any(lane.junction for lane in road.lanes):
        names.append("leaves_way")
    if not any(np.isfinite(_limit(road, lane)) for lane in road.lanes):
        names.append("speeding")
        names.append("over_limit")
    if not road.lanes:
        names.append("gives_no_way")
    return tuple(names)


def knows_lights(attacked: Scenario) -> bool:
    """Whether all lights are recorded: simulators have no others; a log without any may have left them out."""
    road, signals = attacked.road, {signal.id for signal in attacked.signals}
    named = {link.signal for link in road.connections if link.signal}
    simulated = road.sumo_net is not None or attacked.provenance.source == "highway"
    return bool(road.lanes) and named <= signals and (simulated or bool(signals))


def _limit(road: RoadMap, lane: Lane) -> float:
    """The speed limit of a lane [m/s], infinite where the log named none."""
    return np.inf if road.sumo_net is None and lane.speed_limit == ASSUMED_LIMIT_M_S else lane.speed_limit


# --- the side of the road ----------------------------------------------------------------------------


def _oncoming_lanes(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """Its body is on purely oncoming lanes: more than 17 % at 2 steps or more, or 5 % in a head-on crash."""
    share = drive.oncoming_share
    act = drive.lasting(share > ONCOMING_SHARE, share, ONCOMING_STEPS)
    if act is not None or partner is None or share[-1] <= HEAD_ON_SHARE:
        return act
    if _turn(drive, partner) <= AGAINST_RAD or partner.oncoming_share[-1] > _NONE_SHARE:
        return None
    begin = len(share) - int(np.argmin(np.append(share[::-1] > HEAD_ON_SHARE, False)))
    return OffendingAct(int(drive.steps[begin]), len(share) - begin, float(share[begin:].max()))


def _turn(drive: AgentDrive, partner: AgentDrive) -> float:
    """The angle between the headings of the two at the crash [rad]."""
    return abs(float(wrap(drive.yaw[-1] - partner.yaw[-1])))


def _against_direction(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """Its centre is on purely oncoming lanes at 2 steps or more, while it moves; amount: distance driven there."""
    begin, end = drive.longest(against_direction(drive))
    moved = float(drive.moved_m[begin + 1 : end].sum())
    lasts = end - begin >= ONCOMING_STEPS and moved > _SAME
    return OffendingAct(int(drive.steps[begin]), end - begin, moved) if lasts else None


def against_direction(drive: AgentDrive) -> Bool[np.ndarray, " time"]:
    """At which steps its centre is on lanes that run only the other way."""
    return oncoming(drive.scenario.road, drive.centre, drive.yaw, np.asarray(drive.box.z), drive.lawful)


def _off_road(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """A corner that has been on the road is more than 0.3 m off it."""
    beyond = beyond_road(drive.scenario.road, corners(drive.box), np.asarray(drive.box.z)[:, None])
    was_on = np.logical_or.accumulate(beyond <= OFF_ROAD_M, axis=0)
    worst = np.where(was_on, beyond, 0.0).max(axis=1)
    return drive.lasting(worst > OFF_ROAD_M, worst, 1)


def _leaves_way(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """Inside a junction its centre is more than 1.6 m from all ways that begin at its approach, for over 0.25 s."""
    if drive.lawful is None:
        return None
    inside = _inside_junction(drive)
    if not inside.any():
        return None
    lines = lane_lines(drive.scenario.road)
    own = shapely.MultiLineString([lines[name] for name in sorted(drive.lawful)])
    off = np.where(inside, shapely.distance(own, shapely.points(drive.centre)), 0.0)
    return drive.lasting(off > OFF_WAY_M, off, int(_OFF_WAY_S / drive.scenario.dt) + 1)


def _inside_junction(drive: AgentDrive) -> Bool[np.ndarray, " time"]:
    """At which steps its centre is in or near ways through a junction, and in no other lane."""
    road = drive.scenario.road
    junction = np.array([lane.junction for lane in road.lanes])
    at = lane_pieces(road).under(drive.centre, np.asarray(drive.box.z), np.where(junction, _NEAR_JUNCTION_M, 0.0))
    ways = np.bincount(at.point, junction[at.lane], minlength=len(drive.centre))
    return (ways > 0) & (np.bincount(at.point, minlength=len(drive.centre)) == ways)


# --- lights, speed, lanes ----------------------------------------------------------------------------


def _red_light(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """Its front passes the stop line of its movement on red; amount: how long the light had been red."""
    return next(iter(red_lights(drive)), None)


def red_lights(drive: AgentDrive) -> list[OffendingAct]:
    """Every movement whose stop line its front passes on red, once each; amount: how long it had been red [s].

    Where its front comes onto no lane behind the line, all movements from there count, if all of them show red.
    """
    scenario, found = drive.scenario, dict[Connection, OffendingAct]()
    exits = scenario.road.exits
    passed = [
        (step, [link for link in exits[before.id] if link.target == after.id]) for step, before, after in drive.entered
    ]
    passed += [(step, list(exits[before.id])) for step, before in drive.passed_ends]
    for step, links in sorted(passed, key=lambda one: one[0]):
        if step >= drive.since and links and all(scenario.shows(link.signal, link.link, step) in RED for link in links):
            found.setdefault(links[0], OffendingAct(step, 1, red_for_s(scenario, links[0], step)))
    return list(found.values())


def _speeding(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It is faster than 1.2 times the limit; amount: the excess over the limit."""
    over = drive.speed - _limits(drive)
    holds = drive.speed > OVER_LIMIT * _limits(drive)
    return drive.lasting(holds, over, 1)


def _over_limit(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It is faster than the limit by more than a speed camera may err; amount: the excess over the limit."""
    over = drive.speed - _limits(drive)
    return drive.lasting(over > _CAMERA_ERROR_M_S, over, 1)


def _limits(drive: AgentDrive) -> Float[np.ndarray, " time"]:
    """The limit at each step [m/s]; inside junctions, which have no signs, the higher of those before and behind."""
    road, count = drive.scenario.road, len(drive.centre)
    limit = np.array([-np.inf if lane.junction else _limit(road, lane) for lane in road.lanes])
    found = np.full(count, -np.inf)
    np.maximum.at(found, drive.own.point, limit[drive.own.lane])
    known = np.flatnonzero(found > 0.0)
    if not len(known):
        return np.full(count, np.inf)
    behind = known[np.clip(np.searchsorted(known, np.arange(count), side="right") - 1, 0, None)]
    ahead = known[np.clip(np.searchsorted(known, np.arange(count)), None, len(known) - 1)]
    return np.maximum(found[behind], found[ahead])


def _leaves_lane(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It is more than 0.3 m over the edge of its lane for a second or more, and does not change to the lane beside.

    Who stands there for a second, or takes longer than five, does not change lanes either.
    """
    own, over, dt = drive.own, _over_edge(drive), drive.scenario.dt
    across = over > INTRUSION_M
    for least_s, holds in ((LANE_CHANGE_S, across), (_OVER_EDGE_S, across & (drive.speed < STANDING_M_S))):
        act = drive.lasting(holds, over, max(round(least_s / dt), 1))
        if act is not None:
            return act
    begin, end = drive.longest(across)
    if (end - begin) * dt < _OVER_EDGE_S:
        return None
    first, last = (set(own.lane[own.point == at].tolist()) for at in (begin, end - 1))
    return OffendingAct(int(drive.steps[begin]), end - begin, float(over[begin:end].max())) if first & last else None


def _over_edge(drive: AgentDrive) -> Float[np.ndarray, " time"]:
    """How far [m] its body is over the edge of its lane; 0 in junctions, and where it is on no lane."""
    own, road = drive.own, drive.scenario.road
    width = np.array([lane.width for lane in road.lanes])
    junction = np.array([lane.junction for lane in road.lanes])
    over = np.full(len(drive.centre), np.inf)
    edge = np.abs(own.left) + 0.5 * drive.scenario.agents[drive.agent].width - 0.5 * width[own.lane]
    np.minimum.at(over, own.point, np.where(junction[own.lane], 0.0, edge))
    over[~np.isfinite(over)] = 0.0
    return over


# --- towards the other -------------------------------------------------------------------------------


def _unsafe_cut_in(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It cuts in nearer ahead of the other than UN R157 takes for avoidable; amount: the missing seconds.

    Crossing a marking into another that is beside it leaves no time at all, however little it is across.
    """
    if partner is None or _turn(drive, partner) > ALONG_RAD:
        return None
    attacked, (leader, follower), last = drive.scenario, (drive.agent, partner.agent), drive.last
    together = together_since(attacked.tracks, (leader, follower), last)
    first = max(last - round(_CUT_IN_AGO_S / attacked.dt), together)
    between = [gaps(attacked, follower, leader, step) for step in range(first, last)]
    came = [i for i, (_, across) in enumerate(between) if across > 0.0]
    step = first + (came[-1] + 1 if came else len(between))  # of the contact, where none is in the other's way before
    if not _moved_into(drive, partner, first, step):
        return None
    along = float(gaps(attacked, follower, leader, step)[0])
    closing = float(attacked.tracks.speed[follower, step] - attacked.tracks.speed[leader, step])
    needed = max(closing, 0.0) / (2.0 * CUT_IN_BRAKE_M_S2) + CUT_IN_S
    if along <= 0.0:
        over = _over_edge(drive)[drive.steps >= first]
        return OffendingAct(step, 1, needed) if (over > _MARKING_M).any() else None
    ttc = float(time_to_collision(along, closing))
    return OffendingAct(step, 1, needed - ttc) if step != last and ttc < needed else None


def _moved_into(drive: AgentDrive, partner: AgentDrive, first: int, step: int) -> bool:
    """Whether it moved further across the other's heading than the other did itself."""
    tracks = drive.tracks
    yaw = float(tracks.yaw[partner.agent, first])
    moved = []
    for agent in (drive.agent, partner.agent):
        dx, dy = (float(v[agent, step] - v[agent, first]) for v in (tracks.x, tracks.y))
        moved.append(abs(ahead_and_left(np, dx, dy, yaw)[1]))
    return bool(moved[0] > moved[1])


def _tailgating(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It is less than 0.9 s behind the other in its lane, for 3 s or more; amount: the missing seconds."""
    if partner is None:
        return None
    attacked = drive.scenario
    both = attacked.tracks.valid[partner.agent, drive.steps]
    along, across = np.full((2, len(drive.steps)), np.inf)
    along[both], across[both] = np.array(
        [gaps(attacked, drive.agent, partner.agent, int(s)) for s in drive.steps[both]]
    ).T
    speed = drive.speed
    near = (across < 0.0) & (along > 0.0) & (along < _FOLLOW_S * speed) & (speed > _FOLLOW_M_S)
    begin, end = drive.longest(near)
    if (end - begin) * attacked.dt < _FOLLOWS_S:
        return None
    return OffendingAct(
        int(drive.steps[begin]), end - begin, _FOLLOW_S - float((along / np.maximum(speed, _SAME))[begin:end].min())
    )


MEASURES: dict[OffenceName, tuple[Measure, str]] = {
    "oncoming_lanes": (_oncoming_lanes, "share of its body"),
    "against_direction": (_against_direction, "m"),
    "red_light": (_red_light, "s of red"),
    "leaves_way": (_leaves_way, "m from its way"),
    "off_road": (_off_road, "m"),
    "speeding": (_speeding, "m/s over the limit"),
    "gives_no_way": (gives_no_way, "s ahead of the other"),
    "unsafe_cut_in": (_unsafe_cut_in, "s too few"),
    "leaves_lane": (_leaves_lane, "m over the edge"),
    "tailgating": (_tailgating, "s too near"),
    "over_limit": (_over_limit, "m/s over the limit"),
    "brakes_needlessly": (brakes_needlessly, "m/s2"),
}
