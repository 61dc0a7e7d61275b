"""Choose the evasion to show: the careful driver's own drive where that avoids the crash, otherwise one of the bank.

If the verdict said that a careful driver avoids a crash and the evasion shown were not its drive, there would be two
answers to one question. So where the careful driver avoids the crash (`reference_drivers`), the evasion is its drive,
and the crash is avoidable in time, since it uses only what can be seen. Followers that replay a log into its back are
noted and do not count, as in its verdict. The bank of manoeuvres (`avoidability`) gives the last chance, and the
evasion where the careful driver crashes too.

A last-moment swerve that passes by a hair convinces nobody: among 52 stills, 6 of the 7 implausible evasions were of
this kind. Where the careful driver swerves and keeps less than the margin of the bank, a manoeuvre of the bank that
keeps it and is in time is shown instead.
"""

from dataclasses import replace

import numpy as np

from regents_cosim.judgement import Avoidability, Manoeuvre, ReferenceDrive
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.scenario import Scenario, Tracks
from regents_cosim.verdicts.careful.ego_path import EgoPositions
from regents_cosim.verdicts.careful.others_around import OthersAround
from regents_cosim.verdicts.careful.reference_drivers import careful_answer
from regents_cosim.verdicts.escape.avoidability import MARGIN_M, TriedManoeuvres
from regents_cosim.verdicts.escape.manoeuvres import FRICTION, GRAVITY, ManoeuvreSet


def way_out(attacked: Scenario) -> tuple[Avoidability, Tracks | None]:
    """Whether the crash can be avoided, and how a careful driver does it, with the track [1, time] of that drive.

    Raises ScenarioError where there is no collision.
    """
    tried, answer = TriedManoeuvres.of(attacked), careful_answer(attacked)
    careful = answer if answer is not None and answer[0].avoids else None
    if careful is not None and (not careful[0].shift_m or _leaves_room(attacked, careful[1])):
        return _careful(attacked, tried, *careful)
    found = tried.preferred() if tried.evading else (tried.verdict, None)
    return found if careful is None or found[0].in_time else _careful(attacked, tried, *careful)


def _leaves_room(attacked: Scenario, way: EgoPositions) -> bool:
    """Whether a drive that avoids the crash keeps the margin of the bank to everyone."""
    hit = attacked.attack.collision if attacked.attack else None
    adversary = next(index for index, agent in enumerate(attacked.agents) if hit and agent.id == hit.agent)
    return not OthersAround(attacked, adversary, MARGIN_M).met_by(way).counts.any()


def _careful(
    attacked: Scenario, tried: TriedManoeuvres, drive: ReferenceDrive, way: EgoPositions
) -> tuple[Avoidability, Tracks]:
    perceives, acts = _step(drive.perceives_s, attacked.dt), _step(drive.acts_s, attacked.dt)
    one, bank = _as_set(way, acts, drive.shift_m), tried.verdict
    track = one.tracks(0, attacked)
    manoeuvre = Manoeuvre(
        onset_step=acts,
        accel=-CAREFUL.most_braking_m_s2,
        lasting_s=None,
        lateral_accel=float(np.sign(drive.shift_m)) * CAREFUL.swerve_m_s2,
        shift=drive.shift_m,
        friction_share=_friction_share(track, acts),
        driver=drive.driver,
    )
    verdict = replace(
        bank,
        avoidable=True,
        last_onset_step=max(acts, bank.last_onset_step or 0),
        gentlest=tried.placed(one, manoeuvre),
        in_time=True,
        perceived_step=min(perceives, tried.preference.perceived),
    )
    return verdict, track


def _step(seconds: float | None, dt: float) -> int:
    """The step of an instant [s] of a drive that has perceived the danger and acts."""
    assert seconds is not None
    return round(seconds / dt)


def _as_set(way: EgoPositions, acts: int, shift_m: float) -> ManoeuvreSet:
    """The drive as the only manoeuvre of a set, so that it can be placed like those of the bank."""
    x, y, yaw, speed = (values[None, acts:] for values in (way.x, way.y, way.yaw, way.speed))
    braking, aside = np.zeros(1, int), np.full(1, int(shift_m != 0.0))
    return ManoeuvreSet(acts, braking, aside, np.full(1, np.nan), x, y, yaw, speed)


def _friction_share(track: Tracks, onset: int) -> float:
    """The greatest friction from the onset on, as a share of sliding tyres'; above 1 it needs tyres at their best."""
    assert track.accel is not None
    assert track.curvature is not None
    speed = 0.5 * (track.speed[0, 1:] + track.speed[0, :-1])
    used = np.hypot(track.accel[0], speed**2 * track.curvature[0])[onset:]
    return float(used.max() / (FRICTION * GRAVITY))
