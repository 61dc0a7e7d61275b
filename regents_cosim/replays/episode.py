"""What both simulators' environments share: the case, which episodes are attacked, the ego's progress, its contacts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.cases.files import load_case
from regents_cosim.cases.manifest import find_cases
from regents_cosim.cases.shipped import shipped
from regents_cosim.checks.names import did_you_mean
from regents_cosim.errors import RegentsError, require
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.geometry.lines import distances_along
from regents_cosim.planners.interface import Snapshot
from regents_cosim.scenario.scenario import Agent, Scenario


def choose_case(case: Any, suite: Any, rng: np.random.Generator) -> Scenario:
    """The given case, or one drawn from the suite; without either, one of the cases that come with the package."""
    if isinstance(case, Scenario):
        return case
    require(not (case and suite), "expected a case or a suite, not both", RegentsError)
    if case:
        return load_case(Path(case))
    folders = find_cases(Path(suite) if suite else shipped("scenarios") / "quickstart")
    require(bool(folders), f"{suite}: the suite lists no cases", RegentsError)
    return load_case(folders[int(rng.integers(len(folders)))])


def require_known(given: dict[str, Any], known: Sequence[str] | dict[str, Any], what: str) -> None:
    """Raise RegentsError for an unknown key, with the most similar known one."""
    for key in given:
        if key not in known:
            raise RegentsError(f"unknown {what} {key!r}, {did_you_mean(str(key), sorted(known))}")


class AttackedEpisodes:
    """Chooses one of `every` episodes to be attacked; the last seed of a reset draws the first one."""

    def __init__(self, every: int) -> None:
        """Raises RegentsError for less than one."""
        known = isinstance(every, int) and every >= 1
        require(known, f"every {every!r}, expected 1 (all episodes are attacked) or more", RegentsError)
        self._every, self._episode = every, -1

    def begin(self, seed: int | None) -> bool:
        """Begin another episode, and return whether it is attacked."""
        self._episode = self._episode + 1 if seed is None else int(np.random.default_rng(seed).integers(self._every))
        return self._episode % self._every == 0


class RecordedPath:
    """Measures how far the ego has come along its recorded path."""

    def __init__(self, scenario: Scenario) -> None:
        tracks = scenario.recorded_tracks
        self._points = np.stack([tracks.x[0], tracks.y[0]], axis=-1)
        along = distances_along(*self._points.T)
        self._share = along / max(along[-1], 1e-3)
        self._reached = 0.0

    def advance(self, position: Float[np.ndarray, " 2"]) -> float:
        """The share of the path gained since the last call, given the ego's centre [m, map frame]."""
        nearest = int(np.argmin(np.hypot(*(self._points - position).T)))
        gained = float(self._share[nearest]) - self._reached
        self._reached += gained
        return gained


class Contacts:
    """Finds contacts of the ego step by step; as in `collisions`, agents that appear on top of it do not count."""

    def __init__(self, agents: tuple[Agent, ...]) -> None:
        self._length, self._width = (np.array([getattr(a, name) for a in agents]) for name in ("length", "width"))
        self._met, self._apart = np.zeros(len(agents), bool), np.ones(len(agents), bool)
        self._apart[0] = False

    def at(self, seen: Snapshot) -> Bool[np.ndarray, " agent"]:
        """Whether the ego touches each agent. Call it once per step."""
        boxes = Boxes(seen.x, seen.y, seen.yaw, self._length, self._width, np.broadcast_to(seen.z, seen.x.shape))
        touching = overlap(boxes.at(0), boxes) & seen.valid
        self._apart &= ~(touching & ~self._met)
        self._met |= seen.valid
        return touching & self._apart
