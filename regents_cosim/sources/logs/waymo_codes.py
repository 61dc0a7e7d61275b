"""The meaning of the codes in Waymo's files, in either of their two encodings, and of the words and stop signs in them.

Signs to stop name the lanes that they hold up, or only stand beside them. A lane that a sign holds up begins where the
sign stands, which is to its right; so do the other lanes of that approach, to the left of the first. In two files that
name the lanes, this finds eleven of the 14 that begin within 10 m of their sign, and no lane of which the file does not
say so, except beside signs for which it names none.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.checks.work import Work
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.geometry.lines import end_direction
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.scene import LoggedLane, LoggedSignal

MPH = 0.44704  # [m/s]
KINDS: dict[int, Kind] = {1: "car", 2: "pedestrian", 3: "bicycle"}  # Track.ObjectType
LETTERS = {1: "r", 2: "y", 3: "G", 4: "r", 5: "y", 6: "G", 7: "s", 8: "o"}  # TrafficSignalLaneState, 0 unknown
UNKNOWN = "O"
_WORDS = {
    "flashing_stop": "s", "flashing_caution": "o", "stop": "r", "caution": "y", "go": "G",
    "red": "r", "yellow": "y", "green": "G",  # in ScenarioNet's files of nuPlan
}  # fmt: skip
_LONGEST_WORD = 60


@lru_cache
def letter_of(state: str) -> str:
    """SUMO's letter for a light's state in words."""
    return next((letter for word, letter in _WORDS.items() if word in state[:_LONGEST_WORD].lower()), UNKNOWN)


def lights(
    letters: dict[str, list[str]], stops: dict[str, np.ndarray], lanes: Sequence[LoggedLane]
) -> tuple[LoggedSignal, ...]:
    """The signals by the lane that they control, at the end of the lane that is nearer to the stopping point."""
    known = {lane.id: lane for lane in lanes}
    found = []
    for name in sorted(letters):
        lane, stop = known.get(name), stops.get(name)
        at_start = True
        if lane is not None and stop is not None:
            from_start, from_end = (np.hypot(*(lane.centre[end] - stop[:2])) for end in (0, -1))
            at_start = bool(from_start <= from_end)
        found.append(LoggedSignal(name, "".join(letters[name]), (name,), at_start))
    return tuple(found)


# Of stop signs:
_ALONG_M = 2.0
_TO_THE_RIGHT_M = 1.0, 6.0
_NEXT_LANE_M = 2.0, 5.0
_SAME_WAY_RAD = np.deg2rad(20.0)


def stopping(
    lanes: Iterable[LoggedLane], named: Collection[str], places: Sequence[Float[np.ndarray, " 2"]], work: Work
) -> tuple[LoggedLane, ...]:
    """The lanes, those `named` by a sign, or with a sign at one of these `places` [m], with a sign to stop.

    `work` is asked before lanes and signs are compared.
    """
    lanes = tuple(lanes)
    held = np.array([lane.id in named for lane in lanes], bool)
    if lanes and len(places):
        held |= _held(lanes, np.stack(places), work)
    return tuple(replace(lane, approach="stops") if stops else lane for lane, stops in zip(lanes, held, strict=True))


def _held(lanes: tuple[LoggedLane, ...], places: Float[np.ndarray, "sign 2"], work: Work) -> Bool[np.ndarray, " lane"]:
    """Which lanes have a sign beside their begin, or beside that of a lane to their right."""
    work.spend("lanes x signs to stop", len(lanes), len(places))
    begin = np.stack([lane.centre[0] for lane in lanes])
    back = np.stack([end_direction(lane.centre[::-1]) for lane in lanes])
    yaw = np.arctan2(-back[:, 1], -back[:, 0])
    held = _beside(begin, yaw, places, _TO_THE_RIGHT_M).any(axis=1)
    nearby = held
    while nearby.any():
        work.spend("lanes x lanes with a sign to stop", len(lanes), int(nearby.sum()))
        right = _beside(begin, yaw, begin[nearby], _NEXT_LANE_M)
        right &= np.abs(wrap(yaw[:, None] - yaw[nearby])) < _SAME_WAY_RAD
        nearby = right.any(axis=1) & ~held
        held = held | nearby
    return np.asarray(held)


def _beside(
    begin: Float[np.ndarray, "lane 2"],
    yaw: Float[np.ndarray, " lane"],
    places: Float[np.ndarray, "place 2"],
    right_m: tuple[float, float],
) -> Bool[np.ndarray, "lane place"]:
    """Which places lie beside the begin of each lane, so far to its right."""
    away = places[None] - begin[:, None]
    ahead, left = ahead_and_left(np, away[..., 0], away[..., 1], yaw[:, None])
    return (np.abs(ahead) < _ALONG_M) & (-left > right_m[0]) & (-left < right_m[1])
