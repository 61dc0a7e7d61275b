"""The part of the map that a picture shows, and the transformation from metres to pixels."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_MARGIN_M = 18.0  # around the subject of a picture
_CLOSEST_PX_PER_M = 11.0
_SMOOTH_S = 1.0  # the camera lags behind its target by about this time


@dataclass(frozen=True)
class View:
    """A rectangular view of the map; pixels run right and down from its upper left corner."""

    left: float  # [m]
    top: float  # [m]
    px_per_m: float
    width: int  # [px]
    height: int  # [px]

    def pixels(self, points: Float[np.ndarray, "*shape 2"]) -> Float[np.ndarray, "*shape 2"]:
        """The pixel positions of points [m]."""
        return (points - [self.left, self.top]) * [self.px_per_m, -self.px_per_m]

    def bounds(self, margin_m: float = 0.0) -> tuple[float, float, float, float]:
        """Least x, least y, greatest x, greatest y [m]."""
        right, bottom = self.left + self.width / self.px_per_m, self.top - self.height / self.px_per_m
        return self.left - margin_m, bottom - margin_m, right + margin_m, self.top + margin_m

    def shifted(self, right: int, down: int) -> "View":
        """The view moved by whole pixels."""
        return View(
            self.left + right / self.px_per_m, self.top - down / self.px_per_m, self.px_per_m, self.width, self.height
        )


def fit(points: Float[np.ndarray, "point 2"], size: tuple[int, int]) -> View:
    """The closest view that shows all `points` [m] and their surroundings."""
    least, greatest = points.min(axis=0), points.max(axis=0)
    scale = float(np.min(np.array(size) / (greatest - least + 2.0 * _MARGIN_M)))
    return centred(0.5 * (least + greatest), min(scale, _CLOSEST_PX_PER_M), size)


def trim(points: Float[np.ndarray, "point 2"], size: tuple[int, int], least_height: int) -> tuple[int, int]:
    """The `size` without the empty stripes above and below a wide, flat scene."""
    needed = (np.ptp(points[:, 1]) + 2.0 * _MARGIN_M) * fit(points, size).px_per_m
    return size[0], min(max(round(needed), least_height), size[1])


def fit_latest(points: Float[np.ndarray, "time agent 2"], size: tuple[int, int], least_px_per_m: float) -> View:
    """A view as by `fit`, but without the earliest instants where it would become too distant.

    Entries of `points` may be NaN.
    """
    for first in range(len(points)):
        latest = points[first:].reshape(-1, 2)
        view = fit(latest[np.isfinite(latest).all(axis=1)], size)
        if view.px_per_m >= least_px_per_m:
            return view
    return centred(np.nanmean(points[-1], axis=0), least_px_per_m, size)


def centred(centre: Float[np.ndarray, " 2"], px_per_m: float, size: tuple[int, int]) -> View:
    """The view centred on `centre` [m]."""
    half = 0.5 * np.array(size) / px_per_m
    return View(float(centre[0] - half[0]), float(centre[1] + half[1]), px_per_m, *size)


def follow(middle: Float[np.ndarray, "time 2"], dt: float, px_per_m: float, size: tuple[int, int]) -> Sequence[View]:
    """One view per instant that follows `middle` [m] smoothly, moved by whole pixels."""
    from scipy.ndimage import gaussian_filter1d  # its import takes half a second, and stills do not need it

    smooth = gaussian_filter1d(middle, _SMOOTH_S / dt, axis=0, mode="nearest")
    start = centred(smooth[0], px_per_m, size)
    moved = np.rint((smooth - smooth[0]) * [px_per_m, -px_per_m]).astype(int)
    return [start.shifted(int(right), int(down)) for right, down in moved]
