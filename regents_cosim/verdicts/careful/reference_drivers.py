"""Decide whether a reference driver in the ego's place would have avoided the crash.

A reference driver follows the ego's own drive, among the fixed tracks of all others, until it has perceived the danger
and reacted to it; then it brakes along the ego's own path. It *avoids* the crash if it overlaps neither the adversary,
up to 2 s beyond the horizon (where the adversary goes straight on), nor a third party. A follower that runs into its
back does not count; it is noted if it does so although it brakes (`verdicts.careful.followers`). None of these drivers
is the truth: a verdict names the driver that it rests on.

The danger is the agent that the ego crashes with. A false alarm over another road user would delay the ego and so take
it out of a crash that depends on timing, through no merit of the driver, so it does not count. Nor does an alarm over
the adversary that is over again before the crash (`norms.careful`). What the driver does at a step depends on nothing
that the others do later; its own path is the one that the ego drives.

**careful**: the competent and careful human driver of UN Regulation 157, Annex 3 (01 series; Annex 4, Appendix 3 of the
original version), performance models for cut-in, cut-out and deceleration: 0.4 s to evaluate a perceived risk, 0.75 s
until the brakes act, then 0.774 g with 0.6 s to full braking. It perceives as in `verdicts.careful.foresight`. Where
braking alone does not avoid the crash, it is asked whether it would have swerved as well:
that is a grade of its own.

**fuzzy** and **rss**: the JRC's fuzzy safety model and RSS's proper response (`norms.safety_models`), made for cut-ins
and leaders; to them crossing traffic cuts in, seen along and across the ego's path.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.attack_record import Collision
from regents_cosim.collisions import apart_at_entry
from regents_cosim.geometry.boxes import Boxes, corners, distance
from regents_cosim.geometry.frames import wrap
from regents_cosim.judgement import ReferenceDrive, ReferenceDriver
from regents_cosim.maps.levels import beyond_road
from regents_cosim.norms.careful import (
    CAREFUL,
    FORESIGHT,
    Foresight,
    braked_speed,
    careful_perceives,
    careful_reaction_steps,
    steps_of,
)
from regents_cosim.norms.limits import ALONG_RAD, OFF_ROAD_M
from regents_cosim.norms.safety_models import FUZZY, RSS, NearbyRoadUser, fuzzy_braking, rss_braking
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.ego_path import EgoPath, EgoPositions, braking_positions, ego_path
from regents_cosim.verdicts.careful.evasion import evasion_of
from regents_cosim.verdicts.careful.followers import still_rear_ended_by
from regents_cosim.verdicts.careful.foresight import expected_ways, risks
from regents_cosim.verdicts.careful.others_around import OthersAround, OverlappedUsers, beyond_steps

WantedBraking = Callable[[float, float, NearbyRoadUser], float]


@dataclass(frozen=True)
class SafetyModel:
    """A model that says how hard to brake, with the delay and build-up of its brakes."""

    driver: ReferenceDriver
    wanted: WantedBraking  # [m/s^2] from the ego's speed, its acceleration, and the adversary's position
    delay_s: float
    jerk_m_s3: float


SAFETY_MODELS = (
    SafetyModel("fuzzy", lambda *at: float(fuzzy_braking(np, *at)), FUZZY.delay_s, FUZZY.jerk_m_s3),
    SafetyModel("rss", lambda speed, _, other: float(rss_braking(np, speed, other)), RSS.delay_s, RSS.jerk_m_s3),
)


@dataclass(frozen=True, eq=False)
class BrakedDrive:
    """The speeds of a drive, the steps at which it perceived the danger and began to brake; None: never."""

    speed: Float[np.ndarray, " step"]  # [m/s]
    perceived: int | None
    acts: int | None


def braked_by(model: SafetyModel, scenario: Scenario, path: EgoPath, adversary: int, until: int) -> BrakedDrive:
    """The ego's own speeds until the model has perceived a danger before step `until` and reacted, then its braking.

    Once it has begun, it brakes as hard as the model wants, holds the speed where the model wants nothing, and never
    brakes less than the ego did.
    """
    own, dt, steps = scenario.tracks.speed[0], scenario.dt, beyond_steps(scenario)
    seen = _Adversary(scenario, path, adversary)
    perceived = next((k for k in range(until) if seen.braking(model, k, path.driven[k], own) > 0.0), None)
    acts = None if perceived is None else perceived + round(model.delay_s / dt)
    if acts is None or acts >= until:
        return BrakedDrive(own, perceived, None)
    speed, distance, braking = [*own[: acts + 1].tolist()], float(path.driven[acts]), 0.0
    for step in range(acts, steps - 1):
        wanted = seen.braking(model, step, distance, np.array(speed))
        braking = min(braking + model.jerk_m_s3 * dt, wanted)
        own_braking = (own[step] - own[step + 1]) / dt if step + 1 < len(own) else 0.0
        speed.append(max(speed[-1] - dt * max(braking, own_braking), 0.0))
        distance += 0.5 * (speed[-1] + speed[-2]) * dt
    return BrakedDrive(np.array(speed), perceived, acts)


class _Adversary:
    """The adversary's position relative to the ego's path at every step; beyond the horizon it goes straight on."""

    def __init__(self, scenario: Scenario, path: EgoPath, adversary: int) -> None:
        tracks, agent, ego = scenario.tracks, scenario.agents[adversary], scenario.ego
        ahead = scenario.dt * np.arange(1, beyond_steps(scenario) - tracks.steps + 1)
        speed, yaw, there = (
            np.append(values[adversary], np.full(len(ahead), values[adversary, -1]))
            for values in (tracks.speed, tracks.yaw, tracks.valid)
        )
        x = np.append(tracks.x[adversary], tracks.x[adversary, -1] + speed[-1] * np.cos(yaw[-1]) * ahead)
        y = np.append(tracks.y[adversary], tracks.y[adversary, -1] + speed[-1] * np.sin(yaw[-1]) * ahead)
        self._along, across, way = path.project(x, y)
        cos, sin = np.cos(yaw - way), np.sin(yaw - way)
        self._reach = 0.5 * (np.abs(cos) * agent.length + np.abs(sin) * agent.width + ego.length)
        breadth = 0.5 * (np.abs(sin) * agent.length + np.abs(cos) * agent.width + ego.width)
        self._beside = np.abs(across) - breadth
        self._speed, self._towards = speed * cos, -np.sign(across) * speed * sin
        self._there, self._dt = there.astype(bool), scenario.dt

    def braking(self, model: SafetyModel, step: int, distance: float, speeds: np.ndarray) -> float:
        """The braking [m/s^2] that the model wants at a step, for an ego at `distance` [m] with `speeds` until then."""
        if not self._there[step]:
            return 0.0
        away = float(self._along[step] - distance)
        other = NearbyRoadUser(
            gap_m=away - self._reach[step],
            passing_m=away + self._reach[step],
            beside_m=self._beside[step],
            speed=self._speed[step],
            towards=self._towards[step],
            ahead=away > 0.0,
        )
        accel = (speeds[step] - speeds[step - 1]) / self._dt if step else 0.0
        return model.wanted(float(speeds[step]), float(accel), other)


def reference_drives(attacked: Scenario) -> tuple[tuple[ReferenceDrive, ...], Tracks | None]:
    """The drives of all reference drivers in the crash of an attacked scenario; empty where there is no crash.

    With them the track [1, time] of the careful driver's drive, where that avoids the crash.
    """
    hit = attacked.attack.collision if attacked.attack else None
    if hit is None:
        return (), None
    careful, way = _careful(attacked, hit)
    drives = (careful, way), *(_by_model(model, attacked, hit) for model in SAFETY_MODELS)
    return tuple(_with_followers(attacked, hit, *drive) for drive in drives), evasion_of(attacked, careful, way)


def _with_followers(attacked: Scenario, hit: Collision, drive: ReferenceDrive, way: EgoPositions) -> ReferenceDrive:
    """The verdict with those followers only that run into the driver's back although they brake."""
    if not drive.rear_ended_by:
        return drive
    return replace(drive, rear_ended_by=still_rear_ended_by(attacked, way, _adversary(attacked, hit)))


