"""Find the nearest of many points with shapely's tree; SciPy's tree would take half a second to import."""

import numpy as np
import shapely
from jaxtyping import Float, Int


class NearestPoint:
    """An index of points that finds the nearest one to a place."""

    def __init__(self, points: Float[np.ndarray, "point 2"]) -> None:
        self._tree = shapely.STRtree(np.asarray(shapely.points(points)))

    def __call__(self, x: Float[np.ndarray, "*axes"], y: Float[np.ndarray, "*axes"]) -> Int[np.ndarray, "*axes"]:
        """The index of the nearest point to each place [m]."""
        _, found = self._tree.query_nearest(np.asarray(shapely.points(x, y)).ravel(), all_matches=False)
        return found.reshape(np.shape(x))
