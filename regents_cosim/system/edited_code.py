"""Tells whether the code on disk is the code that this process runs."""

import time
from functools import cache
from pathlib import Path

_IMPORTED_S = time.time()


@cache
def is_edited(package: Path) -> bool:
    """Whether a file of a package is newer than this process's import of it; checked once for each package."""
    return any(file.stat().st_mtime > _IMPORTED_S for file in package.rglob("*.py"))
