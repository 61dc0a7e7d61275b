"""The meaning of the codes in Waymo's files, in either of their two encodings, and of the words for them."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from regents_cosim.scenario import Kind
from regents_cosim.sources.logs.scene import LoggedLane, LoggedSignal

MPH = 0.44704  # [m/s]
KINDS: dict[int, Kind] = {1: "car", 2: "pedestrian", 3: "bicycle"}  # Track.ObjectType
LETTERS = {1: "r", 2: "y", 3: "G", 4: "r", 5: "y", 6: "G", 7: "s", 8: "o"}  # TrafficSignalLaneState, 0 unknown
UNKNOWN = "O"
_WORDS = {"flashing_stop": "s", "flashing_caution": "o", "stop": "r", "caution": "y", "go": "G"}
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
