"""Cuts a LoggedScene into Scenarios: chooses the windows and the ego of each.

The ego is the recorder's own vehicle or the one of a planning problem. Where the log names none, and in windows in
which it stands, the ego is drawn by seed, one per window, from the vehicles that satisfy the rules of
`windows.choose_windows`, except that one other moving vehicle within 50 m is enough.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Int

from regents_cosim.checks.ranges import Range
from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.jumps import jumps
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import VEHICLE_KINDS, LeftOut, Scenario, Signal
from regents_cosim.simulators import STEP_S
from regents_cosim.simulators.sumo.types import VehicleType
from regents_cosim.sources.logs.resample import sample
from regents_cosim.sources.logs.roads.road import build_road
from regents_cosim.sources.logs.scene import LoggedScene, Track
from regents_cosim.sources.recording import Recording
from regents_cosim.sources.windows import RecordingOrigin, Windows, egos, make_scenario, other_kind, preferred, stands

_STRIDE = Range(0.1, 1e6, "seconds from one window to the next")
_COMPANY = 1
_LEAST_SAMPLES = 3
_SHORTEST_S = 0.5
_NEAR_M = 10.0  # between tracks this close, a difference in height means a bridge


@dataclass(frozen=True)
class LogWindows:
    """The windows to cut from a log: at most `windows.horizon_s` long, one every `stride_s` (None: back to back)."""

    windows: Windows = field(default_factory=Windows)
    stride_s: float | None = None
    ego: str = "auto"  # auto, or an id of the log

    def __post_init__(self) -> None:
        if self.stride_s is not None:
            _STRIDE.check("`stride`", self.stride_s)

    def ego_of(self, scene: LoggedScene) -> str | None:
        """The id of the ego; None where the log does not name one."""
        return scene.ego if self.ego == "auto" else self.ego

    def instants(self, scene: LoggedScene) -> int:
        """The number of instants in a window of `scene`: the horizon, or the time of the ego or scene if shorter."""
        ego = self.ego_of(scene)
        steps = scene.last_step - scene.first_step
        if ego is not None:
            mine = next((track for track in scene.tracks if track.agent.id == ego), None)
            pieces = without_jumps(mine, scene.dt).pieces() if mine else ()
            steps = max((last - first for first, last in pieces), default=0)
        return min(self.windows.steps(STEP_S), int(steps * scene.dt / STEP_S + 1e-6) + 1)


def cut(scene: LoggedScene, asked: LogWindows, origin: RecordingOrigin, refused: Counter[str]) -> Iterator[Scenario]:
    """The windows of `scene` in the order of time, one Scenario each; `refused` counts the rejected vehicles by reason.

    A scene shorter than the horizon gives one window of its own length. Raises LogError where no road can be found.
    """
    ego, instants = asked.ego_of(scene), asked.instants(scene)
    if ego is not None and all(track.agent.id != ego for track in scene.tracks):
        refused[f"were not named {ego!r}"] += len(scene.tracks)
        return
    if (instants - 1) * STEP_S < _SHORTEST_S:
        refused[f"were in recordings shorter than {_SHORTEST_S} s"] += len(scene.tracks)
        return
    traffic = _SceneWindows(scene, instants)
    stride = (asked.stride_s or (instants - 1) * STEP_S) / scene.dt
    road: RoadMap | None = None
    taken: Counter[str] = Counter()
    for first_step in traffic.windows(ego, stride):
        slot = traffic.slot(first_step)
        road = road or build_road(scene)
        seed = (asked.windows.seed, int(first_step))
        rests = asked.ego == "auto" and ego is not None and _rests(slot, ego)
        chosen = _ego(slot, None if rests else ego, road, replace(asked.windows, company=_COMPANY), seed, refused)
        if chosen is not None:
            slot = traffic.without_bridges(slot, chosen)
            chosen = slot.ids.index(chosen)
            window = make_scenario(slot, chosen, road, origin, asked.windows, taken)
            aimed = scene.target is not None and window.ego.id == scene.ego
            yield replace(window, target=scene.target) if aimed else window


def _rests(slot: Recording, ego: str) -> bool:
    """Whether the log's ego stands throughout a window: nobody can be asked to crash into it."""
    return ego in slot.ids and bool(slot.valid[slot.ids.index(ego)].all()) and stands(slot, slot.ids.index(ego))


def _ego(
    slot: Recording, wanted: str | None, road: RoadMap, windows: Windows, seed: Sequence[int], refused: Counter[str]
) -> str | None:
    ids = slot.ids
    if wanted is not None:
        reason = "were not there throughout"
        if wanted in ids and slot.valid[ids.index(wanted)].all():
            reason = other_kind(slot, ids.index(wanted), windows)
        if reason is not None:
            refused[reason] += 1
        return wanted if reason is None else None
    order = np.random.default_rng(seed).permutation(len(ids))
    queue = egos(slot, road, windows, order, refused)
    return next((ids[ego] for _, ego in preferred({0: queue}, [slot], road, windows)), None)


