"""Interpolate between the weights before and after a fine-tuning, which keeps more of what was known.

Source: WiSE-FT (Wortsman et al. 2022).
"""

import numpy as np

from regents_cosim.errors import RegentsError, require


def interpolate(before: dict[str, np.ndarray], after: dict[str, np.ndarray], share: float) -> dict[str, np.ndarray]:
    """`before` + `share` (`after` - `before`), array by array. Raises RegentsError where they hold different arrays."""
    shapes = [{name: values.shape for name, values in weights.items()} for weights in (before, after)]
    require(shapes[0] == shapes[1], "weights of two different networks, expected the same arrays in both", RegentsError)
    mixed = {}
    for name, values in before.items():
        begun = values.astype(np.float32)
        mixed[name] = begun + np.float32(share) * (after[name].astype(np.float32) - begun)
    return mixed
