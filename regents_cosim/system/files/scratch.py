"""Temporary folders for one run, which do not remain for ever after a kill."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path

from regents_cosim.system.files.atomic import clear_leftovers, make_folder, remove, temporary


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A temporary folder, readable only by this user, that is removed when the block ends.

    If the process is killed before, the next process that asks for such a folder removes it.
    """
    folder, lock = temporary(_place(tempfile.gettempdir()), partial(make_folder, mode=0o700))
    try:
        yield folder
    finally:
        remove(folder)
        os.close(lock)


@cache
def _place(among: str) -> Path:
    """The name prefix of the folders in `among`; the first call removes those of dead processes."""
    place = Path(among, f"regents-{os.getuid()}")
    clear_leftovers(place.parent, place.name)
    return place
