"""Read polygons in well-known binary, and check their structure before shapely (GEOS) sees them.

GEOS follows nested collections by recursion, so 5 KB of gzip can overflow its stack and end the process.
"""

import struct

import shapely
from shapely.geometry.base import BaseGeometry

from regents_cosim.errors import InputError, require

_POLYGON, _MULTI_POLYGON = 3, 6
_HEAD_BYTES = 5  # byte order and type
_COUNT_BYTES = 4
_POINT_BYTES = 16  # x, y


def load_polygons(data: bytes) -> BaseGeometry:
    """A polygon or multipolygon in two dimensions. Raises InputError for anything else."""
    try:
        end = _whole_end(data)
        require(end == len(data), f"polygons end after {end} of {len(data)} bytes", InputError)
        return shapely.from_wkb(data)
    except struct.error as error:
        raise InputError("polygons are cut off") from error
    except shapely.errors.ShapelyError as error:
        raise InputError(f"polygons cannot be read ({error})") from error


def _whole_end(data: bytes) -> int:
    order, kind = _head(data, 0)
    if kind == _POLYGON:
        return _polygon_end(data, 0)
    require(kind == _MULTI_POLYGON, f"geometry of type {kind}, expected polygons", InputError)
    (count,) = struct.unpack_from(order + "I", data, _HEAD_BYTES)
    at = _HEAD_BYTES + _COUNT_BYTES
    for _ in range(count):
        at = _polygon_end(data, at)
    return at


def _polygon_end(data: bytes, at: int) -> int:
    order, kind = _head(data, at)
    require(kind == _POLYGON, f"geometry of type {kind} in a multipolygon, expected polygons", InputError)
    (rings,) = struct.unpack_from(order + "I", data, at + _HEAD_BYTES)
    at += _HEAD_BYTES + _COUNT_BYTES
    for _ in range(rings):
        (points,) = struct.unpack_from(order + "I", data, at)
        at += _COUNT_BYTES + points * _POINT_BYTES
    return at


def _head(data: bytes, at: int) -> tuple[str, int]:
    order = {0: ">", 1: "<"}.get(data[at] if at < len(data) else -1)
    if order is None:
        raise InputError("polygons are cut off, or no well-known binary")
    (kind,) = struct.unpack_from(order + "I", data, at + 1)
    return order, kind
