"""How much of its surroundings a view from above shows: always 192 x 192 pixels, each of so many metres.

A wider view has coarser pixels, so that it costs the same. Lines of the map are drawn as wide in pixels, or a coarse
view would miss them.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

PIXELS = 192  # per side
_PAPERS_PIXEL_M = 0.2  # KING and ReGentS: 5 pixels per metre


@dataclass(frozen=True)
class Camera:
    """A camera straight above the ego, the ego's yaw up. Its default is that of KING and ReGentS."""

    pixel_m: float = _PAPERS_PIXEL_M

    @classmethod
    def reaching(cls, view_m: float) -> "Camera":
        """One that shows so much [m] ahead of the ego, behind it and to each side."""
        return cls(round(2.0 * view_m / PIXELS, 6))

    @property
    def view_m(self) -> float:
        """It reaches so far ahead of the ego, behind it and to each side."""
        return 0.5 * PIXELS * self.pixel_m

    @property
    def reach_m(self) -> float:
        """No pixel is further from the ego."""
        return self.view_m * float(np.sqrt(2.0))

    @property
    def cell_m(self) -> float:
        """Cells of the ground: five to a pixel; of wider views down to two and a half, or maps take much memory."""
        return min(0.04 * self._scale**2, 0.08 * self._scale)

    @property
    def lane_line_m(self) -> float:
        """The width of lane lines, which run along the sides of lanes, and along the middle of ways in a junction."""
        return 0.2 * self._scale

    @property
    def edge_line_m(self) -> float:
        """The width of the line along the edge of the drivable area."""
        return 0.3 * self._scale

    @property
    def offsets_m(self) -> Float[np.ndarray, " pixel"]:
        """Ahead of the ego per row of pixels, and left of it per column."""
        return ((PIXELS - 1) / 2 - np.arange(PIXELS, dtype=np.float32)) * np.float32(self.pixel_m)

    @property
    def _scale(self) -> float:
        return self.pixel_m / _PAPERS_PIXEL_M


PAPERS = Camera()
