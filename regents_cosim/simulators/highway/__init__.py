"""Doors to highway-env: its agents, road networks, vehicles and window."""

import os
from collections.abc import Callable
from typing import Any

_DRIVERS = "x11,kmsdrm,offscreen"  # SDL's own order without Wayland


def skip_wayland() -> None:
    """Keep SDL from trying Wayland where there is none, since its library would complain on stderr.

    A driver that the user has chosen stays. SDL's driver `dummy` would be silent too, but draws black pictures.
    """
    if not {"SDL_VIDEODRIVER", "XDG_RUNTIME_DIR", "WAYLAND_DISPLAY"} & os.environ.keys():
        os.environ["SDL_VIDEODRIVER"] = _DRIVERS


def after_each_step(road: Any, look: Callable[[], object]) -> None:
    """Call `look` after every step of a road, of which an environment makes several between two decisions."""
    step = road.step

    def step_and_look(dt: float) -> None:
        step(dt)
        look()

    road.step = step_and_look
