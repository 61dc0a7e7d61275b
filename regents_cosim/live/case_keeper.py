"""Turns crashes of live attacks into ordinary, judged cases, in a folder or in memory.

A case holds all tracks until shortly after the contact. That time has not happened yet, so the prediction is appended:
a careful driver avoids a crash only if its drive leads on. `log` has the prediction at the begin of the attack
for the ego and the adversary, and the actual motion of all others.
"""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from regents_cosim.attacks.methods.presets import AttackConfig
from regents_cosim.cases.content_hash import content_hash
from regents_cosim.cases.manifest import listed_in
from regents_cosim.checks.names import distinct_word, file_name, word
from regents_cosim.live.attacker import Attack
from regents_cosim.live.host.interface import Frame
from regents_cosim.live.predict.forecast import FIELDS, Forecast
from regents_cosim.live.settings import LiveSettings
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.saving import SuiteWriter
from regents_cosim.scenario.attack_record import AttackRecord
from regents_cosim.scenario.collisions import collision_at, first_contact
from regents_cosim.scenario.scenario import Scenario, Signal, Tracks
from regents_cosim.sources.recording import Recording, gathered
from regents_cosim.sources.windows import RecordingOrigin, Windows, make_scenario
from regents_cosim.verdicts.judge import judge

TAIL_S = 2.0  # time after the contact in a case
_LABEL = 40  # longest name of a planner or an adversary in the id of a case


class CaseKeeper:
    """Saves cases to `output`, or collects them in `cases` if there is none.

    The folder stays where it was at first, since the user's program may change its working directory.
    """

    def __init__(self, settings: LiveSettings, planner: str, config: AttackConfig, output: Path | None) -> None:
        self._settings, self._planner, self._config = settings, planner, config
        self._writer = SuiteWriter(output.absolute(), settings.seed) if output is not None else None
        self.cases: list[Scenario] = []

    def keep(
        self,
        frames: list[Frame],
        step_s: float,
        road: RoadMap,
        source: RecordingOrigin,
        attack: Attack,
        after: Forecast,
    ) -> str:
        """Keep the case of some frames up to a crash, and of the forecast `after` it; return its id."""
        recording = _recording(frames, step_s, after, round(TAIL_S / step_s))
        horizon_s = max((recording.x.shape[1] - 1) * recording.dt, 1.0)
        reach = Windows(count=1, seed=self._settings.seed, horizon_s=horizon_s, radius_m=1e5)
        base = make_scenario(recording, recording.ids.index(frames[0].ids[0]), road, source, reach, Counter())
        case = self._attacked(base, recording.begin_s, attack)
        if self._settings.judged:
            case = judge(case)
        if self._writer is None:
            self.cases.append(case)
        else:
            case = _with_own_name(case, self._writer.folder)
            self._writer.add(case)
        return case.id

    def _attacked(self, base: Scenario, begin_s: float, attack: Attack) -> Scenario:
        """The case of an attack."""
        adversary, method = attack.plan.adversary, self._config.method
        agents = tuple(
            dataclasses.replace(agent, role="adversary") if agent.id == adversary else agent for agent in base.agents
        )
        contact, hit = first_contact(agents, base.tracks), None
        if contact is not None:
            hit = collision_at(agents, base.tracks, contact, base.dt, agents[contact[0]].id == adversary)
        record = AttackRecord(
            case=base.id,
            method=method,
            planner=self._planner,
            outcome="collision",
            iterations=attack.iterations,
            collision=hit,
            candidates=(adversary,),
            settings=self._config.noted | {"live": True, "replan_s": self._settings.replan_s},
            rollouts=attack.rollouts,
        )
        name = file_name(base.id, method, word(self._planner.rpartition(":")[2], _LABEL))
        name = file_name(name, distinct_word(adversary, _LABEL))
        log = _log(base, begin_s, base.dt, (base.ego.id, adversary), attack.before)
        return dataclasses.replace(base, id=name, agents=agents, attack=record, log=log)


def _with_own_name(case: Scenario, folder: Path) -> Scenario:
    """The case, with a number after its name where another crash of the folder has that name."""
    known = {entry.case: entry.hash for entry in listed_in(folder)}
    named, number = case, 1
    while known.get(named.id, "") not in ("", content_hash(named)):
        number += 1
        named = dataclasses.replace(case, id=file_name(case.id, str(number)))
    return named


def _recording(frames: Sequence[Frame], dt: float, after: Forecast, further: int) -> Recording:
    """The motion in the frames, extended by some steps of the forecast."""
    types = {name: kind for frame in frames for name, kind in zip(frame.ids, frame.types, strict=True)}
    rows = [
        (name, step, *state)
        for step, frame in enumerate(frames)
        for name, *state in zip(frame.ids, *(getattr(frame, key) for key in FIELDS), strict=True)
    ]
    times = frames[-1].time_s + np.arange(1, further + 1) * dt
    for name in filter(after.there, frames[-1].ids):
        foretold = after.at(name, times)
        steps = zip(*(foretold[key] for key in FIELDS), strict=True)
        rows += [(name, step, *state) for step, state in enumerate(steps, len(frames))]
    ids, valid, (x, y, yaw, z) = gathered(rows, len(frames) + further)
    lights = sorted({name for frame in frames for name in frame.lights})
    signals = tuple(Signal.of(name, _letters(name, frames, further)) for name in lights)
    return Recording(
        begin_s=round(frames[0].time_s, 6),
        dt=dt,
        ids=ids,
        types=tuple(types[name] for name in ids),
        valid=valid,
        signals=signals,
        x=x,
        y=y,
        yaw=yaw,
        z=z,
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
