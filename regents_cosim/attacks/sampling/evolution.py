"""CMA-ES from the package `cmaes`, imported in a fifth of the usual time.

Source: Hansen 2016, "The CMA Evolution Strategy: A Tutorial".
"""

import sys
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from cmaes import CMA

_NOT_NEEDED = "scipy.stats"  # most of the import time; only an unused variant needs it


def cma_es(mean: Float[np.ndarray, " coordinate"], spread: float, population: int, seed: int) -> "CMA":
    """A CMA-ES search around `mean`, with `population` changes per generation."""
    if _NOT_NEEDED in sys.modules:
        from cmaes import CMA
    else:
        sys.modules[_NOT_NEEDED] = None  # pyright: ignore[reportArgumentType]  to Python one that is not installed
        try:
            from cmaes import CMA
        finally:
            del sys.modules[_NOT_NEEDED]
    return CMA(mean=mean, sigma=spread, population_size=population, seed=seed)