# --- windows ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _SceneWindows:
    """A scene and the length of its windows."""

    scene: LoggedScene
    instants: int

    @cached_property
    def _span(self) -> float:
        """The length of a window in steps of the log."""
        return (self.instants - 1) * STEP_S / self.scene.dt

    @cached_property
    def _tracks(self) -> tuple[Track, ...]:
        """All tracks, sorted by id, without jumps."""
        smooth = (without_jumps(track, self.scene.dt) for track in self.scene.tracks)
        return tuple(sorted(smooth, key=lambda track: track.agent.id))

    @cached_property
    def _cuts(self) -> dict[str, Int[np.ndarray, " cut"]]:
        """By id: the steps that were removed from tracks that jump."""
        left = {track.agent.id: track.step for track in self._tracks}
        cuts = {one.agent.id: np.setdiff1d(one.step, left[one.agent.id], True) for one in self.scene.tracks}
        return {name: steps for name, steps in cuts.items() if len(steps)}

    @cached_property
    def _ends(self) -> tuple[Int[np.ndarray, " track"], Int[np.ndarray, " track"]]:
        first, last = (np.array([track.step[end] for track in self._tracks]) for end in (0, -1))
        return first, last

    def windows(self, ego: str | None, stride: float) -> list[float]:
        """First steps of the windows in which a possible ego is present without a gap.

        They begin with each piece of the ego's track; where no ego is named, they lie on one grid from the first track
        on.
        """
        may = [t for t in self._tracks if (t.agent.id == ego if ego else t.agent.kind in VEHICLE_KINDS)]
        origin = min((int(t.step[0]) for t in may), default=0)
        found: set[float] = set()
        for track in may:
            for first, last in track.pieces():
                begin = first if ego else origin
                low, high = (first - begin) / stride, (last - self._span - begin) / stride
                found.update(
                    begin + k * stride for k in range(int(np.ceil(low - 1e-6)), int(np.floor(high + 1e-6)) + 1)
                )
        return sorted(found)

    def slot(self, first_step: float) -> Recording:
        """All road users in the window that begins at `first_step`."""
        first, last = self._ends
        there = (first <= first_step + self._span) & (last >= first_step)
        here = [self._tracks[i] for i in np.flatnonzero(there)]
        samples = [sample(track, self.scene.dt, first_step, self.instants) for track in here]
        kept = [(track, found) for track, found in zip(here, samples, strict=True) if found.valid.any()]
        tracks, samples = zip(*kept, strict=True)
        x, y, yaw, valid = map(np.stack, zip(*samples, strict=True))
        last_step = first_step + self._span
        jumped = (name for name, cut in self._cuts.items() if ((first_step <= cut) & (cut <= last_step)).any())
        return Recording(
            round(self.scene.begin_s + first_step * self.scene.dt, 6),
            STEP_S,
            tuple(track.agent.id for track in tracks),
            tuple(VehicleType(t.agent.kind, t.agent.length, t.agent.width) for t in tracks),
            x,
            y,
            yaw,
            valid,
            self._signals(first_step),
            guessed=frozenset(track.agent.id for track in tracks if track.guessed),
            jumped=frozenset(jumped),
            left_out=self.scene.left_out,
        )

    def _signals(self, first_step: float) -> tuple[Signal, ...]:
        step = np.floor(first_step + np.arange(self.instants) * STEP_S / self.scene.dt + 1e-6).astype(int)
        return tuple(Signal.of(light.id, light.shown(step)) for light in self.scene.signals if light.letters)

    def without_bridges(self, slot: Recording, ego: str) -> Recording:
        """The slot without road users that pass above or below the ego."""
        tracks = {track.agent.id: track for track in self._tracks}
        mine = tracks[ego]
        kept = np.array([not _on_another_level(mine, tracks[name]) for name in slot.ids])
        if kept.all():
            return slot
        here = np.flatnonzero(kept)
        away = tuple(slot.ids[i] for i in np.flatnonzero(~kept))
        return replace(
            slot,
            ids=tuple(slot.ids[i] for i in here),
            types=tuple(slot.types[i] for i in here),
            x=slot.x[kept],
            y=slot.y[kept],
            yaw=slot.yaw[kept],
            valid=slot.valid[kept],
            left_out=(*slot.left_out, LeftOut("level", len(away), away, "they pass above or below the ego")),
        )


def without_jumps(track: Track, dt: float) -> Track:
    """The track with a gap where it jumps; pieces of fewer than 3 samples between jumps are removed.

    Boxes are cut off where a vehicle enters the picture of a drone, and detections leap. The bicycle model can follow
    neither, and its error would last for the rest of the window: the fit of highD's vehicles would be off by up to 116
    m.
    """
    if len(track.step) < _LEAST_SAMPLES:
        return track
    links = np.diff(track.step) == 1
    leaps = np.flatnonzero(jumps(track.x[None], track.y[None], links[None], dt)[0]) + 1
    if not len(leaps):
        return track
    kept = np.ones(len(track.step), bool)
    kept[leaps] = False  # the gap
    for first, end in pairwise([0, *leaps.tolist(), len(kept)]):
        if end - first < _LEAST_SAMPLES:
            kept[first:end] = False
    if not kept.any():
        return track
    z = None if track.z is None else track.z[kept]
    x, y, yaw = track.x[kept], track.y[kept], track.yaw[kept]
    return replace(track, step=track.step[kept], x=x, y=y, yaw=yaw, z=z)


def _on_another_level(ego: Track, other: Track) -> bool:
    """Whether two tracks come near each other at heights too different for one road."""
    if ego.z is None or other.z is None or ego is other:
        return False
    common, mine, theirs = np.intersect1d(ego.step, other.step, assume_unique=True, return_indices=True)
    if not len(common):
        return False
    near = np.hypot(ego.x[mine] - other.x[theirs], ego.y[mine] - other.y[theirs]) < _NEAR_M
    apart = ~np.asarray(same_level(ego.z[mine], other.z[theirs]))
    return bool((near & apart).any())