def careful_drive(attacked: Scenario, foresight: Foresight = FORESIGHT) -> ReferenceDrive | None:
    """The careful driver's verdict alone; None without a crash."""
    hit = attacked.attack.collision if attacked.attack else None
    return None if hit is None else _careful(attacked, hit, foresight)[0]


def _careful(
    attacked: Scenario, hit: Collision, foresight: Foresight = FORESIGHT
) -> tuple[ReferenceDrive, EgoPositions]:
    """The careful driver's verdict, and its drive that avoids the crash; braking alone is tried first."""
    path, adversary = ego_path(attacked), _adversary(attacked, hit)
    around, steps, dt = OthersAround(attacked, adversary), beyond_steps(attacked), attacked.dt
    perceived = perceives(risks(attacked, path, adversary, hit.step + 1, foresight), dt)
    if perceived is None:
        return ReferenceDrive("careful", avoids=False), _own_drive(attacked)
    acts = perceived + int(careful_reaction_steps(np, dt))
    seen = ReferenceDrive("careful", avoids=False, perceives_s=round(perceived * dt, 9), acts_s=round(acts * dt, 9))
    if acts >= hit.step:
        return replace(seen, acts_s=None), _own_drive(attacked)
    own = attacked.tracks.speed[0]
    own = np.append(own, np.full(steps - len(own), own[-1]))
    speed = braked_speed(np, own, acts, CAREFUL.most_braking_m_s2, CAREFUL.jerk_m_s3, dt)
    braking = braking_positions(attacked, path, speed, acts, 0.0, CAREFUL.swerve_m_s2)
    met = around.met_by(braking)
    if not met.counts.any():
        return replace(seen, avoids=True, rear_ended_by=_names(attacked, met)), braking
    decides = acts - int(steps_of(np, CAREFUL.delay_s, dt))
    shift, swerving = expected_swerve(attacked, path, adversary, decides, acts, speed)
    met = around.met_by(swerving)
    if shift and not met.counts.any():
        return replace(seen, avoids=True, shift_m=shift, rear_ended_by=_names(attacked, met)), swerving
    return seen, braking


