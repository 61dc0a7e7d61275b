"""Where highway-env draws: on a display, or in memory where there is none, and then without a word."""

import os
import sys

_DRIVERS = "x11,kmsdrm,offscreen"  # SDL's own order, less Wayland


def skip_wayland() -> None:
    """Have SDL not look for a Wayland display where there can be none: its library complains on stderr.

    Nothing changes for who has chosen a driver. SDL's driver `dummy` would be silent too, but draws black pictures.
    """
    chosen = {"SDL_VIDEODRIVER", "XDG_RUNTIME_DIR", "WAYLAND_DISPLAY"} & os.environ.keys()
    if sys.platform == "linux" and not chosen:
        os.environ["SDL_VIDEODRIVER"] = _DRIVERS
