"""Values of the host on the device, without a program: `jnp.asarray` compiles or loads one for every new shape."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

_STEP_M = 2.0**-13
_ALIGNED_BYTES = 64  # where XLA wants its arrays to begin on a CPU: it uses those that do as they are


def on_device(values: Any, dtype: type[np.generic]) -> Array:
    """A copy of `values`, what `np.array` takes, as an array of that type."""
    return jax.device_put(np.array(values, dtype))


def seen_from(points: Float[np.ndarray, "*axes 2"], origin: Float[np.ndarray, " 2"]) -> Float[np.ndarray, "*axes 2"]:
    """Places [m] in coordinates that begin at `origin`, to the nearest eighth of a millimetre.

    The same scene further from its map's origin has coordinates that are rounded more coarsely, by a nanometre at
    5,000 km: here both are the same numbers. The step is no decimal, so that none of a log lies halfway.
    """
    return np.round((points - origin) / _STEP_M) * _STEP_M


def empty_for_device(shape: tuple[int, ...], dtype: type[np.generic]) -> np.ndarray:
    """An array, not yet filled, that `handed_over` need not copy; what is never filled takes no memory."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.empty(size + _ALIGNED_BYTES, np.uint8)
    first = -room.ctypes.data % _ALIGNED_BYTES
    return room[first : first + size].view(dtype).reshape(shape)


def handed_over(values: np.ndarray) -> Array:
    """The same values on the device, which may be the same memory: nothing may be written to them any more."""
    return jax.device_put(values)
