"""highway-env's own window on a replay, in the pace of the case."""

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
    """Shows a road with its first vehicle in the middle. Who closes it sees no more, the replay goes on.

    It is what highway-env's viewer asks of an environment, since a replay needs none.
    """

    action_type = observation_type = None  # nothing to steer by the keyboard, nothing to draw over the road

    def __init__(self, road: Road, dt: float) -> None:
        """Raises RegentsError where there is no display."""
        pygame.display.init()
        # without a display SDL draws into memory, which is right only for who asked for that
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
        """Who the window follows."""
        return self.road.vehicles[0]

    def show(self) -> None:
        """The road as it is now; waits until it is time."""
        if self._viewer is not None:
            self._viewer.display()
            self._viewer.handle_events()

    def close(self) -> None:
        """Close it, as the viewer does when the user clicks on the cross."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


@contextmanager
def opened(road: Road, dt: float, gui: bool) -> Iterator[RoadWindow | None]:
    """A window where there shall be one (`gui`), closed in the end."""
    window = RoadWindow(road, dt) if gui else None
    try:
        yield window
    finally:
        if window is not None:
            window.close()
