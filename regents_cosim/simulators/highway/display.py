"""Selects highway-env's video driver: a display, or memory where there is none, without messages."""

import os
import sys

_DRIVERS = "x11,kmsdrm,offscreen"  # SDL's own order without Wayland


def skip_wayland() -> None:
    """Keep SDL from trying Wayland where there is none, since its library would complain on stderr.

    A driver that the user has chosen stays. SDL's driver `dummy` would be silent too, but draws black pictures.
    """
    chosen = {"SDL_VIDEODRIVER", "XDG_RUNTIME_DIR", "WAYLAND_DISPLAY"} & os.environ.keys()
    if sys.platform == "linux" and not chosen:
        os.environ["SDL_VIDEODRIVER"] = _DRIVERS
