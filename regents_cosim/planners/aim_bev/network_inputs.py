"""What a network of AIM-BEV is shown, wherever it drives: what it learnt with, as the file of its weights says.

An array is there for all that differs from the papers: that it is given a point of its route and the lights of its own
way (`way`), and metres per pixel of another view.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from regents_cosim.errors import RegentsError, require
from regents_cosim.mirror.camera import PAPERS, Camera
from regents_cosim.planners.aim_bev.weights_file import load_weights

FOLLOWS_ROUTE = "follows_route"
PIXEL_M = "pixel_m"
LEAST_VIEW_M, MOST_VIEW_M = 10.0, 100.0


@dataclass(frozen=True)
class NetworkInputs:
    """Where it is to go, and how far it sees. By default as in the papers."""

    follows_route: bool = False  # a point of the route ahead in place of the log's end
    camera: Camera = PAPERS

    @classmethod
    def to(cls, weights: Mapping[str, np.ndarray]) -> "NetworkInputs":
        """What weights of a file were taught with. Raises RegentsError for a view that is none."""
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
        """The arrays that say so."""
        found = {FOLLOWS_ROUTE: np.ones(1, np.float32)} if self.follows_route else {}
        return found | ({} if self.camera == PAPERS else {PIXEL_M: np.full(1, self.camera.pixel_m, np.float32)})


AS_IN_THE_PAPERS = NetworkInputs()


def shown_to(weights: Path) -> NetworkInputs:
    """What the weights of a file are shown. Raises RegentsError where it holds none."""
    return NetworkInputs.to(load_weights(weights))
