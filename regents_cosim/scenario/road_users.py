"""The kinds of road users. Imports nothing: `regents --help` lists them."""

from typing import Literal

Kind = Literal["car", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "other"]
VEHICLE_KINDS: frozenset[Kind] = frozenset({"car", "truck", "bus", "motorcycle"})
RoadUser = Literal["vehicle", "cyclist", "pedestrian"]
ROAD_USERS: dict[RoadUser, frozenset[Kind]] = {
    "vehicle": VEHICLE_KINDS,
    "cyclist": frozenset({"bicycle"}),
    "pedestrian": frozenset({"pedestrian"}),
}
