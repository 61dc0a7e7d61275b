"""Surrogate safety measures: how close a drive came to a collision, one short pure function each.

Sources: Allen, Shin and Cooper 1978 (post-encroachment time); Cooper and Ferguson 1976 (deceleration rate to avoid a
crash). Where these leave a choice, it is that of SUMO's SSM device (its documentation, Simulation/Output/SSM_Device),
except for the area of a crossing: see `encounters.crossing`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.evaluation.drives.encounters import Approach, FrontPath, crossing, followings, joining
from regents_cosim.geometry.boxes import CLEARANCE_M, Boxes, distance
from regents_cosim.norms.following import time_to_collision
from regents_cosim.scenario.scenario import Agent, Tracks, boxes_of

Values = Float[np.ndarray, "*n"]


@dataclass(frozen=True, eq=False)
class AgentPair:
    """The measures of the ego and one other agent over time; NaN where a measure is not defined."""

    ttc: Float[np.ndarray, " time"]  # [s]
    drac: Float[np.ndarray, " time"]  # [m/s^2]
    pet: float | None  # [s] of the pair as a whole


@dataclass(frozen=True)
class Safety:
    """The worst of each measure over a drive and all other agents; None where never defined."""

    min_ttc_s: float | None  # 0 after contact
    min_pet_s: float | None  # 0 after contact
    max_drac_m_s2: float | None  # up to the step before contact
    min_gap_m: float | None  # distance of the boxes


# --- the measures ----------------------------------------------------------------------------------


def deceleration_to_follow(gap: Values, closing: Values) -> Values:
    """The least constant deceleration with which a follower reaches its leader's speed in time: closing^2 / (2 gap)."""
    needed = (closing > 0.0) & (gap > 0.0)
    return np.divide(0.5 * np.square(closing), gap, out=np.full(np.shape(gap), np.nan), where=needed)


def arrival_time(way: Values, speed: Values, accel: Values) -> Values:
    """Seconds to cover `way` [m], 0 behind it; a braking agent goes on braking, infinite where it stops before."""
    brake = np.maximum(-accel, 0.0)
    way = np.maximum(way, 0.0)
    root = np.square(speed) - 2.0 * brake * way
    with np.errstate(divide="ignore", invalid="ignore"):
        time = 2.0 * way / (speed + np.sqrt(root))  # of v t - b t^2 / 2 = way, also for b = 0
    return np.where(way == 0.0, 0.0, np.where(np.isnan(time) & ~np.isnan(root), np.inf, time))


def crossing_ttc(first: Approach, second: Approach) -> Values:
    """Seconds until `second` enters the area, if `first` is still in it then; else NaN."""
    leaves = arrival_time(first.exit, first.speed, first.accel)
    enters = arrival_time(second.entry, second.speed, second.accel)
    conflict = _first_in_time(first, second) & (enters <= leaves) & np.isfinite(enters)
    return np.where(conflict, _steadily(second.entry, second.speed), np.nan)


def deceleration_to_yield(one: Approach, other: Approach) -> Values:
    """The least constant deceleration with which either agent enters the area when the other one leaves it, at time t.

    2 (v - d / t) / t, at a distance d and a speed v that would bring it there earlier; v^2 / (2 d) where the other one
    will stop in the area. NaN where one of them need not brake at all, has left, or both are in the area.
    """
    needed = np.fmin(_yield(one, other), _yield(other, one))
    return np.where((needed > 0.0) & np.isfinite(needed) & (one.exit > 0.0) & (other.exit > 0.0), needed, np.nan)


def _yield(yielding: Approach, passing: Approach) -> Values:
    """The deceleration of `deceleration_to_yield` for `yielding`, at most 0 where it need not brake.

    NaN where the other agent decides: where `yielding` is in the area already, or the other one stops before the area.
    """
    enters = arrival_time(passing.entry, passing.speed, passing.accel)
    leaves = arrival_time(passing.exit, passing.speed, passing.accel)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = 2.0 * (yielding.speed - yielding.entry / leaves) / leaves
        stopping = 0.5 * np.square(yielding.speed) / yielding.entry
    return np.where(
        (yielding.entry > 0.0) & np.isfinite(enters), np.where(np.isfinite(leaves), needed, stopping), np.nan
    )


def joining_ttc(first: Approach, second: Approach) -> Values:
    """Seconds until `second` reaches the place where the paths join, if the rear of `first` is not past it by then.

    Otherwise seconds until it has caught up behind that place. Both keep their speeds; NaN if they will not touch.
    """
    reaches, clear = _steadily(second.entry, second.speed), _steadily(first.exit, first.speed)
    behind = time_to_collision(second.entry - first.exit, second.speed - first.speed)
    return np.where(_in_this_order(first, second), np.where(reaches <= clear, reaches, behind), np.nan)


def deceleration_to_join(first: Approach, second: Approach) -> Values:
    """The least constant deceleration with which `second` stops before the place where the paths join.

    If the rear of `first` will be past it, the one with which `second` reaches the speed of `first` in time.
    """
    reaches, clear = _steadily(second.entry, second.speed), _steadily(first.exit, first.speed)
    behind = deceleration_to_follow(second.entry - first.exit, second.speed - first.speed)
    stopping = deceleration_to_follow(second.entry, second.speed)
    return np.where(_in_this_order(first, second), np.where(reaches <= clear, stopping, behind), np.nan)


