"""Put host values on the device without a program; `jnp.asarray` compiles or loads one for every new shape."""

from functools import cache
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Int

_STEP_M = 2.0**-13
_ALIGNED_BYTES = 64  # alignment with which XLA uses host memory on a CPU without a copy


def on_device(values: Any, dtype: type[np.generic]) -> Array:
    """Copy `values` to the device as an array of that type."""
    return jax.device_put(np.array(values, dtype))


@cache
def whole_number(value: int) -> Int[Array, ""]:
    """A whole number on the device, copied there once. All callers share it: never donate it to a program."""
    return on_device(value, np.int32)


def seen_from(points: Float[np.ndarray, "*axes 2"], origin: Float[np.ndarray, " 2"]) -> Float[np.ndarray, "*axes 2"]:
    """Places [m] relative to `origin`, rounded to the nearest eighth of a millimetre.

    A scene far from its map's origin has more coarsely rounded coordinates, by a nanometre at 5,000 km; after the
    rounding here both give the same numbers. The step is no decimal fraction, so no logged value lies halfway.
    """
    return np.round((points - origin) / _STEP_M) * _STEP_M


def empty_for_device(shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    """An uninitialised array that `handed_over` need not copy; parts that are never filled take no memory."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.empty(size + _ALIGNED_BYTES, np.uint8)
    first = -room.ctypes.data % _ALIGNED_BYTES
    return room[first : first + size].view(dtype).reshape(shape)


def handed_over(values: np.ndarray) -> Array:
    """Move host values to the device, which may share their memory, so they must not be written afterwards."""
    return jax.device_put(values)
