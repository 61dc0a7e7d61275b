"""The offences of a pedestrian, each found by one small measure.

Source: Vienna Convention on Road Traffic (1968), art. 20(6): use a crossing where there is one nearby (a), obey its
lights (b)(i), and do not step onto the carriageway without regard to the distance and speed of approaching vehicles
(b)(iii), or so as to impede them (c). To impede is to make them brake abruptly (art. 1(z) on giving way): here, harder
than RSS expects of a careful driver.
"""

import numpy as np

from regents_cosim.norms.grades import OffenceName
from regents_cosim.norms.limits import MOVED_M, OFF_ROAD_M, safe_distance
from regents_cosim.scenario.scenario import RED, Scenario
from regents_cosim.verdicts.law.drive import AgentDrive, Measure, OffendingAct, logged, red_for_s
from regents_cosim.verdicts.law.priority import gives_no_way
from regents_cosim.verdicts.law.walking_ground import ground_of, has_green, knows_crossing_lights, steppings


def unknown_on_foot(attacked: Scenario) -> tuple[OffenceName, ...]:
    """The offences of a pedestrian that the map and the signals cannot show."""
    ground = ground_of(attacked)
    if ground is None:
        return ("off_crossing", "steps_out", "red_light", "gives_no_way")
    return () if knows_crossing_lights(attacked, ground) else ("red_light",)


def _off_crossing(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """Its centre is more than 0.3 m into the carriageway near a crossing, and on none."""
    ground = ground_of(drive.scenario)
    if ground is None:
        return None
    off = ground.off_m(drive.centre)
    return drive.lasting(off > OFF_ROAD_M, off, 1)


def _red_light(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It steps onto a crossing whose light is red; amount: how long the light had been red."""
    ground, scenario = ground_of(drive.scenario), drive.scenario
    for step, crossing in [] if ground is None else steppings(ground, drive):
        if step >= drive.since and scenario.shows(crossing.signal, crossing.link, step) in RED:
            return OffendingAct(step, 1, red_for_s(scenario, crossing, step))
    return None


def _steps_out(drive: AgentDrive, partner: AgentDrive | None) -> OffendingAct | None:
    """It steps onto the carriageway, or a crossing without a green light, nearer than the other needs to stop.

    The last such step before they meet counts, with the way that the other then drives; amount: the missing metres.
    """
    ground = ground_of(drive.scenario)
    if ground is None or partner is None:  # a log has no partner: see `stepped_in_log`
        return None
    on = ground.on_carriageway(drive.centre)
    stepped = np.flatnonzero(on[1:] & ~on[:-1]) + 1
    step = int(drive.steps[stepped[-1]]) if len(stepped) else -1
    if step < partner.steps[0] or has_green(drive.scenario, ground, drive.centre[stepped[-1]], step):
        return None
    since = int(np.searchsorted(partner.steps, step))
    short = safe_distance(float(partner.speed[since]), 0.0) - float(partner.moved_m[since + 1 :].sum())
    return OffendingAct(step, drive.last - step + 1, short) if short > 0.0 else None


def stepped_in_log(drive: AgentDrive, act: OffendingAct) -> bool:
    """Whether it moved like its log up to the step at which it stepped out."""
    log, own, upto = logged(drive.scenario, drive.agent).tracks, drive.agent, slice(act.step + 1)
    away = np.hypot(drive.tracks.x[own, upto] - log.x[own, upto], drive.tracks.y[own, upto] - log.y[own, upto])
    return not np.any(away > MOVED_M)


MEASURES_ON_FOOT: dict[OffenceName, tuple[Measure, str]] = {
    "off_crossing": (_off_crossing, "m"),
    "red_light": (_red_light, "s of red"),
    "steps_out": (_steps_out, "m too near"),
    "gives_no_way": (gives_no_way, "s ahead of the other"),
}
