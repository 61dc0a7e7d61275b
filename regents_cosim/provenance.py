"""Versions and hashes that let somebody else make a case again."""

import hashlib
import shlex
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def versions() -> dict[str, str]:
    """Versions of the packages that decide a result."""
    found = {"python": ".".join(map(str, sys.version_info[:3]))}
    for name in ("regents_cosim", "libsumo", "highway-env", "jax", "numpy", "shapely"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def command() -> str:
    """The command line of this process, as typed."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
