"""Decide whether a reference driver in the ego's place would have avoided the crash.

A reference driver follows the ego's own drive, among the fixed tracks of all others, until it has perceived the danger
and reacted to it; then it brakes along the ego's own path. It *avoids* the crash if it overlaps neither the adversary,
up to 2 s beyond the horizon (where the adversary goes straight on), nor a third party. Followers that replay their log
into its back are noted, not counted. None of these drivers is the truth: a verdict names the driver that it rests on.

The danger is the agent that the ego crashes with. A false alarm over another road user would delay the ego and so take
it out of a crash that depends on timing, through no merit of the driver, so it does not count. Nor does an alarm over
the adversary that is over again before the crash (`norms.reaction`). What the driver does at a step depends on nothing
that the others do later; its own path is the one that the ego drives.

**careful**: the competent and careful human driver of UN Regulation 157, Annex 3 (01 series; Annex 4, Appendix 3 of the
original version), performance models for cut-in, cut-out and deceleration: 0.4 s to evaluate a perceived risk, 0.75 s
until the brakes act, then 0.774 g with 0.6 s to full braking. It perceives as in `verdicts.careful.foresight`. Where
braking alone does not avoid the crash, it is asked whether it would have swerved as well (`verdicts.careful.swerves`):
that is a grade of its own.

**fuzzy** and **rss**: the JRC's fuzzy safety model and RSS's proper response (`norms.safety_models`), made for cut-ins
and leaders; to them crossing traffic cuts in, seen along and across the ego's path.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from regents_cosim.attack_record import Collision
from regents_cosim.judgement import ReferenceDrive
from regents_cosim.norms.careful import CAREFUL, FORESIGHT, Foresight
from regents_cosim.norms.evasion import braked_speed
from regents_cosim.norms.reaction import careful_perceives, careful_reaction_steps, steps_of
from regents_cosim.scenario import Scenario
from regents_cosim.verdicts.careful.ego_path import ego_path
from regents_cosim.verdicts.careful.emergency_braking import EgoPositions, braking_positions
from regents_cosim.verdicts.careful.foresight import risks
from regents_cosim.verdicts.careful.others_around import OthersAround, OverlappedUsers, beyond_steps
from regents_cosim.verdicts.careful.safety_model_drives import SAFETY_MODELS, SafetyModel, braked_by
from regents_cosim.verdicts.careful.swerves import expected_swerve


def reference_drives(attacked: Scenario) -> tuple[ReferenceDrive, ...]:
    """The drives of all reference drivers in the crash of an attacked scenario; empty where there is no crash."""
    hit = attacked.attack.collision if attacked.attack else None
    if hit is None:
        return ()
    return _careful(attacked, hit)[0], *(_by_model(model, attacked, hit) for model in SAFETY_MODELS)


def careful_answer(attacked: Scenario) -> tuple[ReferenceDrive, EgoPositions] | None:
    """The careful driver's verdict and drive, also beyond the horizon; None without a crash."""
    hit = attacked.attack.collision if attacked.attack else None
    return None if hit is None else _careful(attacked, hit)


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


def _by_model(model: SafetyModel, attacked: Scenario, hit: Collision) -> ReferenceDrive:
    """The verdict of the fuzzy safety model or of RSS, which only brake."""
    path, adversary, dt = ego_path(attacked), _adversary(attacked, hit), attacked.dt
    braked = braked_by(model, attacked, path, adversary, hit.step)
    perceives_s, acts_s = (None if step is None else round(step * dt, 9) for step in (braked.perceived, braked.acts))
    if braked.acts is None:
        return ReferenceDrive(model.driver, False, perceives_s, acts_s)
    drive = braking_positions(attacked, path, braked.speed, braked.acts, 0.0, CAREFUL.swerve_m_s2)
    met = OthersAround(attacked, adversary).met_by(drive)
    if met.counts.any():
        return ReferenceDrive(model.driver, False, perceives_s, acts_s)
    return ReferenceDrive(model.driver, True, perceives_s, acts_s, rear_ended_by=_names(attacked, met))


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
