"""How hard the fuzzy safety model and RSS want a follower to brake, from gaps and speeds along the ego's route.

Written for NumPy and JAX alike. Values are of one other road user each: how far ahead it is, how far beside the ego's
way, and how fast it goes along it and towards it.
"""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Fuzzy:
    """The JRC's fuzzy safety model, FSM.

    Source: Mattas et al. 2020, "Fuzzy surrogate safety metrics for real-time assessment of rear-end collision risk"
    (Accident Analysis and Prevention 148); values as in Mattas et al. 2022, "Driver models for the definition of safety
    requirements of automated vehicles in international regulations" (174), and in UN R157 (01 series), Annex 3.
    """

    delay_s: float = 0.75
    least_braking: float = 4.0  # [m/s^2] comfortable
    most_braking: float = 6.0  # [m/s^2]
    leader_braking: float = 7.0  # [m/s^2]
    standing_gap_m: float = 2.0
    margin_m: float = 2.0
    jerk_m_s3: float = 12.65


@dataclass(frozen=True)
class Rss:
    """Responsibility-Sensitive Safety: safe distances and the proper response.

    Source: Shalev-Shwartz, Shammah and Shashua 2017, "On a formal model of safe and scalable self-driving cars",
    Definitions 1, 3 and 6; values as in the JRC's comparison (Mattas et al. 2022).
    """

    delay_s: float = 0.75
    accel: float = 3.0  # [m/s^2] of the follower until it responds
    braking: float = 6.0  # [m/s^2] least of the follower, and most of the leader
    response_braking: float = 0.774 * 9.81  # [m/s^2] with which it responds
    lateral_accel: float = 1.0  # [m/s^2]
    lateral_margin_m: float = 0.3
    jerk_m_s3: float = 12.65


FUZZY, RSS = Fuzzy(), Rss()


@dataclass(frozen=True, eq=False)
class NearbyRoadUser:
    """One road user, or several, as seen from the ego's way; arrays of NumPy or JAX."""

    gap_m: Any  # along the way, from the ego's nose to their rear; below 0 beside the ego
    passing_m: Any  # distance to drive until the ego has passed them, if they stand
    beside_m: Any  # from the ego's flank to theirs, below 0 where they reach into its way
    speed: Any  # [m/s] along the way
    towards: Any  # [m/s] to the way's middle
    ahead: Any  # whether they are ahead of the ego


def fuzzy_braking(xp: Any, ego_speed: Any, ego_accel: Any, other: NearbyRoadUser, model: Fuzzy = FUZZY) -> Any:
    """The braking [m/s^2] that the fuzzy model wants because of each of them: 0 where it sees no risk."""
    closing = xp.maximum(ego_speed - other.speed, 1e-3)
    cuts_in = (other.towards > 0.0) & (
        other.beside_m / xp.maximum(other.towards, 1e-3) <= other.passing_m / closing + 0.1
    )
    counts = other.ahead & ((other.beside_m <= 0.0) | cuts_in)
    critical = _critical(xp, ego_speed, ego_accel, other, model)
    proactive = _proactive(xp, ego_speed, other, model)
    wanted = model.least_braking + critical * (model.most_braking - model.least_braking)
    return xp.where(counts, xp.where(critical > 0.0, wanted, proactive * model.least_braking), 0.0)


def _proactive(xp: Any, ego_speed: Any, other: NearbyRoadUser, model: Fuzzy) -> Any:
    """PFS: 0 where even a leader that brakes leaves time to brake gently, 1 where only hard braking would do."""
    room = other.gap_m - model.standing_gap_m
    reaction = ego_speed * model.delay_s
    leader = other.speed * xp.abs(other.speed) / (2.0 * model.leader_braking)
    safe = reaction + ego_speed**2 / (2.0 * model.least_braking) - leader + model.margin_m
    unsafe = reaction + ego_speed**2 / (2.0 * model.most_braking) - leader
    return xp.clip((safe - room) / xp.maximum(safe - unsafe, 1e-3), 0.0, 1.0)


def _critical(xp: Any, ego_speed: Any, ego_accel: Any, other: NearbyRoadUser, model: Fuzzy) -> Any:
    """CFS: as PFS, for a leader that keeps its speed."""
    accel = xp.maximum(ego_accel, -model.least_braking)
    later = ego_speed + model.delay_s * accel
    reaction = (ego_speed + 0.5 * accel * model.delay_s - other.speed) * model.delay_s
    square = (later - other.speed) ** 2
    safe = reaction + square / (2.0 * model.least_braking)
    unsafe = reaction + square / (2.0 * model.most_braking)
    graded = xp.clip((safe - other.gap_m) / xp.maximum(safe - unsafe, 1e-3), 0.0, 1.0)
    slows_in_time = (ego_speed - other.speed) ** 2 / xp.maximum(2.0 * xp.abs(ego_accel), 1e-3)
    already = xp.where(other.gap_m < slows_in_time, 1.0, 0.0)
    return xp.where(ego_speed <= other.speed, 0.0, xp.where(later < other.speed, already, graded))


def rss_braking(xp: Any, ego_speed: Any, other: NearbyRoadUser, model: Rss = RSS) -> Any:
    """The braking [m/s^2] of the proper response to each of them: 0 where the distance is safe along or across."""
    after = ego_speed + model.delay_s * model.accel
    along = ego_speed * model.delay_s + 0.5 * model.accel * model.delay_s**2 + after**2 / (2.0 * model.braking)
    along = along - other.speed * xp.abs(other.speed) / (2.0 * model.braking)
    towards = xp.maximum(other.towards, 0.0)
    faster = towards + model.lateral_accel * model.delay_s
    across = model.lateral_margin_m + 0.5 * (towards + faster) * model.delay_s
    across = across + faster**2 / (2.0 * model.lateral_accel)
    near = other.ahead & (other.gap_m < along) & (other.beside_m < across) & (towards > 0.0)
    leads = other.ahead & (other.gap_m < along) & (other.beside_m <= 0.0)
    return xp.where(near | leads, model.response_braking, 0.0)
