"""Versions, commands and hashes by which others can make a case again."""

import hashlib
import shlex
import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path


def versions() -> dict[str, str]:
    """Versions of the packages that influence a result."""
    return {"python": ".".join(map(str, sys.version_info[:3])), **_of_packages()}


def versions_and_revision() -> dict[str, str]:
    """Versions of everything that determines a result, including the commit of a checkout."""
    return versions() | ({"revision": revision()} if revision() else {})


@cache  # reading a version takes a millisecond, and every case has them
def _of_packages() -> dict[str, str]:
    found: dict[str, str] = {}
    for name in ("regents_cosim", "libsumo", "highway-env", "jax", "numpy", "shapely"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def revision() -> str:
    """The commit of this package's checkout, with `+` if files differ from it; empty without a checkout."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    try:
        commit = _git(root, "rev-parse", "HEAD").strip()
        changed = _git(root, "status", "--porcelain", "--untracked-files=no", "--", "regents_cosim", "sumo_nets")
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{commit}{'+' if changed.strip() else ''}"


def _git(root: Path, *words: str) -> str:
    done = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, timeout=10, check=True)
    return done.stdout


# Options that change no result, so that a shard notes the same command as the whole run.
_ELSEWHERE = ("--output", "-o", "--into", "--minutes", "--shard", "--executor", "--log-file")  # with a value
_ASIDE = ("--retry", "--quiet", "--json", "--wide", "--verbose", "-v")


def command() -> str:
    """The command line of this process, as typed."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def made_by() -> str:
    """The command line as noted with results: without output folders, shards, machines and display options."""
    kept, skip = [Path(sys.argv[0]).name], False
    for at, word in enumerate(sys.argv[1:]):
        if word == "--":
            kept += sys.argv[1 + at :]
            break
        name, equals, _ = word.partition("=")
        if not skip and name not in (*_ELSEWHERE, *_ASIDE):
            kept.append(word)
        skip = not skip and name in _ELSEWHERE and not equals
    return shlex.join(kept)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
