"""Room for compiled programs: Linux grants a process so many memory maps, and every program takes dozens.

Where no map is left the compiler ends the process (a segmentation fault). A run over many places meets that: other
numbers of vehicles and other roads are other shapes, and each shape has programs of its own.
"""

import gc
from functools import cache
from pathlib import Path

import jax

_GRANTED = Path("/proc/sys/vm/max_map_count")
_TAKEN = Path("/proc/self/maps")
_SHARE = 0.5  # of the maps granted: two programs that are compiled at once take far less than the rest


def make_room() -> bool:
    """Forget all compiled programs if they take half of the memory maps that the process may have.

    Those still needed are compiled again, or read from the disk where they are kept. Returns whether it forgot them;
    False where the system does not tell.
    """
    granted = maps_granted()
    if granted is None or maps_taken() <= _SHARE * granted:
        return False
    jax.clear_caches()
    gc.collect()
    return True


@cache
def maps_granted() -> int | None:
    """How many memory maps a process may have; None where the system does not tell."""
    try:
        return int(_GRANTED.read_text())
    except (OSError, ValueError):
        return None


def maps_taken() -> int:
    """How many memory maps this process has."""
    try:
        with _TAKEN.open("rb") as lines:
            return sum(1 for _ in lines)
    except OSError:
        return 0
