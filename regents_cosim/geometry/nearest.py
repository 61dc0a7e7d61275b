"""Which of many points is nearest to a place, by shapely's tree: to import SciPy's takes half a second."""

import numpy as np
import shapely
from jaxtyping import Float, Int


class NearestPoint:
    """Some points, and which of them is the nearest to places."""

    def __init__(self, points: Float[np.ndarray, "point 2"]) -> None:
        self._tree = shapely.STRtree(np.asarray(shapely.points(points)))

    def __call__(self, x: Float[np.ndarray, "*axes"], y: Float[np.ndarray, "*axes"]) -> Int[np.ndarray, "*axes"]:
        """The index of the nearest point to each place."""
        _, found = self._tree.query_nearest(np.asarray(shapely.points(x, y)).ravel(), all_matches=False)
        return found.reshape(np.shape(x))
