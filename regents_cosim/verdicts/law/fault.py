"""Fault: who is to blame for a collision, by a table of rules, of which the first that applies decides.

The safe distance and the duty of an agent that cuts in follow RSS, Responsibility-Sensitive Safety (Shalev-Shwartz,
Shammah and Shashua 2017, "On a formal model of safe and scalable self-driving cars"); the rest follows the Vienna
Conventions of 1968 on Road Traffic and on Road Signs and Signals. `offences` measures what the two did against the law,
whatever their logs did. No rule decides what the data does not show, such as the priority at a crossing of a map
without priorities.

Most rules are about wheels and lanes, so a collision with a pedestrian has its own table: a driver has to stop for what
can be seen in time (Road Traffic, art. 13(1) and 21); a pedestrian keeps to crossings and their lights, and steps onto
the carriageway only where that impedes no one (art. 20(6)).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from regents_cosim.geometry.frames import wrap
from regents_cosim.norms.limits import AGAINST_RAD, ALONG_RAD, STANDING_M_S, STOOD_S, safe_distance, steps_of
from regents_cosim.routes.give_way import TURNED_RAD
from regents_cosim.scenario.collisions import runs_into_side
from regents_cosim.scenario.judgement import Blamed, Fault
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.law.crash_history import EGO, CrashHistory
from regents_cosim.verdicts.law.walking_ground import ground_of

_STRAIGHT_RAD = np.deg2rad(12.0)


class RuleFinding(NamedTuple):
    """The finding of a rule that applies."""

    at_fault: Blamed
    reason: str


@dataclass(frozen=True)
class Rule:
    """One row of the table of rules."""

    name: str
    source: str
    decide: Callable[[CrashHistory], RuleFinding | None]  # None where the rule does not apply


def _red_light(crash: CrashHistory) -> RuleFinding | None:
    dt = crash.scenario.dt
    passed = crash.acts("red_light")
    return _by_each(crash, {agent: f"passed a red light at {act.step * dt:.1f} s" for agent, act in passed.items()})


def _off_road(crash: CrashHistory) -> RuleFinding | None:
    off = crash.late_acts("off_road")
    return _by_each(crash, {agent: f"was {act.amount:.1f} m off the road" for agent, act in off.items()})


def _wrong_way(crash: CrashHistory) -> RuleFinding | None:
    """Its body is where only oncoming traffic may be: more than 17 % of it, or 5 % in a head-on collision."""
    over, against = crash.late_acts("oncoming_lanes"), crash.late_acts("against_direction")
    said = {agent: f"was against its direction for {act.amount:.1f} m" for agent, act in against.items()}
    said |= {a: f"had {100 * act.amount:.0f} % of its body in oncoming lanes" for a, act in over.items()}
    return _by_each(crash, said)


def _gives_way(crash: CrashHistory) -> RuleFinding | None:
    failed = crash.acts("gives_no_way")
    dt = crash.scenario.dt
    return _by_each(
        crash, {a: f"had to give way and entered the junction at {act.step * dt:.1f} s" for a, act in failed.items()}
    )


def _leaves_way(crash: CrashHistory) -> RuleFinding | None:
    off = crash.late_acts("leaves_way")
    return _by_each(crash, {a: f"was {act.amount:.1f} m off its way through the junction" for a, act in off.items()})


def _turns_across(crash: CrashHistory) -> RuleFinding | None:
    """One of two agents that came towards each other turned across the way of the other, which went straight on."""
    turned = {agent: crash.turned(agent) for agent in (EGO, crash.other)}
    yaw = crash.scenario.tracks.yaw[:, crash.before]
    came = abs(float(wrap(yaw[EGO] - turned[EGO] - yaw[crash.other] + turned[crash.other])))
    across = [agent for agent, turn in turned.items() if abs(turn) > TURNED_RAD]
    straight = [agent for agent, turn in turned.items() if abs(turn) < _STRAIGHT_RAD]
    if came < AGAINST_RAD or len(across) != 1 or len(straight) != 1:
        return None
    return _by_each(
        crash, {across[0]: f"turned {np.rad2deg(abs(turned[across[0]])):.0f} degrees across the other's way"}
    )


def _leaves_lane(crash: CrashHistory) -> RuleFinding | None:
    over = crash.late_acts("leaves_lane")
    said = {agent: f"was {act.amount:.1f} m over the edge of its lane" for agent, act in over.items()}
    return _by_each(crash, said) if len(said) == 1 else None


def _speeding(crash: CrashHistory) -> RuleFinding | None:
    fast = crash.late_acts("speeding")
    said = {agent: f"was {act.amount:.1f} m/s over the limit" for agent, act in fast.items()}
    return _by_each(crash, said) if len(said) == 1 else None


def _by_each(crash: CrashHistory, found: dict[int, str]) -> RuleFinding | None:
    """Blame the agents for which something was found."""
    if not found:
        return None
    blamed: Blamed = "both" if len(found) == 2 else "ego" if EGO in found else "adversary"
    return RuleFinding(blamed, " and ".join(f"{crash.name(agent)} {what}" for agent, what in found.items()))


def _cut_in(crash: CrashHistory) -> RuleFinding | None:
    """One agent came into the lane of the other, in front of it, at less than the safe distance."""
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
    return RuleFinding(
        "ego" if leader == EGO else "adversary",
        f"{crash.name(leader)} cut in at {when:.1f} s with a gap of {max(gap, 0.0):.1f} m, safe are {needed:.1f} m "
        f"({crash.name(follower)} at {speeds[0]:.1f} m/s, {crash.name(leader)} at {speeds[1]:.1f} m/s)",
    )


def _side_swipe(crash: CrashHistory) -> RuleFinding | None:
    """Of two agents that drove side by side in the same direction, the one that moved sideways more is to blame."""
    if crash.turn(crash.lately) > ALONG_RAD or crash.hit.collision_type not in ("side_swipe", "t_bone"):
        return None
    moved = {agent: crash.drifted(agent) for agent in (EGO, crash.other)}
    seconds = (crash.before - crash.lately) * crash.scenario.dt
    said = f"in {seconds:.1f} s the ego moved {moved[EGO]:.1f} m sideways, the adversary {moved[crash.other]:.1f} m"
    if max(moved.values()) < _SIDEWAYS_M:
        return None
    if min(moved.values()) >= _SIDEWAYS_M:
        return RuleFinding("both", said)
    return RuleFinding("ego" if moved[EGO] > moved[crash.other] else "adversary", said)


_SIDEWAYS_M = 0.5


def _rear_end(crash: CrashHistory) -> RuleFinding | None:
    """A follower has to keep its distance, and to stop before a standing vehicle."""
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
    return RuleFinding("ego" if follower == EGO else "adversary", ran)


def _followed(crash: CrashHistory) -> tuple[int, int] | None:
    """The pair (follower, leader) just before a collision of two that drove in the same direction; None otherwise."""
    if crash.turn(crash.before) > ALONG_RAD:
        return None
    for follower, leader in ((EGO, crash.other), (crash.other, EGO)):
        along, across = crash.gaps(follower, leader, crash.before)
        if along > across:
            return follower, leader
    return None


def _standing(crash: CrashHistory) -> RuleFinding | None:
    """One of them had stood for a while, wherever the other came from."""
    first = max(crash.before - int(steps_of(np, STOOD_S, crash.scenario.dt)), 0)
    speeds = crash.scenario.tracks.speed[[EGO, crash.other], first : crash.before + 1]
    stood = [bool(np.all(own < STANDING_M_S)) for own in speeds]
    if all(stood) or not any(stood):
        return None
    mover, target = (crash.other, EGO) if stood[0] else (EGO, crash.other)
    ran = f"{crash.name(mover)} ran into {crash.name(target)} at {crash.speed(mover, crash.before):.1f} m/s, "
    return RuleFinding("ego" if mover == EGO else "adversary", f"{ran}which had stood for {STOOD_S:.1f} s")


def _unclear(crash: CrashHistory) -> RuleFinding:
    v, w = (crash.speed(agent, crash.before) for agent in (EGO, crash.other))
    return RuleFinding(
        "nobody",
        f"{crash.hit.collision_type} at {crash.hit.time_s:.1f} s, the ego at {v:.1f} m/s, the adversary at {w:.1f} "
        "m/s: the data does not tell who had to give way",
    )


# --- pedestrians -----------------------------------------------------------------------------------


def _breaks_law(crash: CrashHistory) -> RuleFinding | None:
    """The driver passed a red light or was off the road, or the pedestrian crossed on red, or both."""
    dt, off = crash.scenario.dt, crash.late_acts("off_road").get(EGO)
    said = {} if off is None else {EGO: f"was {off.amount:.1f} m off the road"}
    for agent, act in crash.acts("red_light").items():
        what = "passed a red light" if agent == EGO else "stepped onto the crossing on red"
        said[agent] = f"{what} at {act.step * dt:.1f} s"
    return _by_each(crash, said)


def _gives_way_on_foot(crash: CrashHistory) -> RuleFinding | None:
    """One of them had to give way on a crossing; a driver need not for a pedestrian who stepped out too near."""
    failed, dt = crash.acts("gives_no_way"), crash.scenario.dt
    if EGO in failed and crash.other in crash.acts("steps_out"):
        return None
    said = {EGO: "drove onto", crash.other: "stepped onto"}
    return _by_each(
        crash, {a: f"had to give way and {said[a]} the crossing at {act.step * dt:.1f} s" for a, act in failed.items()}
    )


def _into_side(crash: CrashHistory) -> RuleFinding | None:
    scenario = crash.scenario
    if not runs_into_side(scenario.agents, scenario.tracks, crash.other, crash.hit.step, scenario.dt):
        return None
    speed = crash.speed(crash.other, crash.before)
    return RuleFinding("adversary", f"the pedestrian ran into the ego's side at {speed:.1f} m/s")


def _steps_out(crash: CrashHistory) -> RuleFinding | None:
    """The pedestrian stepped out too near for the ego to stop, or in time; off a crossing, blame both."""
    if crash.hit.collision_type != "person_by_front" or ground_of(crash.scenario) is None:
        return None
    act, off = crash.acts("steps_out").get(crash.other), crash.other in crash.acts("off_crossing")
    beside = ", not on the crossing nearby" * off
    if act is None:
        return RuleFinding(
            "both" if off else "ego", f"the ego did not stop for a pedestrian that it could see in time{beside}"
        )
    when = f"at {act.step * crash.scenario.dt:.1f} s"
    return RuleFinding(
        "adversary", f"the pedestrian stepped out {when}{beside}, {act.amount:.1f} m too near for the ego to stop"
    )


RULES_ON_FOOT: tuple[Rule, ...] = (
    Rule("breaks_law", "Signs and Signals, art. 23 and 24; Road Traffic, art. 10 and 20(6)(b)(i)", _breaks_law),
    Rule("standing", "Road Traffic, art. 13(1): be able to stop before any foreseeable obstruction", _standing),
    Rule(
        "into_side", "Road Traffic, art. 20(6)(c): step onto the carriageway only where that impedes none", _into_side
    ),
    Rule("gives_way", "Road Traffic, art. 21(2): give way on crossings; the network's own right of way",
         _gives_way_on_foot),
    Rule("steps_out", "Road Traffic, art. 13(1), 20(6) and 21(1); RSS: what it takes to stop", _steps_out),
    Rule("unclear", "Road Traffic, art. 20 and 21 need crossings, which were not used here or are not known", _unclear),
)  # fmt: skip


RULES: tuple[Rule, ...] = (
    Rule(
        "red_light", "Signs and Signals, art. 23(1)(a)(ii): a red light means that traffic may not proceed", _red_light
    ),
    Rule("off_road", "Road Traffic, art. 10: position on the carriageway", _off_road),
    Rule("wrong_way", "Road Traffic, art. 10: on the side of its direction of traffic", _wrong_way),
    Rule("gives_way", "Road Traffic, art. 18: give way at intersections; the network's own right of way", _gives_way),
    Rule("leaves_way", "Road Traffic, art. 16: keep to one's way while turning", _leaves_way),
    Rule("cut_in", "Road Traffic, art. 11 and 14; RSS: do not cut in recklessly", _cut_in),
    Rule("side_swipe", "Road Traffic, art. 14: changing lanes must endanger no other", _side_swipe),
    Rule("rear_end", "Road Traffic, art. 13(5): keep a sufficient distance; RSS", _rear_end),
    Rule("standing", "Road Traffic, art. 13(1): be able to stop before any foreseeable obstruction", _standing),
    Rule("turns_across", "Road Traffic, art. 16(1)(b): who turns across lets oncoming traffic pass", _turns_across),
    Rule("leaves_lane", "Road Traffic, art. 14: leave one's lane only where that endangers no other", _leaves_lane),
    Rule("speeding", "Road Traffic, art. 13(1) and (2): keep to the limit", _speeding),
    Rule("unclear", "Road Traffic, art. 18 needs signs and priorities, which this map does not hold", _unclear),
)


def fault(attacked: Scenario) -> Fault | None:
    """Who is to blame for the collision of an attacked scenario, by the first rule that applies; None: no crash."""
    hit = attacked.crash
    if hit is None:
        return None
    crash = CrashHistory(attacked, hit)
    for rule in RULES_ON_FOOT if attacked.agents[crash.other].kind == "pedestrian" else RULES:
        verdict = rule.decide(crash)
        if verdict is not None:
            return Fault(verdict.at_fault, rule.name, verdict.reason)
    raise AssertionError("the last rule always applies")
