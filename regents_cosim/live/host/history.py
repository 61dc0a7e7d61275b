"""The last seconds around the ego, and its contacts, by exact boxes at every step."""

from collections import deque

import numpy as np

from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.live.host.frame import Frame

_GAP = 1.5  # of a step: a longer gap means that the simulation ran without this listener
_RECENT_S = 3.0


class History:
    """The frames of the last `horizon_s` [s], without gaps."""

    def __init__(self, horizon_s: float, step_s: float) -> None:
        self._step_s = step_s
        self.frames: deque[Frame] = deque(maxlen=max(round(horizon_s / step_s), 1) + 1)

    def add(self, frame: Frame) -> None:
        """Add a frame; frames before a gap are dropped."""
        if self.frames and frame.time_s - self.frames[-1].time_s > _GAP * self._step_s:
            self.frames.clear()
        self.frames.append(frame)

    def recent_m_s(self) -> float:
        """The ego's highest speed in the last 3 s."""
        last = self.frames[-1].time_s
        return max(float(frame.speed[0]) for frame in self.frames if last - frame.time_s <= _RECENT_S)


def touched(frame: Frame) -> list[str]:
    """The ids of the others that the ego touches."""
    boxes = frame.boxes
    ego = Boxes(*(np.asarray(values)[0] for values in boxes))
    hits = np.asarray(overlap(ego, boxes))
    hits[0] = False
    return [frame.ids[index] for index in np.flatnonzero(hits)]
