"""The camera of a bird's-eye view: always 192 x 192 pixels, each a given number of metres wide.

A wider view has coarser pixels, so it costs the same. Lines of the map keep their width in pixels, since a coarse view
would otherwise miss them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

PIXELS = 192  # per side
_PAPERS_PIXEL_M = 0.2  # KING and ReGentS: 5 pixels per metre


@dataclass(frozen=True)
class Camera:
    """A camera straight above the ego, whose yaw points up; the default is the view of KING and ReGentS."""

    pixel_m: float = _PAPERS_PIXEL_M

    @classmethod
    def reaching(cls, view_m: float) -> "Camera":
        """A camera that shows `view_m` [m] ahead of the ego, behind it and to each side."""
        return cls(round(2.0 * view_m / PIXELS, 6))

    @property
    def view_m(self) -> float:
        """How far it shows ahead of the ego, behind it and to each side [m]."""
        return 0.5 * PIXELS * self.pixel_m

    @property
    def reach_m(self) -> float:
        """The largest distance of a pixel from the ego [m]."""
        return self.view_m * float(np.sqrt(2.0))

    @property
    def cell_m(self) -> float:
        """The size of ground cells [m]: a fifth of a pixel, in wider views up to two fifths to save memory."""
        return min(0.04 * self._scale**2, 0.08 * self._scale)

    @property
    def lane_line_m(self) -> float:
        """The width [m] of lines along the sides of lanes, and along the middle of ways in a junction."""
        return 0.2 * self._scale

    @property
    def edge_line_m(self) -> float:
        """The width [m] of the line along the edge of the drivable area."""
        return 0.3 * self._scale

    @property
    def offsets_m(self) -> Float[np.ndarray, " pixel"]:
        """Distance [m] ahead of the ego per row of pixels, and to its left per column."""
        return ((PIXELS - 1) / 2 - np.arange(PIXELS, dtype=np.float32)) * np.float32(self.pixel_m)

    @property
    def _scale(self) -> float:
        return self.pixel_m / _PAPERS_PIXEL_M


PAPERS = Camera()
