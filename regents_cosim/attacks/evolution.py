"""CMA-ES from the package `cmaes`, without four fifths of the time that its import takes.

Source: Hansen 2016, "The CMA Evolution Strategy: A Tutorial".
"""

import sys
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from cmaes import CMA

_NOT_NEEDED = "scipy.stats"  # most of the import; a variant that is not used here asks for it, and can do without


def cma_es(mean: Float[np.ndarray, " coordinate"], spread: float, population: int, seed: int) -> "CMA":
    """A search that begins around `mean`, `population` changes at a time."""
    if _NOT_NEEDED in sys.modules:
        from cmaes import CMA
    else:
        sys.modules[_NOT_NEEDED] = None  # pyright: ignore[reportArgumentType]  to Python one that is not installed
        try:
            from cmaes import CMA
        finally:
            del sys.modules[_NOT_NEEDED]
    return CMA(mean=mean, sigma=spread, population_size=population, seed=seed)
