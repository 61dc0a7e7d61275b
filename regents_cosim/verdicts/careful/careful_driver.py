"""Decide whether a careful driver in the ego's place would have avoided the crash.

It is the competent and careful human driver of UN Regulation 157, Annex 3 (01 series; Annex 4, Appendix 3 of the
original version), performance models for cut-in, cut-out and deceleration: 0.4 s to evaluate a perceived risk, 0.75 s
until the brakes act, then 0.774 g with 0.6 s to full braking. It perceives as in `verdicts.careful.foresight`.

It follows the ego's own drive, among the fixed tracks of all others, until it has perceived the danger and reacted to
it; then it brakes along the ego's own path. It *avoids* the crash if it overlaps neither the adversary, up to 2 s
beyond the horizon (where the adversary goes straight on), nor a third party. A follower that runs into its back does
not count; it is noted if it does so although it brakes. Where braking alone does not avoid the crash, it is asked
whether it would have swerved as well: that is a grade of its own.

The danger is the agent that the ego crashes with. A false alarm over another road user would delay the ego and so take
it out of a crash that depends on timing, through no merit of the driver, so it does not count. Nor does an alarm over
the adversary that is over again before the crash (`norms.careful`). So the crash tells which danger counts; when and
how hard the driver brakes for it depends on nothing that the others do later. Its path is the one that the ego drives.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.geometry.boxes import Boxes, corners, distance
from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.maps.levels import beyond_road
from regents_cosim.mirror.reacting_traffic import among_reacting, those_who_react
from regents_cosim.norms.careful import (
    CAREFUL,
    FORESIGHT,
    braked_speed,
    careful_perceives,
    careful_reaction_steps,
)
from regents_cosim.norms.clean import follows
from regents_cosim.norms.limits import OFF_ROAD_M, steps_of
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.collisions import apart_at_entry
from regents_cosim.scenario.judgement import ReferenceDrive
from regents_cosim.scenario.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.ego_path import EgoPath, EgoPositions, braking_positions, ego_path
from regents_cosim.verdicts.careful.foresight import all_risks, expected_ways
from regents_cosim.verdicts.careful.others_around import BEYOND_S, OthersAround, OverlappedUsers

_LEAST_TRAVEL_M = 1e-6  # a standing vehicle has no curvature


def careful_verdict(attacked: Scenario) -> tuple[ReferenceDrive | None, Tracks | None]:
    """The careful driver's verdict on the crash of an attacked scenario; None without a crash.

    With it the track [1, time] of its drive, where that avoids the crash.
    """
    hit = attacked.collision
    if hit is None:
        return None, None
    drive, way = _careful(attacked, hit)
    if drive.rear_ended_by:
        drive = replace(drive, rear_ended_by=_still_rear_ended_by(attacked, way, attacked.index(hit.agent)))
    return drive, _evasion(attacked, drive, way)


def _still_rear_ended_by(attacked: Scenario, way: EgoPositions, adversary: int) -> tuple[str, ...]:
    """Ids of the road users that run into the back of the ego on this drive although they brake for it.

    The drive is tried among the tracks of the case, in which no vehicle brakes for it. A follower may be able to brake
    in time; so the others drive again, and brake as in the mirror.
    """
    until = attacked.tracks.steps
    ego = tuple(values[:until] for values in (way.x, way.y, way.yaw, way.speed))
    moved = among_reacting(attacked, ego, those_who_react(attacked))
    return _names(attacked, OthersAround(attacked, adversary, moved).met_by(way))


def _evasion(attacked: Scenario, careful: ReferenceDrive, way: EgoPositions) -> Tracks | None:
    """The ego's own track until the careful driver acts, then its `way`, with controls; None where it crashes too."""
    if not careful.avoids or careful.perceives_s is None or careful.acts_s is None:
        return None
    own, dt = attacked.tracks, attacked.dt
    acts = round(careful.perceives_s / dt) + int(careful_reaction_steps(np, dt))
    driven = {
        name: np.append(getattr(own, name)[0, :acts], getattr(way, name)[acts : own.steps])[None]
        for name in ("x", "y", "yaw", "speed")
    }
    speed, yaw = driven["speed"], np.unwrap(driven["yaw"], axis=1)
    moved = 0.5 * (speed[:, :-1] + speed[:, 1:]) * attacked.dt
    turned = np.diff(yaw, axis=1)
    return Tracks(
        **driven,
        z=attacked.heights.of(0, driven["x"], driven["y"]),
        valid=own.valid[:1],
        accel=np.diff(speed, axis=1) / attacked.dt,
        curvature=np.divide(turned, moved, out=np.zeros_like(turned), where=moved > _LEAST_TRAVEL_M),
    )


def _careful(attacked: Scenario, hit: Collision) -> tuple[ReferenceDrive, EgoPositions]:
    """The careful driver's verdict, and its drive that avoids the crash; braking alone is tried first."""
    path, adversary = ego_path(attacked), attacked.index(hit.agent)
    around, dt = OthersAround(attacked, adversary), attacked.dt
    perceived = perceives(all_risks(attacked, path, [adversary], hit.step + 1)[adversary], dt)
    if perceived is None:
        return ReferenceDrive("careful", avoids=False), _own_drive(attacked)
    acts = perceived + int(careful_reaction_steps(np, dt))
    seen_s, acts_s = (round(perceived * dt + later_s, 9) for later_s in (0.0, CAREFUL.reaction_s))
    seen = ReferenceDrive("careful", avoids=False, perceives_s=seen_s, acts_s=acts_s)
    if acts >= hit.step:
        return replace(seen, acts_s=None), _own_drive(attacked)
    own = attacked.tracks.speed[0]
    own = np.append(own, np.full(round(BEYOND_S / dt), own[-1]))
    speed = braked_speed(np, own, acts, dt)
    braking = braking_positions(attacked, path, speed, acts)
    met = around.met_by(braking)
    if not met.counts.any():
        return replace(seen, avoids=True, rear_ended_by=_names(attacked, met)), braking
    decides = acts - int(steps_of(np, CAREFUL.delay_s, dt))
    shift, swerving = expected_swerve(attacked, path, adversary, decides, acts, speed)
    met = around.met_by(swerving)
    if shift and not met.counts.any():
        return replace(seen, avoids=True, shift_m=shift, rear_ended_by=_names(attacked, met)), swerving
    return seen, braking


def _names(attacked: Scenario, met: OverlappedUsers) -> tuple[str, ...]:
    """Ids of the agents that run into its back."""
    return tuple(attacked.agents[index].id for index in np.flatnonzero(met.from_behind).tolist())


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
    drives = {shift: braking_positions(attacked, path, speed, acts, shift) for shift in (0.0, *CAREFUL.swerves_m)}
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
    behind = follows(np.cos(tracks.yaw[:, step] - yaw), ahead_and_left(np, dx, dy, yaw)[0])
    seen = tracks.valid[:, step] & apart_at_entry(attacked.agents, tracks) & ~behind
    return np.flatnonzero((seen | (index == adversary)) & (index > 0))


def _keeps_to_road(attacked: Scenario, drive: EgoPositions, onset: int) -> bool:
    """Whether every corner that was on the road at the onset stays on it."""
    ego, steps = attacked.ego, np.arange(onset, attacked.tracks.steps)
    x, y, yaw = drive.x[steps], drive.y[steps], drive.yaw[steps]
    z = np.asarray(attacked.heights.of(0, x, y))
    off = beyond_road(attacked.road, corners(Boxes(x, y, yaw, ego.length, ego.width)), z[:, None]) > OFF_ROAD_M
    return not off[:, ~off[0]].any()
