"""How often a careful driver brakes in ordinary traffic, where nothing happens, beside the crashes that it prevents."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from statistics import median
from unittest.mock import patch

import numpy as np
from jaxtyping import Bool

from regents_cosim.evaluation.statistics import percent, percent_interval
from regents_cosim.norms import foresight as norms
from regents_cosim.norms.careful import CAREFUL, FORESIGHT, careful_perceives, careful_reaction_steps
from regents_cosim.norms.grades import Conduct
from regents_cosim.scenario.collisions import first_contact
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.careful import foresight as verdicts
from regents_cosim.verdicts.careful.careful_driver import careful_verdict
from regents_cosim.verdicts.careful.ego_path import ego_path
from regents_cosim.verdicts.judge import up_to_date

_HARDER_M_S2 = 0.5  # than the ego's own braking
_HARD_M_S2 = 4.0


@dataclass(frozen=True)
class NeedlessBraking:
    """The braking of the careful driver in a window in which nothing happens."""

    times: int  # that it begins
    hardest_m_s2: float  # harder than the ego braked then; 0 without any
    lost_m_s: float  # speed, beyond what the ego itself lost meanwhile


@dataclass(frozen=True)
class ForesightRow:
    """What one foresight costs and brings."""

    ahead_s: float
    windows: int
    alarms: int  # windows in which the driver brakes
    alarms_percent: float
    alarms_interval: tuple[float, float]
    hard: int  # windows in which it brakes by more than 4 m/s^2
    each_hour: float  # alarms in an hour of driving
    hardest_m_s2: float  # median of the windows with an alarm
    lost_m_s: float
    crashes: int
    prevented: int
    prevented_percent: float
    prevented_interval: tuple[float, float]


@contextmanager
def looking_ahead(seconds: float) -> Iterator[None]:
    """Let the verdicts' careful driver look ahead so far [s]."""
    changed = replace(FORESIGHT, ahead_s=seconds)
    with patch.object(norms, "FORESIGHT", changed), patch.object(verdicts, "FORESIGHT", changed):
        yield


def careful_brakes(risk: Bool[np.ndarray, " time"], dt: float) -> Bool[np.ndarray, " time"]:
    """At which steps the careful driver brakes, each decided by the dangers up to that step alone."""
    reaction = int(careful_reaction_steps(np, dt))
    since = [int(careful_perceives(np, risk, dt, step)) for step in range(len(risk))]
    return np.array([begin + reaction <= step for step, begin in enumerate(since)], bool)


def needless_braking(window: Scenario) -> NeedlessBraking:
    """The braking for any of the others beyond that of the recorded ego, as long as the driver believes a danger."""
    others, steps, dt = range(1, len(window.agents)), window.tracks.steps, window.dt
    risks = verdicts.all_risks(window, ego_path(window), others, steps)
    brakes = np.any([careful_brakes(risk, dt) for risk in risks], axis=0)
    own = np.append(np.maximum(-np.diff(window.tracks.speed[0]) / dt, 0.0), 0.0)
    braking = np.zeros(steps)
    for step in np.flatnonzero(brakes):
        braking[step] = min(braking[step - 1] * (step > 0) + CAREFUL.jerk_m_s3 * dt, CAREFUL.most_braking_m_s2)
    more = braking > own + _HARDER_M_S2
    begun = int((np.diff(brakes.astype(int), prepend=0) > 0).sum()) if more.any() else 0
    lost = min(float((braking - own)[more].sum()) * dt, float(window.tracks.speed[0].max()))
    return NeedlessBraking(begun, float(braking[more].max(initial=0.0)), lost)


def foresight_rows(
    windows: Sequence[Scenario], crashes: Sequence[Scenario], ahead_s: Sequence[float]
) -> list[ForesightRow]:
    """A row for each foresight [s]; windows in which the ego collides, and crashes that say nothing, are left out."""
    calm = [window for window in windows if first_contact(window.agents, window.tracks) is None]
    judged = [up_to_date(case) for case in crashes]
    told = [case for case in judged if (one := case.judgement) and one.clean and one.conduct is not Conduct.GROSS]
    return [_row(calm, told, seconds) for seconds in ahead_s]


def _row(windows: Sequence[Scenario], crashes: Sequence[Scenario], ahead_s: float) -> ForesightRow:
    with looking_ahead(ahead_s):
        found = [one for window in windows if (one := needless_braking(window)).times]
        drives = [drive for case in crashes if (drive := careful_verdict(case)[0])]
    prevented = sum(drive.avoids and not drive.shift_m for drive in drives)
    hours = sum(window.dt * (window.tracks.steps - 1) for window in windows) / 3600.0
    return ForesightRow(
        ahead_s,
        len(windows),
        len(found),
        percent(len(found), len(windows)),
        percent_interval(len(found), len(windows)),
        sum(one.hardest_m_s2 > _HARD_M_S2 for one in found),
        sum(one.times for one in found) / max(hours, 1e-9),
        median([one.hardest_m_s2 for one in found] or [0.0]),
        median([one.lost_m_s for one in found] or [0.0]),
        len(drives),
        prevented,
        percent(prevented, len(drives)),
        percent_interval(prevented, len(drives)),
    )
