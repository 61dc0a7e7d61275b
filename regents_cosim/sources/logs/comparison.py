"""Compares cases with the log that they were recorded from."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from regents_cosim.checks.names import file_name, word
from regents_cosim.errors import LogError, require
from regents_cosim.geometry.frames import wrap
from regents_cosim.scenario import Scenario
from regents_cosim.sources.comparison import Comparison
from regents_cosim.sources.logs.formats import ALONE, CompanionFiles
from regents_cosim.sources.logs.record import origin_of, scenes_of
from regents_cosim.sources.logs.resample import sample
from regents_cosim.sources.logs.scene import LoggedScene, Track

_STRAIGHT_S = 0.11  # between samples this close together, a straight line is exact to millimetres
_SAME = 1e-3  # of a step
_INSIDE_M = 0.01  # a recording applies its radius at its own instants


def compare_with_log(
    scenarios: Sequence[Scenario],
    log: Path,
    format: str = "auto",
    beside: CompanionFiles = ALONE,
    radius_m: float = 100.0,
) -> list[Comparison]:
    """Compare cases, as recorded, with logged traffic as its reader returns it, before windows are cut.

    A road user counts as missing where the log has it within `radius_m` of the ego, from centre to centre, and the case
    does not have it. Positions and headings are compared where the log has a sample at an instant of the case, or two
    samples around it that are at most 0.11 s apart.

    Raises LogError where the log cannot be read or does not hold the scene of a case.
    """
    cases = [(Comparison(one.id), one.before_attack()) for one in scenarios]
    met = set[str]()
    for file, name, scene in scenes_of(log, format, beside):
        origin = origin_of(file, name, scene)
        for found, case in cases:
            source = case.provenance
            begins = file_name(origin.name, f"{source.begin_s:07.1f}s", word(case.ego.id))
            if source.sha256 == origin.sha256 and case.id.startswith(begins):
                met.add(case.id)
                _compare(found, case, scene, radius_m)
    for _, case in cases:
        require(
            case.id in met,
            f"{log}: no scene of case {case.id}; expected {case.provenance.file} as it was when it was recorded",
            LogError,
        )
    return [found for found, _ in cases]


def _compare(found: Comparison, case: Scenario, scene: LoggedScene, radius_m: float) -> None:
    first = (case.provenance.begin_s - scene.begin_s) / scene.dt
    first = float(round(first)) if abs(first - round(first)) < _SAME else first
    rows = {agent.id: row for row, agent in enumerate(case.agents)}
    for track in scene.tracks:
        there = sample(track, scene.dt, first, case.tracks.steps)
        row = rows.get(track.agent.id)
        has = case.tracks.valid[row] if row is not None else np.zeros(case.tracks.steps, bool)
        away = np.hypot(there.x - case.tracks.x[0], there.y - case.tracks.y[0])
        lacking = int((there.valid & ~has & (away <= radius_m - _INSIDE_M)).sum())
        if lacking:
            found.missing[track.agent.id] += lacking
        if row is not None:
            _compare_track(found, case, row, track, scene.dt, first)


def _compare_track(found: Comparison, case: Scenario, row: int, track: Track, dt: float, first: float) -> None:
    agent, tracks = case.agents[row], case.tracks
    place = first + np.arange(tracks.steps) * (case.dt / dt)
    after = np.clip(np.searchsorted(track.step, place - _SAME), 0, len(track.step) - 1)
    exact = np.abs(track.step[after] - place) < _SAME
    before = np.maximum(after - 1, 0)
    between = (track.step[after] - track.step[before] == 1) & (track.step[before] < place) & (place < track.step[after])
    here = tracks.valid[row] & (exact | (between & (dt <= _STRAIGHT_S)))
    x, y, yaw = (np.interp(place, track.step, values) for values in track.motion)
    away = np.hypot(tracks.x[row] - x, tracks.y[row] - y)
    turned = np.rad2deg(np.abs(wrap(tracks.yaw[row] - yaw)))
    for at in np.flatnonzero(here).tolist():
        found.take(track.agent.id, float(away[at]), float(turned[at]))
    sizes = (agent.length - track.agent.length, agent.width - track.agent.width)
    found.take_size(track.agent.id, max(map(abs, sizes)))
