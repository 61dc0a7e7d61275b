"""Turns a live attack into an ordinary case: all tracks until shortly after the contact.

The time after the contact has not happened yet, so the prediction is appended: a crash counts as avoidable if there was
a manoeuvre that leads on. `log` has the prediction at the begin of the attack for the ego and the adversary, and the
actual motion of all others.
"""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from regents_cosim.attack_record import AttackRecord, Outcome
from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.checks.names import distinct_word, file_name, word
from regents_cosim.collisions import collision_at, first_contact
from regents_cosim.live.host.frame import Frame
from regents_cosim.live.predict.forecast import FIELDS, Forecast
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario import Scenario, Signal, Tracks
from regents_cosim.sources.recording import Recording, changes
from regents_cosim.sources.windows import RecordedScene, RecordingOrigin, Windows, make_scenario

_LABEL = 40  # longest name of a planner or an adversary in the id of a case


@dataclass(frozen=True)
class AttackSummary:
    """How an attack went, for the record of its case."""

    adversary: str
    planner: str
    config: AttackConfig
    outcome: Outcome
    iterations: int
    rollouts: int
    replan_s: float
    source: RecordingOrigin
    seed: int = 0


def case_of(
    frames: Sequence[Frame],
    dt: float,
    road: RoadMap,
    attacked: AttackSummary,
    before: Forecast,
    after: Forecast,
    tail_s: float,
) -> Scenario:
    """The case of some frames. For a near miss `attacked.outcome` says that there was no collision."""
    recording = _recording(frames, dt, after, round(tail_s / dt))
    ego = recording.ids.index(frames[0].ids[0])
    scene = RecordedScene.of(recording)
    reach = Windows(count=1, seed=attacked.seed, horizon_s=max((recording.x.shape[1] - 1) * dt, 1.0), radius_m=1e5)
    base = make_scenario(scene, ego, road, attacked.source, reach, Counter())
    log = _log(base, recording.begin_s, dt, (base.ego.id, attacked.adversary), before)
    agents = tuple(
        dataclasses.replace(agent, role="adversary") if agent.id == attacked.adversary else agent
        for agent in base.agents
    )
    contact = first_contact(agents, base.tracks)
    hit = None
    if attacked.outcome == "collision" and contact is not None:
        hit = collision_at(agents, base.tracks, contact, dt, agents[contact[0]].id == attacked.adversary)
    record = AttackRecord(
        case=base.id,
        method=attacked.config.method,
        planner=attacked.planner,
        outcome=attacked.outcome,
        iterations=attacked.iterations,
        collision=hit,
        candidates=(attacked.adversary,),
        settings=attacked.config.noted | {"live": True, "replan_s": attacked.replan_s},
        rollouts=attacked.rollouts,
    )
    name = file_name(base.id, attacked.config.method, word(attacked.planner.rpartition(":")[2], _LABEL))
    name = file_name(name, distinct_word(attacked.adversary, _LABEL))
    return dataclasses.replace(base, id=name, agents=agents, attack=record, log=log)


def _recording(frames: Sequence[Frame], dt: float, after: Forecast, further: int) -> Recording:
    """The motion in the frames, extended by some steps of the forecast."""
    ids = sorted({name for frame in frames for name in frame.ids})
    row = {name: index for index, name in enumerate(ids)}
    types = {name: kind for frame in frames for name, kind in zip(frame.ids, frame.types, strict=True)}
    values = {key: np.zeros((len(ids), len(frames) + further)) for key in FIELDS}
    valid = np.zeros((len(ids), len(frames) + further), bool)
    for step, frame in enumerate(frames):
        at = [row[name] for name in frame.ids]
        for key in FIELDS:
            values[key][at, step] = getattr(frame, key)
        valid[at, step] = True
    times = frames[-1].time_s + np.arange(1, further + 1) * dt
    for name in frames[-1].ids:
        if after.there(name):
            foretold = after.at(name, times)
            for key in FIELDS:
                values[key][row[name], len(frames) :] = foretold[key]
            valid[row[name], len(frames) :] = True
    lights = sorted({name for frame in frames for name in frame.lights})
    signals = tuple(Signal(name, changes(_letters(name, frames, further))) for name in lights)
    return Recording(
        begin_s=round(frames[0].time_s, 6),
        dt=dt,
        ids=tuple(ids),
        types=tuple(types[name] for name in ids),
        valid=valid,
        signals=signals,
        x=values["x"],
        y=values["y"],
        yaw=values["yaw"],
        z=values["z"],
    )


def _letters(name: str, frames: Sequence[Frame], further: int) -> list[str]:
    """The letters of a light at every step; while it was out of sight, the next or last ones that were seen."""
    shown = [frame.lights.get(name) for frame in frames]
    now = next(letters for letters in shown if letters is not None)
    found = []
    for letters in shown:
        now = now if letters is None else letters
        found.append(now)
    return found + [now] * further


def _log(base: Scenario, begin_s: float, dt: float, names: Sequence[str], before: Forecast) -> Tracks:
    """The tracks, with those of some agents replaced by the prediction from then on."""
    tracks = base.tracks
    values = {key: getattr(tracks, key).copy() for key in (*FIELDS, "speed")}
    times = begin_s + np.arange(tracks.steps) * dt
    since = int(np.searchsorted(times, before.time_s + 1e-6))
    for name in names:
        if name in before.ids and since < tracks.steps:
            row = next(index for index, agent in enumerate(base.agents) if agent.id == name)
            foretold = before.at(name, times[since:])
            for key, one in values.items():
                one[row, since:] = np.where(tracks.valid[row, since:], foretold[key], 0.0)
    return Tracks(valid=tracks.valid, **values)
