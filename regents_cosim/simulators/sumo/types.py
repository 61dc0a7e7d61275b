"""SUMO's vehicle classes and types: the kind of road user, and its size."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from regents_cosim.checks.xml_input import children
from regents_cosim.errors import SumoError, require
from regents_cosim.scenario.scenario import Agent, Kind


@dataclass(frozen=True)
class VehicleType:
    """The kind and the outline of a vehicle or a person."""

    kind: Kind
    length: float  # [m]
    width: float  # [m]
    articulated: bool = False  # jointed in reality, but one rigid box here


_KINDS: dict[str, Kind] = {
    "truck": "truck", "trailer": "truck",
    "bus": "bus", "coach": "bus",
    "motorcycle": "motorcycle", "moped": "motorcycle",
    "bicycle": "bicycle", "scooter": "bicycle",
    "pedestrian": "pedestrian", "wheelchair": "pedestrian",
    "container": "other", "tram": "other", "rail_urban": "other", "rail": "other", "rail_electric": "other",
    "rail_fast": "other", "subway": "other", "cable_car": "other", "ship": "other",
    "aircraft": "other", "drone": "other",
}  # fmt: skip

# Length and width [m] per class. Source: SUMO 1.28, vehicle.getLength / getWidth of a type with nothing but its class.
_SIZES: dict[str, tuple[float, float]] = {
    "truck": (7.1, 2.4), "trailer": (16.5, 2.55), "bus": (12.0, 2.5), "coach": (14.0, 2.6),
    "delivery": (6.5, 2.16), "emergency": (6.5, 2.16), "motorcycle": (2.2, 0.9), "moped": (2.1, 0.78),
    "bicycle": (1.6, 0.65), "scooter": (1.2, 0.5), "pedestrian": (0.215, 0.478), "wheelchair": (1.2, 0.72),
    "tram": (22.0, 2.4), "rail_urban": (109.5, 3.0), "subway": (109.5, 3.0), "rail": (135.0, 2.84),
    "rail_electric": (200.0, 2.95), "rail_fast": (200.0, 2.95), "ship": (17.0, 4.0), "container": (6.096, 2.438),
    "aircraft": (72.7, 79.8), "drone": (0.5, 0.5),
}  # fmt: skip
# Old names of classes that SUMO still accepts, and their current names.
_TODAY = {
    "transport": "truck", "lightrail": "tram", "cityrail": "rail_urban", "rail_slow": "rail", "public_transport": "bus",
    "public_army": "army", "public_emergency": "emergency", "public_authority": "authority",
}  # fmt: skip
TRUCK_M = 7.0  # a longer motor vehicle is no passenger car, even where all are called cars
CAR = VehicleType("car", 5.0, 1.8)
PEDESTRIAN = VehicleType("pedestrian", *_SIZES["pedestrian"])
_LEAST_M, _MOST_M = 0.05, 1000.0  # bounds of a vehicle's length, trains included

DEFAULT_TYPES: dict[str, VehicleType] = {
    "DEFAULT_VEHTYPE": CAR,
    "DEFAULT_TAXITYPE": CAR,
    "DEFAULT_BIKETYPE": VehicleType("bicycle", *_SIZES["bicycle"]),
    "DEFAULT_PEDTYPE": PEDESTRIAN,
    "DEFAULT_CONTAINERTYPE": VehicleType("other", *_SIZES["container"]),
}


def kind_of(vehicle_class: str) -> Kind:
    """The kind of a vClass; car for every class that drives like one (delivery, taxi, ignoring ...)."""
    return _KINDS.get(_TODAY.get(vehicle_class, vehicle_class), "car")


def is_passenger_car(one: VehicleType | Agent) -> bool:
    """Whether a road user is a passenger car, judged by its length too: some logs call every motor vehicle a car."""
    return one.kind == "car" and one.length < TRUCK_M


def is_articulated(vehicle_class: str, shape: str) -> bool:
    """Whether a vehicle is articulated, judged by its class, or by the shape with which SUMO draws it."""
    return vehicle_class == "trailer" or shape in ("truck/semitrailer", "truck/trailer", "bus/flexible")


def read_types(paths: tuple[Path, ...]) -> dict[str, VehicleType]:
    """Every vType of route and additional files and of the files that they include, together with SUMO's own.

    Missing sizes are those of the class.
    """
    found = dict(DEFAULT_TYPES)
    waiting, seen = list(paths), set[Path]()
    while waiting:
        path = waiting.pop(0)
        if path.resolve() in seen:
            continue
        seen.add(path.resolve())
        for _, child in children(path, "vehicle types", SumoError):
            found.update((entry.get("id", ""), _vehicle_type(entry, path)) for entry in child.iter("vType"))
            waiting += [path.parent / entry.get("href", "") for entry in child.iter("include")]
    return found


def type_named(name: str, known: dict[str, VehicleType]) -> VehicleType | None:
    """The type called `name`, or None; for vehicle x with a changed copy of `car`, TraCI says `car@x`."""
    return known.get(name) or known.get(name.rpartition("@")[0])


def require_size(whose: str, length: float, width: float) -> None:
    """Raise SumoError for a size that is not plausible on a road; SUMO accepts any length, even infinity."""
    for name, size in (("length", length), ("width", width)):
        require(
            _LEAST_M <= size <= _MOST_M,
            f"{whose} has the {name} {size:g} m, expected {_LEAST_M} to {_MOST_M:g} m",
            SumoError,
        )


def vehicle_type_of(vehicle: Any, name: str) -> VehicleType:
    """The type of a vehicle in a running SUMO, from TraCI's domain `vehicle`. Raises SumoError for a bad size."""
    vehicle_class = vehicle.getVehicleClass(name)
    articulated = is_articulated(vehicle_class, vehicle.getShapeClass(name))
    length, width = vehicle.getLength(name), vehicle.getWidth(name)
    require_size(f"vehicle {name!r}", length, width)
    return VehicleType(kind_of(vehicle_class), length, width, articulated)


def _vehicle_type(entry: ET.Element, path: Path) -> VehicleType:
    vehicle_class = entry.get("vClass", "passenger")
    length, width = _SIZES.get(_TODAY.get(vehicle_class, vehicle_class), (CAR.length, CAR.width))
    try:
        length, width = float(entry.get("length", length)), float(entry.get("width", width))
    except ValueError as error:
        raise SumoError(f"{path}: vType {entry.get('id')!r} has a size that is not a number ({error})") from error
    require_size(f"{path}: vType {entry.get('id')!r}", length, width)
    return VehicleType(kind_of(vehicle_class), length, width, is_articulated(vehicle_class, entry.get("guiShape", "")))