def _by_model(model: SafetyModel, attacked: Scenario, hit: Collision) -> tuple[ReferenceDrive, EgoPositions]:
    """The verdict of the fuzzy safety model or of RSS, which only brake, and its drive."""
    path, adversary, dt = ego_path(attacked), _adversary(attacked, hit), attacked.dt
    braked = braked_by(model, attacked, path, adversary, hit.step)
    perceives_s, acts_s = (None if step is None else round(step * dt, 9) for step in (braked.perceived, braked.acts))
    if braked.acts is None:
        return ReferenceDrive(model.driver, False, perceives_s, acts_s), _own_drive(attacked)
    drive = braking_positions(attacked, path, braked.speed, braked.acts, 0.0, CAREFUL.swerve_m_s2)
    met = OthersAround(attacked, adversary).met_by(drive)
    if met.counts.any():
        return ReferenceDrive(model.driver, False, perceives_s, acts_s), drive
    return ReferenceDrive(model.driver, True, perceives_s, acts_s, rear_ended_by=_names(attacked, met)), drive


def _names(attacked: Scenario, met: OverlappedUsers) -> tuple[str, ...]:
    """Ids of the agents that run into its back."""
    return tuple(attacked.agents[index].id for index in np.flatnonzero(met.from_behind).tolist())


def _adversary(attacked: Scenario, hit: Collision) -> int:
    return next(index for index, agent in enumerate(attacked.agents) if agent.id == hit.agent)


def perceives(risk: Bool[np.ndarray, " step"], dt: float) -> int | None:
    """The first step of the danger that the careful driver believes at the last step (`reaction`); None if none."""
    step = int(careful_perceives(np, risk, dt))
    return step if step < len(risk) else None


def _own_drive(attacked: Scenario) -> EgoPositions:
    own = attacked.tracks
    return EgoPositions(own.x[0], own.y[0], own.yaw[0], own.speed[0])


