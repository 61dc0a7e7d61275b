"""Waymo Open Motion as `tf.Example`: flattened scenarios with at most 128 agents and 20000 map points.

The map is a cloud of points with the id of their feature. Kerbs are assembled from it, with breaks where points are far
apart, because the cloud may be cropped or thinned out.
"""

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.checks.work import Work
from regents_cosim.geometry.lines import steps_along
from regents_cosim.sources.logs.files.protobuf import Message, float_values, grouped, messages, numbers
from regents_cosim.sources.logs.roads.road import crossings_of
from regents_cosim.sources.logs.rows import require_steady, rows_by
from regents_cosim.sources.logs.scene import (
    LoggedLane,
    LoggedMap,
    LoggedScene,
    LoggedSignal,
    RoadEdge,
    Track,
    dense_track,
    joined,
)
from regents_cosim.sources.logs.waymo_codes import KINDS, LETTERS, UNKNOWN, lights, stopping

_AGENTS = 128
_DT = 0.1
_PARTS = ("past", "current", "future")
_LIGHTS = 16
_LANES, _EDGES = (1, 2), (15, 16)  # freeway and street; boundary and median
_STOP, _CROSSWALK = 17, 18
_FAR = 6.0  # times the usual distance between points: there a line is broken


class _Features:
    """The features of an Example by name."""

    def __init__(self, top: dict[int, list[int | Message]]) -> None:
        self._found: dict[str, Message] = {}
        for features in messages(top[1]):
            for entry in messages(grouped(features)[1]):
                pair = grouped(entry)
                self._found[str(messages(pair[1])[-1], "utf-8")] = messages(pair[2])[-1]

    def __contains__(self, name: str) -> bool:
        return name in self._found

    def __call__(self, name: str, least: int = 0) -> Float[np.ndarray, " value"]:
        """A numeric feature without its non-numeric values. Raises ValueError where it is absent or too short."""
        if name not in self._found:
            raise ValueError(f"no feature {name} (expected the tf.Example of Waymo Open Motion)")
        kinds = grouped(self._found[name])
        values = [np.array(numbers(grouped(m)[1]), float) for m in messages(kinds[3])]
        values += [float_values(grouped(m)[1], "<f4") for m in messages(kinds[2])]
        found = np.concatenate(values) if values else np.zeros(0)
        if len(found) < least:
            raise ValueError(f"feature {name} has {len(found)} values, expected at least {least}")
        return found

    def text(self, name: str) -> str:
        """A text feature; empty where absent."""
        if name not in self._found:
            return ""
        found = [m for m in messages(grouped(self._found[name])[1])]
        return "".join(str(value, "utf-8", "replace") for m in found[:1] for value in messages(grouped(m)[1])[:1])

    def over_time(self, group: str, name: str, rows: int) -> Float[np.ndarray, "row time"]:
        """Past, current and future of a feature, joined along time; files to be predicted have no future."""
        parts = []
        for part in (one for one in _PARTS if one == "current" or f"{group}/{one}/{name}" in self):
            values = self(f"{group}/{part}/{name}")
            if len(values) % rows:
                raise ValueError(f"feature {group}/{part}/{name} has {len(values)} values for {rows} rows")
            parts.append(values.reshape(rows, -1))
        return np.concatenate(parts, axis=1)


def read_example(top: dict[int, list[int | Message]], name: str, work: Work) -> LoggedScene:
    """Read the scenario of one Example."""
    features = _Features(top)
    tracks, ego = _tracks(features)
    road = _map(features, work)
    return LoggedScene(
        name=features.text("scenario/id") or name,
        dt=_DT,
        tracks=tracks,
        road=road,
        ego=ego,
        signals=_signals(features, road.lanes, work),
        notes=("a tf.Example holds at most 128 agents and 20000 map points; kerbs may be missing",),
    )


