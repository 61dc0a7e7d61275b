"""Folders for files that only one run needs, which a killed run does not leave for ever."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

from regents_cosim.system.atomic import clear_leftovers, make_folder, remove, temporary


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder among the system's temporary files, readable by this user alone, removed when the block ends.

    Where the process is killed before, the next process that asks for one removes it.
    """
    folder, lock = temporary(_place(tempfile.gettempdir()), partial(make_folder, mode=0o700))
    try:
        yield folder
    finally:
        remove(folder)
        os.close(lock)


@cache
def _place(among: str) -> Path:
    """What the folders in `among` are named after; asked for the first time, it removes those of dead processes."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    place = Path(among, f"regents-{user}")
    clear_leftovers(place.parent, place.name)
    return place
