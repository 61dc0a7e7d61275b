"""Crossings and joins as SUMO's SSM device sees them: by lanes, which tracks do not have.

In our words, after its documentation (Simulation/Output/SSM_Device) and its source (MSDevice_SSM, MSLink):
- distances are counted along the lanes' centre lines, from the front;
- two ways join where their common lane begins, and that area has no length;
- where two lanes cross at an angle a, the area begins (1 / sin a - 1) widths of the foe's lane and half of the foe's
  own width before the centre lines meet, and is as long as the foe is wide. At 45 degrees, cars of 1.8 m and lanes of
  3.4 m, it ends 0.5 m before the centre lines meet, while one body is in the other's band until 2.2 m behind;
- on the second lane of a turn, behind where it waits for others, it begins with that lane, however far the crossing is.
"""

import xml.etree.ElementTree as ET
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import shapely

from regents_cosim.evaluation.drives.encounters import Approach

CENTRE = ":centre_"  # lanes of the one junction where ways meet
DT = 0.1


@dataclass(frozen=True)
class Lane:
    shape: shapely.LineString
    length: float  # [m] as stored
    width: float

    def direction(self, s):
        ahead, behind = self.shape.interpolate(s + 1e-3), self.shape.interpolate(s - 1e-3)
        return np.arctan2(ahead.y - behind.y, ahead.x - behind.x)


def lanes_of(net):
    """All lanes of a network file by name."""
    return {
        lane.get("id"): Lane(
            shapely.LineString([[float(v) for v in point.split(",")] for point in lane.get("shape").split()]),
            float(lane.get("length")),
            float(lane.get("width")),
        )
        for lane in ET.parse(net).getroot().iter("lane")
    }


@dataclass(frozen=True)
class DriveResult:
    """The drive of a vehicle: speed and distance at each step, and the distance at which each of its lanes begins."""

    lanes: dict[str, float]
    driven: dict[int, float]
    speed: dict[int, float]
    length: float
    width: float

    def over_junction(self):
        """Names of its lanes on the junction, between those of the lane before and the lane behind it."""
        names = list(self.lanes)
        inner = [i for i, name in enumerate(names) if name.startswith(CENTRE)]
        complete = inner and inner[0] > 0 and inner[-1] + 1 < len(names)
        return names[inner[0] - 1 : inner[-1] + 2] if complete else None

    def approach(self, place, area, steps):
        """The approach to an area that begins after `place` metres and is `area` metres long."""
        entry = place - np.array([self.driven[k] for k in steps])
        speed = np.array([self.speed[k] for k in steps])
        before = np.array([self.speed.get(k - 1, self.speed[k]) for k in steps])
        return Approach(entry, entry + area + self.length, speed, (speed - before) / DT)


def drives_of(rows, sizes):
    """Per vehicle, of rows (vehicle, step, x, y, angle, speed, lane, position on it, metres driven)."""
    seen = defaultdict(list)
    for row in rows:
        seen[row[0]].append(row)
    found = {}
    for name, own in seen.items():
        begins = {}
        for *_, lane, position, driven in own:
            begins.setdefault(lane, driven - position)
        found[name] = DriveResult(begins, {r[1]: r[8] for r in own}, {r[1]: r[5] for r in own}, *sizes[name])
    return found


def edge(lane):
    return lane.rsplit("_", 1)[0]


def joins(one, other, steps):
    """Both approaches to the beginning of their common lane, from different roads; None where there is none."""
    lanes, others = one.over_junction(), other.over_junction()
    if lanes is None or others is None or edge(lanes[0]) == edge(others[0]) or lanes[-1] != others[-1]:
        return None
    return tuple(drive.approach(drive.lanes[lanes[-1]], 0.0, steps) for drive in (one, other))


def crosses(one, other, net):
    """The place where two drives between different roads cross; None where they do not."""
    lanes, others = one.over_junction(), other.over_junction()
    if lanes is None or others is None or any(edge(lanes[i]) == edge(others[i]) for i in (0, -1)):
        return None
    meeting = [(a, b) for b in others[1:-1] for a in lanes[1:-1] if net[a].shape.intersects(net[b].shape)]
    return Crossing((one, other), meeting[0], net) if meeting else None


@dataclass(frozen=True)
class Crossing:
    """Two drives, and the lanes on which they cross."""

    drives: tuple[DriveResult, DriveResult]
    lanes: tuple[str, str]
    net: dict[str, Lane]

    def at(self, i):
        """How far along its lane [m], the last time if there are several."""
        mine, foes = self.net[self.lanes[i]].shape, self.net[self.lanes[1 - i]].shape
        return max(mine.project(shapely.Point(p)) for p in shapely.get_coordinates(mine.intersection(foes)))

    @property
    def angle(self):
        one, other = (self.net[self.lanes[i]].direction(self.at(i)) for i in (0, 1))
        return abs((one - other + np.pi) % (2 * np.pi) - np.pi)

    def by_sumo(self, steps):
        """Both approaches to the area that SUMO's device takes."""
        return tuple(self._by_sumo(i, steps) for i in (0, 1))

    def _by_sumo(self, i, steps):
        drive, foe, name = self.drives[i], self.drives[1 - i], self.lanes[i]
        lane, foes = self.net[name], self.net[self.lanes[1 - i]]
        before = 0.5 * min(foes.width * (2.0 / max(np.sin(self.angle), 0.2) - 1.0), lane.length)
        along = max(0.0, self.at(i) - before) * lane.length / lane.shape.length
        if drive.over_junction().index(name) > 1:
            along = 0.0
        return drive.approach(drive.lanes[name] + along + 0.5 * (foes.width - foe.width), foe.width, steps)

    def by_bodies(self, steps):
        """Both approaches to where the bands cross that the two bodies sweep."""
        return tuple(self._by_bodies(i, steps) for i in (0, 1))

    def _by_bodies(self, i, steps):
        drive, foe = self.drives[i], self.drives[1 - i]
        reach = 0.5 * (foe.width / np.sin(self.angle) + drive.width / abs(np.tan(self.angle)))
        return drive.approach(drive.lanes[self.lanes[i]] + self.at(i) - reach, 2.0 * reach, steps)
