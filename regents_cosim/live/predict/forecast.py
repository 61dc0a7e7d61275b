"""The predicted motion of the vehicles around an ego."""

from dataclasses import dataclass

import numpy as np

from regents_cosim.geometry.lines import distances_along
from regents_cosim.scenario.scenario import Tracks

FIELDS = ("x", "y", "yaw", "z")


@dataclass(frozen=True, eq=False)
class Forecast:
    """The predicted tracks of vehicles, by id."""

    time_s: float
    dt: float  # [s]
    ids: tuple[str, ...]
    tracks: Tracks

    def at(self, name: str, times_s: np.ndarray) -> dict[str, np.ndarray]:
        """X, y, yaw, z and speed of a vehicle at given times; after the end of the prediction it goes straight on."""
        row = self.ids.index(name)
        own = np.arange(self.tracks.steps) * self.dt
        since = np.asarray(times_s) - self.time_s
        found = {key: np.interp(since, own, getattr(self.tracks, key)[row]) for key in (*FIELDS, "speed")}
        return _straight_on(found, np.maximum(since - own[-1], 0.0) * found["speed"])

    def along(self, name: str, time_s: float, metres: np.ndarray) -> dict[str, np.ndarray]:
        """X, y, yaw and z of a vehicle after distances [m] along its predicted path; straight on after its end."""
        own = np.arange(self.tracks.steps) * self.dt
        way = self.at(name, time_s + own)
        driven = distances_along(way["x"], way["y"])
        found = {key: np.interp(metres, driven, way[key]) for key in FIELDS}
        return _straight_on(found, np.maximum(metres - driven[-1], 0.0))

    def there(self, name: str, until_s: float = np.inf) -> bool:
        """Whether a vehicle is present at all times, or until `until_s`."""
        if name not in self.ids:
            return False
        steps = int(min(np.ceil((until_s - self.time_s) / self.dt) + 1, self.tracks.steps))
        return bool(self.tracks.valid[self.ids.index(name), :steps].all())


def _straight_on(found: dict[str, np.ndarray], beyond: np.ndarray) -> dict[str, np.ndarray]:
    """States moved by distances `beyond` [m] in the direction of their yaw."""
    x, y = found["x"] + beyond * np.cos(found["yaw"]), found["y"] + beyond * np.sin(found["yaw"])
    return found | {"x": x, "y": y}
