"""Keep compiled programs on disk, as loading one takes a tenth of the seconds of compiling it.

The cache is on by default, from the first program of a process (`jax_settings.require_device`). A cache that the user
has set up in JAX stays as it is.

JAX can bound its own cache, but then fails to write for ever after a kill between writing an entry and its time.
"""

import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from regents_cosim.errors import require

OFF = "off"
_decided: list[bool] = []  # the decision, made once per process


def cache_folder() -> Path | None:
    """The folder of the cache: $REGENTS_CACHE, or the user's cache folder; None where $REGENTS_CACHE is `off`."""
    chosen = os.environ.get("REGENTS_CACHE", "")
    if chosen == OFF:
        return None
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "regents_cosim"


def keep_compiled_programs() -> None:
    """Turn on JAX's persistent compilation cache for programs of any size.

    The first call in a process decides. Where no folder can be made, nothing is kept. Raises RegentsError for a folder
    that others can write to.
    """
    if _decided:
        return
    folder = cache_folder()
    if folder is None:
        return
    try:
        compiled = private_folder(private_folder(folder) / "compiled")
        tidy(folder)
    except OSError:  # for example a read-only home
        return
    _decided.append(True)
    if jax.config.jax_compilation_cache_dir is not None:  # pyright: ignore[reportAttributeAccessIssue]
        return
    for option, value in (
        ("jax_compilation_cache_dir", str(compiled)),
        ("jax_persistent_cache_min_compile_time_secs", 0.0),
        ("jax_persistent_cache_min_entry_size_bytes", -1),
        # Programs are found by what they do; noting the source line of each operation takes a third of tracing.
        ("jax_traceback_in_locations_limit", 0),
    ):
        jax.config.update(option, value)
    compilation_cache.reset_cache()  # JAX looks at the folder only when it compiles the first program of a process


LIMIT_BYTES = 2 << 30
_CHECKED = ".checked"  # its time is that of the last search for cut-off entries
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_ZLIB = b"\x78"  # first byte of JAX's entries that are packed with zlib

_Entry = os.DirEntry[str]


def private_folder(folder: Path) -> Path:
    """Return `folder`, made private to its owner where it is missing.

    Raises OSError where it cannot be made, RegentsError where others can write to it or replace it.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    real = folder.resolve()
    found = real.stat()
    require(found.st_uid == os.geteuid(), _refused(real, f"belongs to user {found.st_uid}"))
    require(not found.st_mode & _OTHERS, _refused(real, "can be written by others (`chmod go-w` forbids it)"))
    for parent in real.parents:
        mode = parent.stat().st_mode
        open_to_all = mode & stat.S_IWOTH and not mode & stat.S_ISVTX
        require(not open_to_all, _refused(real, f"lies in {parent}, which all users can write to"))
    return folder


def tidy(folder: Path, limit_bytes: int = LIMIT_BYTES) -> None:
    """Remove entries that a kill has cut off since the last call, then the least recently used beyond the limit."""
    taken = 0
    for entry in sorted(_without_cut_off(folder), key=_last_used, reverse=True):
        taken += entry.stat().st_size
        if taken > limit_bytes:
            with suppress(OSError):
                os.unlink(entry)


def _without_cut_off(folder: Path) -> list[_Entry]:
    """Remove entries that a kill has cut off, and return the rest.

    JAX writes entries in place; it reports a damaged one in every run, but never replaces it.
    """
    checked = folder / _CHECKED
    since = checked.stat().st_mtime if checked.exists() else 0.0
    checked.touch()
    kept = []
    for entry in _entries(folder):
        if entry.stat().st_mtime >= since and entry.name.endswith("-cache") and _is_cut_off(Path(entry)):
            Path(entry).unlink(missing_ok=True)
        else:
            kept.append(entry)
    return kept


def _is_cut_off(path: Path) -> bool:
    with suppress(OSError):
        content = path.read_bytes()
        try:
            if not content or content[:1] == _ZLIB:
                zlib.decompress(content)
        except zlib.error:
            return True
    return False


def _entries(folder: Path | _Entry) -> Iterator[_Entry]:
    """All files of a folder; faster than `Path.rglob`, because every process looks at thousands of them."""
    with suppress(OSError), os.scandir(folder) as found:  # another process may tidy as well
        for entry in found:
            if entry.is_dir(follow_symlinks=False):
                yield from _entries(entry)
            elif entry.name != _CHECKED:
                with suppress(OSError):
                    if stat.S_ISREG(entry.stat().st_mode):  # which the entry caches
                        yield entry


def _last_used(entry: _Entry) -> float:
    return max(entry.stat().st_atime, entry.stat().st_mtime)


def _refused(folder: Path, why: str) -> str:
    return (
        f"compiled programs are not kept in {folder}: it {why}, and they would be run; "
        "name another folder with $REGENTS_CACHE, or REGENTS_CACHE=off"
    )
