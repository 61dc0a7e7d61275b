"""All that TraCI tells of one vehicle, by the name of the getter."""

import inspect
from typing import Any

from traci._vehicle import VehicleDomain
from traci.domain import Domain

GIVEN: dict[str, tuple[Any, ...]] = {  # to getters that ask for more than the vehicle
    "getStops": (0,),
    "getLeader": (100.0,),
    "getFollower": (100.0,),
    "getParameter": ("known to the user",),
    "getParameterWithKey": ("known to the user",),
    "getAdaptedTraveltime": (0.0, "edge"),
    "getEffort": (0.0, "edge"),
}
# What a vehicle has for itself: all else says where it is and what is around it, and changes while it drives.
ITS_OWN = (
    "getAccel", "getActionStepLength", "getAdaptedTraveltime", "getApparentDecel", "getBoardingDuration", "getColor",
    "getDecel", "getDepartDelay", "getDeparture", "getEffort", "getEmergencyDecel", "getEmissionClass", "getHeight",
    "getImperfection", "getLaneChangeMode", "getLateralAlignment", "getLength", "getLine", "getMass", "getMaxSpeed",
    "getMaxSpeedLat", "getMinGap", "getMinGapLat", "getParameter", "getParameterWithKey", "getPersonCapacity",
    "getPersonIDList", "getPersonNumber", "getRoute", "getRouteID", "getRoutingMode", "getShapeClass",
    "getSpeedDeviation", "getSpeedFactor", "getSpeedMode", "getStops", "getTau", "getTypeID", "getVehicleClass",
    "getVia", "getWidth", "isRouteValid",
)  # fmt: skip


def state(sumo: Any, name: str) -> dict[str, Any]:
    """The values of all getters, for comparisons."""
    edge = sumo.vehicle.getRoute(name)[-1]
    found = {}
    for getter in dir(VehicleDomain):
        if not getter.startswith(("get", "is")) or (hasattr(Domain, getter) and "Parameter" not in getter):
            continue
        more = [edge if one == "edge" else one for one in GIVEN.get(getter, ())]
        asked = list(inspect.signature(getattr(VehicleDomain, getter)).parameters.values())[1:]
        if (
            not asked
            or asked[0].name not in ("vehID", "typeID", "objectID")
            or len([one for one in asked if one.default is one.empty]) > 1 + len(more)
        ):
            continue
        found[getter] = _plain(getattr(sumo.vehicle, getter)(name, *more))
    found["stop parameters"] = [
        [_stop_parameter(sumo, name, index, key) for key in STOP_PARAMETERS]
        for index in range(len(found["getStops"]))
    ]  # fmt: skip
    return found


STOP_PARAMETERS = (
    "edge", "lane", "busStop", "containerStop", "chargingStation", "parkingArea", "startPos", "endPos", "posLat",
    "duration", "until", "extension", "triggered", "expected", "permitted", "parking", "actType", "tripId", "split",
    "join", "line", "speed", "onDemand", "jump", "arrival",
)  # fmt: skip


def own(found: dict[str, Any]) -> dict[str, Any]:
    """The values that belong to one vehicle alone."""
    return {getter: found[getter] for getter in (*ITS_OWN, "stop parameters")}


def differences(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """The values that have changed."""
    return {getter: (value, after[getter]) for getter, value in before.items() if after[getter] != value}


def _stop_parameter(sumo: Any, name: str, index: int, key: str) -> str:
    try:
        return str(sumo.vehicle.getStopParameter(name, index, key))
    except Exception as refused:  # a SUMO that does not know it
        return type(refused).__name__


def _plain(value: Any) -> Any:
    """A value that can be compared: objects of SUMO's as their attributes."""
    if isinstance(value, str | int | float | bool | type(None)):
        return value
    if isinstance(value, list | tuple | set):
        return [_plain(one) for one in value]
    if hasattr(value, "__attr_repr__"):
        return [(name, _plain(getattr(value, name))) for name in _ATTRIBUTES if hasattr(value, name)]
    return [_plain(one) for one in value]


_ATTRIBUTES = (
    "lane", "startPos", "endPos", "stoppingPlaceID", "stopFlags", "duration", "until", "intendedArrival", "arrival",
    "depart", "split", "join", "actType", "tripId", "line", "speed",
)  # fmt: skip
