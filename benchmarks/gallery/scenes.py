"""The traffic of the gallery: cars that drive straight on, made in code."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.gallery.roads import LANE_M, crossing, road_with_neighbour, straight_road
from regents_cosim.cases.provenance import command, sha256_of, versions
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.scenario import Agent, Provenance, Role, Scenario, Tracks

DT_S = 0.1
HORIZON_S = 8.0
_LENGTH_M, _WIDTH_M = 4.6, 1.8
_EGO = "ego"


@dataclass(frozen=True)
class Car:
    """A car that keeps its speed and its heading; where it is at the first step."""

    x: float  # [m]
    y: float  # [m]
    speed: float  # [m/s]
    yaw: float = 0.0  # [rad]


def traffic(name: str, road: RoadMap, ego: Car, others: dict[str, Car], horizon_s: float = HORIZON_S) -> Scenario:
    """The ego among `others`, whose names are in increasing order."""
    cars = [ego, *others.values()]
    time = DT_S * np.arange(round(horizon_s / DT_S) + 1)
    x, y, speed, yaw = (np.array(v)[:, None] for v in zip(*((c.x, c.y, c.speed, c.yaw) for c in cars), strict=True))
    still = np.zeros((len(cars), len(time)))
    tracks = Tracks(
        x + speed * np.cos(yaw) * time, y + speed * np.sin(yaw) * time, yaw + still, speed + still, still == 0.0
    )
    return Scenario(
        id=name,
        dt=DT_S,
        agents=(_agent(_EGO, "ego"), *(_agent(other, "background") for other in others)),
        tracks=tracks,
        target=(float(tracks.x[0, -1]), float(tracks.y[0, -1])),
        road=road,
        provenance=_provenance(),
    )


def minimum_trap() -> Scenario:
    """A car abreast of the ego on another road is the nearest, and can never come over."""
    road, y = road_with_neighbour(lanes=3, hedge_m=2.0)
    ahead = Car(x=25.0, y=LANE_M, speed=10.0)
    return traffic("minimum_trap", road, Car(0.0, 2 * LANE_M, 10.0), {"ahead": ahead, "neighbour": Car(2.0, y, 10.0)})


def averaged_distance() -> Scenario:
    """A car crosses 0.9 s behind the ego."""
    meeting_s, late_s, side = 3.0, 0.9, 0.5 * LANE_M
    ego, cross = 9.0, 14.0
    return traffic(
        "averaged_distance",
        crossing(),
        Car(side - ego * meeting_s, -side, ego),
        {"cross": Car(side, -side - cross * (meeting_s + late_s), cross, np.pi / 2)},
    )


def front_divergence() -> Scenario:
    """A car far ahead begins to change lanes: turned to the left, and just left of the ego's way.

    All are a lane or more away from the edge of the road, so that it pushes none.
    """
    ego = Car(x=0.0, y=LANE_M, speed=8.5)
    ahead = Car(x=58.0, y=LANE_M + 0.2, speed=8.5, yaw=np.deg2rad(7.0))
    return traffic("front_divergence", straight_road(6), ego, {"ahead": ahead})


def rear_end() -> Scenario:
    """A car follows the ego, another drives ahead in the next lane."""
    ego, follower = Car(x=0.0, y=LANE_M, speed=10.0), Car(x=-25.0, y=LANE_M, speed=10.0)
    ahead = Car(x=40.0, y=2 * LANE_M, speed=10.0)
    return traffic("rear_end", straight_road(4), ego, {"ahead": ahead, "follower": follower})


def _agent(name: str, role: Role) -> Agent:
    return Agent(name, "car", _LENGTH_M, _WIDTH_M, role)


def _provenance() -> Provenance:
    return Provenance("gallery", Path(__file__).name, sha256_of(Path(__file__)), 0.0, 0, versions(), command())