def _tracks(features: _Features) -> tuple[tuple[Track, ...], str | None]:
    state = {
        key: features.over_time("state", key, _AGENTS)
        for key in ("x", "y", "z", "bbox_yaw", "length", "width", "valid")
    }
    names = features("state/id", _AGENTS)
    kinds, is_ego = features("state/type", _AGENTS), features("state/is_sdc", _AGENTS)
    there = state["valid"] > 0
    _require_on_time(features, there)
    found, ego = [], None
    for row in np.flatnonzero(there.any(axis=1)):
        name, kind = f"{names[row]:.0f}", KINDS.get(int(kinds[row]), "other")
        length, width, *motion = (state[key][row] for key in ("length", "width", "x", "y", "bbox_yaw", "z"))
        found.append(dense_track(name, kind, (length, width), there[row], *motion))
        ego = name if is_ego[row] == 1 else ego
    return tuple(found), ego


def _require_on_time(features: _Features, there: Bool[np.ndarray, "row time"]) -> None:
    """Raise LogError where the time stamps of a road user, if the file has any, do not lie on the steps."""
    if "state/current/timestamp_micros" not in features:
        return
    stamps = 1e-6 * features.over_time("state", "timestamp_micros", _AGENTS)
    if stamps.shape != there.shape:
        raise ValueError(f"{stamps.shape[1]} time stamps for {there.shape[1]} steps")
    for row in np.flatnonzero(there.any(axis=1)):
        step = np.flatnonzero(there[row])
        left_out = step - np.arange(len(step))
        require_steady(stamps[row, step] - _DT * left_out, _DT)


def _map(features: _Features, work: Work) -> LoggedMap:
    xyz = features("roadgraph_samples/xyz")
    points = xyz.reshape(-1, 3)
    kind, name, valid = (features(f"roadgraph_samples/{key}", len(points)) for key in ("type", "id", "valid"))
    there = np.flatnonzero(valid > 0)
    if not np.isfinite(name[there]).all():
        raise ValueError("the id of a map feature is not a number")
    lanes, edges, crossings, signs = [], [], [], []
    for number, at in rows_by(name[there]).items():
        line, what = points[there[at]], int(kind[there[at[0]]])
        if what in _EDGES:
            edges += [RoadEdge(part[:, :2], part[:, 2]) for part in _unbroken(line)]
        elif what == _STOP:
            signs.append(line[0, :2])
        elif what == _CROSSWALK:
            crossings.append(line)
        elif what in _LANES:
            parts = _unbroken(line)
            lanes += [
                LoggedLane(f"{number:.0f}" + (f"-{i}" if i else ""), part[:, :2], z=part[:, 2])
                for i, part in enumerate(parts)
            ]
    told = crossings_of(crossings) or None  # it may be among the points that are left out
    return LoggedMap(joined(stopping(lanes, (), signs, work), work), tuple(edges), crossings=told)


def _unbroken(line: Float[np.ndarray, "point 3"]) -> list[Float[np.ndarray, "_ 3"]]:
    if len(line) < 2:
        return []
    apart = steps_along(*line[:, :2].T)
    breaks = np.flatnonzero(apart > max(_FAR * float(np.median(apart)), 3.0)) + 1
    return [part for part in np.split(line, breaks) if len(part) > 1]


def _signals(features: _Features, lanes: tuple[LoggedLane, ...], work: Work) -> tuple[LoggedSignal, ...]:
    """Up to 16 lights per instant, each with the lane that it controls."""
    letters: dict[str, list[str]] = {}
    stops: dict[str, np.ndarray] = {}
    parts = [part for part in _PARTS if f"traffic_light_state/{part}/state" in features]
    keys = ("id", "state", "valid", "x", "y")
    rows = [np.stack([features(f"traffic_light_state/{part}/{key}") for key in keys]) for part in parts]
    instants = np.concatenate(rows, axis=1).reshape(len(keys), -1, _LIGHTS) if rows else np.zeros((len(keys), 0, 0))
    for step in range(instants.shape[1]):
        for name, state, valid, x, y in instants[:, step].T:
            if valid > 0:
                lane = f"{name:.0f}"
                if lane not in letters:
                    work.spend("instants of one more light", instants.shape[1])
                    letters[lane] = [UNKNOWN] * instants.shape[1]
                letters[lane][step] = LETTERS.get(int(state), UNKNOWN)
                stops[lane] = np.array([x, y])
    return lights(letters, stops, lanes)
