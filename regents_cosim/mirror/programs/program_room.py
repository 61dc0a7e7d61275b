"""Make room for compiled programs, as each takes dozens of the memory maps that Linux grants a process.

Where no map is left, the compiler ends the process (a segmentation fault). A run over many places meets that limit:
other numbers of vehicles and other roads are other shapes, and each shape has its own programs.
"""

import gc
from functools import cache
from pathlib import Path

import jax

_GRANTED = Path("/proc/sys/vm/max_map_count")
_TAKEN = Path("/proc/self/maps")
_SHARE = 0.5  # of the granted maps: two simultaneous compilations take far less than the rest


def make_room() -> bool:
    """Forget all compiled programs if they take half of the memory maps that the process may have.

    Programs that are needed again are compiled again or read from disk. Returns whether programs were forgotten; False
    where the system does not tell its limit.
    """
    granted = maps_granted()
    if granted is None or maps_taken() <= _SHARE * granted:
        return False
    jax.clear_caches()
    gc.collect()
    return True


@cache
def maps_granted() -> int | None:
    """The number of memory maps that a process may have; None where the system does not tell."""
    try:
        return int(_GRANTED.read_text())
    except (OSError, ValueError):
        return None


def maps_taken() -> int:
    """The number of memory maps of this process."""
    try:
        with _TAKEN.open("rb") as lines:
            return sum(1 for _ in lines)
    except OSError:
        return 0
