"""The inputs of a network of AIM-BEV, as the file of its weights states them.

The file has an array for each input that differs from the papers: a point of the route and the lights of the own way
(`route_ahead`), and the metres per pixel of another view.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from regents_cosim.errors import RegentsError, require
from regents_cosim.planners.aim_bev.architecture import LEAST_VIEW_M, MOST_VIEW_M
from regents_cosim.planners.aim_bev.camera import PAPERS, Camera

FOLLOWS_ROUTE = "follows_route"
PIXEL_M = "pixel_m"


@dataclass(frozen=True)
class NetworkInputs:
    """The target and the view of a network; the defaults are those of the papers."""

    follows_route: bool = False  # a point of the route ahead instead of the log's end
    camera: Camera = PAPERS

    @classmethod
    def to(cls, weights: Mapping[str, np.ndarray]) -> "NetworkInputs":
        """The inputs with which weights were taught. Raises RegentsError for an impossible view."""
        if PIXEL_M not in weights:
            return cls(FOLLOWS_ROUTE in weights)
        pixel_m = np.asarray(weights[PIXEL_M], float)
        camera = Camera(round(float(pixel_m.sum()), 6))
        require(
            pixel_m.shape == (1,) and LEAST_VIEW_M <= round(camera.view_m, 3) <= MOST_VIEW_M,
            f"weights whose pixels are {pixel_m.tolist()} m, expected one number for a view of "
            f"{LEAST_VIEW_M:g} to {MOST_VIEW_M:g} m to each side",
            RegentsError,
        )
        return cls(FOLLOWS_ROUTE in weights, camera)

    def marks(self) -> dict[str, np.ndarray]:
        """The arrays that state these inputs in a file of weights."""
        found = {FOLLOWS_ROUTE: np.ones(1, np.float32)} if self.follows_route else {}
        return found | ({} if self.camera == PAPERS else {PIXEL_M: np.full(1, self.camera.pixel_m, np.float32)})


AS_IN_THE_PAPERS = NetworkInputs()