# Choose whether and where a careful driver swerves, by what he expects when he decides, never by what comes.
# He decides as long before he acts as his brakes take. Where he expects braking alone to be enough, he only brakes.
# Otherwise he takes the swerve with the most room to all road users that he sees, if they go on as now
# (`verdicts.careful.foresight`); where he expects a collision on each of them, he does not swerve. UN Regulation 157
# knows no swerve.
def expected_swerve(
    attacked: Scenario, path: EgoPath, adversary: int, decides: int, acts: int, speed: Float[np.ndarray, " step"]
) -> tuple[float, EgoPositions]:
    """The swerve [m, positive to the left] that the driver decides on at step `decides`, and the drive with it.

    The drive has these speeds, and moves aside from step `acts` on. The shift is 0 where he only brakes.
    """
    around = _ExpectedOthers(attacked, path, adversary, decides, acts)
    drives = {
        shift: braking_positions(attacked, path, speed, acts, shift, CAREFUL.swerve_m_s2)
        for shift in (0.0, *CAREFUL.swerves_m)
    }
    rooms = {
        shift: around.room_of(drive)
        for shift, drive in drives.items()
        if not shift or _keeps_to_road(attacked, drive, acts)
    }
    best = max(rooms, key=lambda shift: rooms[shift])
    chosen = best if rooms[0.0][0] <= 0.0 < rooms[best][0] else 0.0
    return chosen, drives[chosen]


class _ExpectedOthers:
    """The ways of all others from step `acts` on, as they are to be expected at step `decides`."""

    def __init__(self, attacked: Scenario, path: EgoPath, adversary: int, decides: int, acts: int) -> None:
        ahead = np.arange(acts - decides, int(FORESIGHT.ahead_s / attacked.dt) + 1)
        seen = _in_view(attacked, adversary, decides)
        x, y, yaw, z = expected_ways(attacked, path, seen, decides, ahead * attacked.dt)
        size = np.array([(agent.length, agent.width) for agent in attacked.agents])
        self._ways, self._size = (x, y, yaw, z), size[seen]
        self._steps, self._is_adversary, self._attacked = decides + ahead, seen == adversary, attacked

    def room_of(self, drive: EgoPositions) -> tuple[float, float]:
        """The least distances [m] of a drive to all others, and to the adversary."""
        steps = self._steps[self._steps < len(drive.x)]
        x, y, yaw = drive.x[steps], drive.y[steps], drive.yaw[steps]
        ego = self._attacked.ego
        mine = Boxes(x, y, yaw, ego.length, ego.width, self._attacked.heights.of(0, x, y))
        x, y, yaw, z = (values[:, : len(steps)] for values in self._ways)
        away = np.asarray(distance(mine, Boxes(x, y, yaw, self._size[:, :1], self._size[:, 1:], z)))
        return float(away.min(initial=np.inf)), float(away[self._is_adversary].min(initial=np.inf))


def _in_view(attacked: Scenario, adversary: int, step: int) -> Int[np.ndarray, " agent"]:
    """The road users that the driver sees at a step, without those behind him that go his way."""
    tracks, index = attacked.tracks, np.arange(len(attacked.agents))
    dx, dy = tracks.x[:, step] - tracks.x[0, step], tracks.y[:, step] - tracks.y[0, step]
    yaw = tracks.yaw[0, step]
    follows = (np.abs(wrap(tracks.yaw[:, step] - yaw)) < ALONG_RAD) & (dx * np.cos(yaw) + dy * np.sin(yaw) < 0.0)
    seen = tracks.valid[:, step] & apart_at_entry(attacked.agents, tracks) & ~follows
    return np.flatnonzero((seen | (index == adversary)) & (index > 0))


def _keeps_to_road(attacked: Scenario, drive: EgoPositions, onset: int) -> bool:
    """Whether every corner that was on the road at the onset stays on it."""
    ego, steps = attacked.ego, np.arange(onset, attacked.tracks.steps)
    x, y, yaw = drive.x[steps], drive.y[steps], drive.yaw[steps]
    z = np.asarray(attacked.heights.of(0, x, y))
    off = beyond_road(attacked.road, corners(Boxes(x, y, yaw, ego.length, ego.width)), z[:, None]) > OFF_ROAD_M
    return not off[:, ~off[0]].any()