def post_encroachment_time(one: Approach, other: Approach, dt: float) -> float | None:
    """Seconds from the first one's leaving the area to the second one's entering it; None unless both happen.

    0 where the second one entered before.
    """
    enters, leaves = [_passing(a.entry, dt) for a in (one, other)], [_passing(a.exit, dt) for a in (one, other)]
    if np.isnan([*enters, *leaves]).any():
        return None
    return max(enters[1] - leaves[0] if enters[0] <= enters[1] else enters[0] - leaves[1], 0.0)


def _first_in_time(first: Approach, second: Approach) -> Bool[np.ndarray, " time"]:
    """Steps at which `second` is still before the area, and `first` is in it or due there earlier."""
    due = [arrival_time(a.entry, a.speed, a.accel) for a in (first, second)]
    sooner = due[0] <= due[1]  # on a tie either may come first
    return sooner & (first.exit > 0.0) & (second.entry > 0.0)


def _in_this_order(first: Approach, second: Approach) -> Bool[np.ndarray, " time"]:
    """Steps at which both approach the place where their paths join, and `first` is due there before `second`."""
    due = [_steadily(a.entry, a.speed) for a in (first, second)]
    return (due[0] > 0.0) & (due[0] <= due[1]) & np.isfinite(due[1])


def _steadily(way: Values, speed: Values) -> Values:
    """Seconds to cover `way` at constant speed."""
    return arrival_time(way, speed, np.zeros_like(speed))


def _passing(way: Values, dt: float) -> float:
    """The time [s] when `way` [m] falls to zero, interpolated between steps; NaN where it does not."""
    after = np.flatnonzero(way <= 0.0)
    if not len(after) or after[0] == 0:
        return float("nan")
    step = int(after[0])
    return float(dt * (step - way[step] / (way[step] - way[step - 1])))


# --- over a drive ----------------------------------------------------------------------------------


def measure_pair(ego: FrontPath, other: FrontPath, dt: float) -> AgentPair:
    """All measures of two agents, step by step."""
    behind = list(followings(ego, other))
    ttc = [time_to_collision(f.gap, f.closing) for f in behind]
    drac = [deceleration_to_follow(f.gap, f.closing) for f in behind]
    meeting = crossing(ego, other)
    pet = None
    if meeting is not None:
        for first, second in (meeting, meeting[::-1]):
            ttc.append(crossing_ttc(first, second))
        drac.append(deceleration_to_yield(*meeting))
        pet = post_encroachment_time(*meeting, dt)
    joint = joining(ego, other)
    if joint is not None:
        for first, second in (joint, joint[::-1]):
            ttc.append(joining_ttc(first, second))
            drac.append(deceleration_to_join(first, second))
    return AgentPair(np.fmin.reduce(ttc), np.fmax.reduce(drac), pet)


def measure_drive(agents: tuple[Agent, ...], tracks: Tracks, dt: float, contact: int | None = None) -> Safety:
    """The worst measures of the ego with every other agent, up to the step of its first `contact` if there is one."""
    end = tracks.steps if contact is None else contact + 1
    gap = least_gap(agents, tracks, end)
    if contact is not None:
        end -= 1  # the measures are about a collision to come
    seen = _first_steps(tracks, max(end, 2))
    ego = FrontPath(agents[0], seen, 0, dt)
    near = [i for i in range(1, len(agents)) if seen.valid[i].sum() >= 2 and _comes_near(seen, i)]
    pairs = [measure_pair(ego, FrontPath(agents[i], seen, i, dt), dt) for i in near]
    found = Safety(
        min_ttc_s=_worst([pair.ttc for pair in pairs], min),
        min_pet_s=_worst([np.array([pair.pet]) for pair in pairs if pair.pet is not None], min),
        max_drac_m_s2=_worst([pair.drac for pair in pairs], max),
        min_gap_m=gap,
    )
    return found if contact is None else replace(found, min_ttc_s=0.0, min_pet_s=0.0)


def least_gap(agents: tuple[Agent, ...], tracks: Tracks, end: int) -> float | None:
    """Least distance [m] of the ego's box to another one before step `end`; None where the ego is alone."""
    boxes = boxes_of(agents, tracks)
    shape = tracks.x.shape
    at = [np.broadcast_to(values, shape)[:, :end] for values in boxes]
    there = tracks.valid[1:, :end] & tracks.valid[:1, :end]
    if not there.any():
        return None
    apart = distance(Boxes(*(values[:1] for values in at)), Boxes(*(values[1:] for values in at)))
    least = float(np.asarray(apart)[there].min())
    return least if np.isfinite(least) else None  # all others are on other levels


_NEAR_M = 50.0  # farther agents do not matter, as in SUMO's device


def _comes_near(tracks: Tracks, agent: int) -> bool:
    there = tracks.valid[agent] & tracks.valid[0]
    apart = np.hypot(tracks.x[agent] - tracks.x[0], tracks.y[agent] - tracks.y[0])
    return bool((there & (apart < _NEAR_M) & _on_a_level(tracks, agent)).any())


def _on_a_level(tracks: Tracks, agent: int) -> Bool[np.ndarray, " time"]:
    """Steps at which the agent's height occurs on the ego's path, so that they may meet."""
    low, high = tracks.z[0].min() - CLEARANCE_M, tracks.z[0].max() + CLEARANCE_M
    return (tracks.z[agent] > low) & (tracks.z[agent] < high)


def _first_steps(tracks: Tracks, end: int) -> Tracks:
    names = ("x", "y", "yaw", "speed", "valid", "z")
    return Tracks(**{name: getattr(tracks, name)[:, :end] for name in names})


def _worst(values: list[Float[np.ndarray, " _"]], choose: Callable[[Iterable[float]], float]) -> float | None:
    found = [float(v) for some in values for v in some[~np.isnan(some)]]
    return choose(found) if found else None
