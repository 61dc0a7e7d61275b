"""Compiled programs kept on disk: compiling costs seconds, loading what was compiled does not."""

import os
from pathlib import Path

import jax

OFF = "off"


def cache_folder() -> Path | None:
    """Where programs are kept: $REGENTS_CACHE, else the user's cache folder; None where it is `off`."""
    chosen = os.environ.get("REGENTS_CACHE", "")
    if chosen == OFF:
        return None
    base = (
        Path(chosen) if chosen else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "regents_cosim"
    )
    return base / "compiled"


def keep_compiled_programs() -> None:
    """Turn JAX's persistent compilation cache on, for programs however small."""
    folder = cache_folder()
    if folder is None:
        return
    for option, value in (
        ("jax_compilation_cache_dir", str(folder)),
        ("jax_persistent_cache_min_compile_time_secs", 0.0),
        ("jax_persistent_cache_min_entry_size_bytes", -1),
        # A program is found by what it does. To note where each operation stands in the source is a third of tracing.
        ("jax_traceback_in_locations_limit", 0),
    ):
        jax.config.update(option, value)
        os.environ[option.upper()] = str(value)  # for processes that this one starts: SUMO's drive planners in JAX
