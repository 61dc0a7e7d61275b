"""Shows a replay in highway-env's own window, in real time."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pygame
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.envs.common.graphics import EnvViewer
from highway_env.road.road import Road
from highway_env.vehicle.kinematics import Vehicle

from regents_cosim.errors import RegentsError, require

_SIDE_PX = 800
_PX_PER_M = 7.0


class RoadWindow:
    """Shows a road with its first vehicle in the middle. If the user closes it, the replay goes on.

    It has the attributes that highway-env's viewer expects of an environment, since a replay has no environment.
    """

    action_type = observation_type = None  # no keyboard control, no overlays

    def __init__(self, road: Road, dt: float) -> None:
        """Raises RegentsError where there is no display."""
        pygame.display.init()
        # without a display SDL draws into memory, which is right only if the user chose that
        require(
            pygame.display.get_driver() != "offscreen" or os.environ.get("SDL_VIDEODRIVER") == "offscreen",
            "highway-env's window needs a display, and there is none (leave out --gui, or use --record)",
            RegentsError,
        )
        self.road = road
        self.config: dict[str, Any] = AbstractEnv.default_config() | {
            "screen_width": _SIDE_PX,
            "screen_height": _SIDE_PX,
            "centering_position": [0.5, 0.5],
            "scaling": _PX_PER_M,
            "simulation_frequency": round(1.0 / dt),
            "offscreen_rendering": False,
            "real_time_rendering": True,
        }
        self._viewer: EnvViewer | None = EnvViewer(self)  # pyright: ignore[reportArgumentType]

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle that the window follows."""
        return self.road.vehicles[0]

    def show(self) -> None:
        """Draw the current road, and wait for real time to catch up."""
        if self._viewer is not None:
            self._viewer.display()
            self._viewer.handle_events()

    def close(self) -> None:
        """Close the window; the viewer also calls this when the user clicks on the cross."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


@contextmanager
def opened(road: Road, dt: float, gui: bool) -> Iterator[RoadWindow | None]:
    """A window if `gui`, closed at the end; else None."""
    window = RoadWindow(road, dt) if gui else None
    try:
        yield window
    finally:
        if window is not None:
            window.close()
