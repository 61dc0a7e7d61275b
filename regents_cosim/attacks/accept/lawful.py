"""The law for one candidate: its own map of where it may drive, instead of the road, and a top speed.

The road cost of the paper keeps corners on the drivable area. On a map that ends at the centre line, at the ways that
begin at the candidate's approach and at the lanes in its direction, the same cost keeps it lawful, with the same
gradient. The map of a pedestrian ends at the kerb, except at crossings.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Float
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.road_field import MARGIN_M, ROOM, RoadField, blur_areas
from regents_cosim.mirror.world import World, scene_origin
from regents_cosim.norms.grades import AdversaryMay
from regents_cosim.norms.limits import OVER_LIMIT
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.verdicts.law.lawful_ways import lawful_area, lawful_lanes
from regents_cosim.verdicts.law.walking_ground import ground_of

_AROUND_EGO_M = 40.0  # around its track: a candidate further away is no danger yet


@dataclass(frozen=True, eq=False)
class LawfulRoad:
    """The area in which one agent may drive."""

    area: BaseGeometry  # [m, map frame]
    field: RoadField  # the blurred area, in coordinates relative to `origin`
    origin: Float[np.ndarray, " 2"]  # [m, map frame]


def road_near_ego(scenario: Scenario) -> RoadField | None:
    """The road around the ego, in the mirror's coordinates; None where roads lie above each other."""
    if scenario.heights.stacked:
        return None
    return _near_ego(scenario, scenario.road.drivable)


def lawful_road(scenario: Scenario, agent: int) -> LawfulRoad | None:
    """The area in which `agent` may drive.

    None where the map does not tell, and where roads lie above each other; then the whole road counts, which does not
    bind pedestrians.
    """
    area = None if scenario.heights.stacked else _area(scenario, agent)
    if area is None or area.is_empty:
        return None
    return LawfulRoad(area, _near_ego(scenario, area), scene_origin(scenario))


def _area(scenario: Scenario, agent: int) -> BaseGeometry | None:
    """The area [m] in which `agent` may drive or walk; None where the map does not tell."""
    if scenario.agents[agent].kind != "pedestrian":
        return lawful_area(scenario, agent)
    ground = ground_of(scenario)
    return None if ground is None else ground.allowed(*_around_ego(scenario), ground.off_in_log_m(scenario, agent))


def under_the_law(
    world: World, scenario: Scenario, agent: int, road: LawfulRoad | None, may: AdversaryMay = "mistakes"
) -> World:
    """The world with a top speed and a `road` for `agent` alone; None: the road of all agents.

    The top speed is the speed limit, or a fifth more where the adversary `may` make mistakes.
    """
    limited = np.array(world.top_speed)
    limited[agent] = min(limited[agent], _top_speed(scenario, agent, 1.0 if may == "none" else OVER_LIMIT))
    world = replace(world, top_speed=on_device(limited, np.float32))
    if road is None:
        return replace(world, own_road=world.road)  # so that it shares the program of worlds with another road
    on_road = np.array(world.on_road)
    on_road[:, agent] = _began_on(scenario, agent, road.area)
    field = road.field.seen_from(scene_origin(scenario) - road.origin)
    return replace(world, own_road=field, on_road=on_device(on_road, np.bool_))


def _top_speed(scenario: Scenario, agent: int, over_limit: float) -> float:
    """The top speed [m/s] of `agent`: over the limit, or that of its log; infinite where none is known."""
    lanes = lawful_lanes(scenario, agent) or ()
    limit = max((lane.speed_limit for lane in lanes), default=np.inf)
    return max(over_limit * limit, float(scenario.tracks.speed[agent].max()))


def _near_ego(scenario: Scenario, area: BaseGeometry) -> RoadField:
    """The part of the area near the ego, in the mirror's coordinates, with a margin that shows where it ends."""
    bounds, (low, high) = np.reshape(area.bounds, (2, 2)), _around_ego(scenario)
    low, high = np.maximum(bounds[0], low), np.minimum(bounds[1], high)
    low, high = low - MARGIN_M, np.maximum(high, low) + MARGIN_M
    return blur_areas([area], low, high, scene_origin(scenario), room=ROOM, open_ended=True)


def _around_ego(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """Bounds [m] beyond which a candidate is no danger yet."""
    own = np.stack([scenario.tracks.x[0], scenario.tracks.y[0]])
    return own.min(axis=1) - _AROUND_EGO_M, own.max(axis=1) + _AROUND_EGO_M


def _began_on(scenario: Scenario, agent: int, area: BaseGeometry) -> np.ndarray:
    """Which of its corners are on the area when it is first seen."""
    first = int(np.argmax(scenario.tracks.valid[agent]))
    box = Boxes(*(values[agent, first] for values in np.broadcast_arrays(*scenario.boxes)))
    return shapely.contains_xy(area, *np.moveaxis(corners(box), -1, 0))
