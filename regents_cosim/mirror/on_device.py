"""Values of the host on the device, without a program: `jnp.asarray` compiles or loads one for every new shape."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array


def on_device(values: Any, dtype: type[np.generic]) -> Array:
    """A copy of `values`, what `np.array` takes, as an array of that type."""
    return jax.device_put(np.array(values, dtype))
