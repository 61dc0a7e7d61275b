"""Compares cases with where they come from: SUMO's own log of the same run, or the log that they were recorded from."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from regents_cosim.checks.names import file_name, word
from regents_cosim.geometry.frames import Pose, SumoPose, to_sumo, wrap
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.fcd import LoggedState, logged_instants
from regents_cosim.sources.logs.formats import ALONE
from regents_cosim.sources.logs.record import origin_of, scenes_of
from regents_cosim.sources.logs.resample import sample
from regents_cosim.sources.logs.scene import LoggedScene, Track

_SAME_INSTANT_S = 1e-4
_RADIUS_M = 100.0
_MARGIN_M = 12.0  # half of a car and half of a bus


@dataclass
class Comparison:
    """The comparison of a case with its source: the states of all road users within a radius of the ego."""

    case: str
    compared: int = 0  # states that are in both
    missing: Counter[str] = field(default_factory=Counter)  # by id: instants that are in the log but not in the case
    farthest_m: float = 0.0  # the largest distance between the front bumpers of one road user
    farthest: str = ""  # id of that road user
    most_turned_deg: float = 0.0  # the largest difference of headings
    most_turned: str = ""
    most_resized_m: float = 0.0  # the largest difference of lengths or widths; an fcd-output has none
    most_resized: str = ""

    def take(self, name: str, away_m: float, turned_deg: float) -> None:
        """Count a state that is in both."""
        self.compared += 1
        if away_m > self.farthest_m:
            self.farthest_m, self.farthest = away_m, name
        if turned_deg > self.most_turned_deg:
            self.most_turned_deg, self.most_turned = turned_deg, name

    def take_size(self, name: str, off_m: float) -> None:
        """Compare the size of a road user that is in both."""
        if off_m > self.most_resized_m:
            self.most_resized_m, self.most_resized = off_m, name

    def unexplained(self, scenario: Scenario) -> dict[str, int]:
        """The missing road users, without those that the case itself lists as left out."""
        entries = scenario.provenance.left_out
        named = {name for one in entries if one.reason != "guessed" for name in one.ids}
        return {name: count for name, count in self.missing.items() if name not in named}


def compare_with_fcd(scenarios: Sequence[Scenario], log: Path) -> list[Comparison]:
    """Compare cases, as recorded, with an fcd-output (.xml, .csv, .gz) of the run that they come from.

    Positions are compared at the front bumper, so a wrong size shows as well. A road user counts as missing where the
    log has its front within 100 m - 12 m of the ego's front and the case does not have it at that instant; the 12
    m are there because a recording measures its radius from centre to centre. Persons in vehicles are not compared.
    """
    cases = [(Comparison(one.id), one.before_attack()) for one in scenarios]
    met = set[str]()
    for time_s, states, _ in logged_instants(log):
        for found, case in cases:
            step = _step_at(case, time_s)
            if step is not None:
                met.add(case.id)
                _compare(found, case, step, states)
    assert met == {case.id for _, case in cases}
    return [found for found, _ in cases]


def _step_at(case: Scenario, time_s: float) -> int | None:
    """The step of a case at a time of its source [s]; None between its steps and outside of the case."""
    place = (time_s - case.provenance.begin_s) / case.dt
    step = round(place)
    return step if abs(place - step) * case.dt < _SAME_INSTANT_S and 0 <= step < case.tracks.steps else None


def _compare(found: Comparison, scenario: Scenario, step: int, states: list[LoggedState]) -> None:
    fronts = _fronts(scenario, step)
    ego = fronts[scenario.ego.id][0]
    for state in states:
        mine = fronts.get(state.name)
        if mine is None:
            if _distance(state, ego) <= _RADIUS_M - _MARGIN_M:
                found.missing[state.name] += 1
            continue
        nearest = min(mine, key=lambda pose: _distance(state, pose))
        turned_deg = abs((float(nearest.angle) - state.angle + 180.0) % 360.0 - 180.0)
        found.take(state.name, _distance(state, nearest), turned_deg)


def _fronts(scenario: Scenario, step: int) -> dict[str, list[SumoPose]]:
    """The front bumper of every road user as SUMO would report it; one id may stand for a vehicle and a person."""
    found: dict[str, list[SumoPose]] = {}
    tracks = scenario.tracks
    for row, agent in enumerate(scenario.agents):
        if tracks.valid[row, step]:
            pose = Pose(*(float(values[row, step]) for values in (tracks.x, tracks.y, tracks.yaw)))
            for name in {agent.id, agent.id.rpartition("#")[0] or agent.id}:
                found.setdefault(name, []).append(to_sumo(pose, agent.length))
    return found


def _distance(state: LoggedState, pose: SumoPose) -> float:
    """The distance between two fronts [m]."""
    return float(np.hypot(state.x - pose.x, state.y - pose.y))


_STRAIGHT_S = 0.11  # between samples this close together, a straight line is exact to millimetres
_SAME = 1e-3  # of a step
_INSIDE_M = 0.01  # a recording applies its radius at its own instants


def compare_with_log(scenarios: Sequence[Scenario], log: Path) -> list[Comparison]:
    """Compare cases, as recorded, with logged traffic as its reader returns it, before windows are cut.

    A road user counts as missing where the log has it within 100 m of the ego, from centre to centre, and the case
    does not have it. Positions and headings are compared where the log has a sample at an instant of the case, or two
    samples around it that are at most 0.11 s apart.
    """
    cases = [(Comparison(one.id), one.before_attack()) for one in scenarios]
    met = set[str]()
    for file, name, scene in scenes_of(log, "auto", ALONE):
        origin = origin_of(file, name, scene)
        for found, case in cases:
            source = case.provenance
            begins = file_name(origin.name, f"{source.begin_s:07.1f}s", word(case.ego.id))
            if source.sha256 == origin.sha256 and case.id.startswith(begins):
                met.add(case.id)
                _compare_scene(found, case, scene)
    assert met == {case.id for _, case in cases}
    return [found for found, _ in cases]


def _compare_scene(found: Comparison, case: Scenario, scene: LoggedScene) -> None:
    first = (case.provenance.begin_s - scene.begin_s) / scene.dt
    first = float(round(first)) if abs(first - round(first)) < _SAME else first
    rows = {agent.id: row for row, agent in enumerate(case.agents)}
    for track in scene.tracks:
        there = sample(track, scene.dt, first, case.tracks.steps)
        row = rows.get(track.agent.id)
        has = case.tracks.valid[row] if row is not None else np.zeros(case.tracks.steps, bool)
        away = np.hypot(there.x - case.tracks.x[0], there.y - case.tracks.y[0])
        lacking = int((there.valid & ~has & (away <= _RADIUS_M - _INSIDE_M)).sum())
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
