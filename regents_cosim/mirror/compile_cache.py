"""Compiled and traced programs kept on disk: to make them costs seconds, to load them a tenth."""

import os
from pathlib import Path

import jax

from regents_cosim.mirror.traces import keep_traced_programs

OFF = "off"


def cache_folder() -> Path | None:
    """Where programs are kept: $REGENTS_CACHE, else the user's cache folder; None where it is `off`."""
    chosen = os.environ.get("REGENTS_CACHE", "")
    if chosen == OFF:
        return None
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "regents_cosim"


def keep_compiled_programs(traced: bool = True) -> None:
    """Turn JAX's persistent compilation cache on, for programs however small; and ours of what it compiles."""
    folder = cache_folder()
    if folder is None:
        return
    if traced:
        keep_traced_programs(folder / "traced")
    for option, value in (
        ("jax_compilation_cache_dir", str(folder / "compiled")),
        ("jax_persistent_cache_min_compile_time_secs", 0.0),
        ("jax_persistent_cache_min_entry_size_bytes", -1),
        # A program is found by what it does. To note where each operation stands in the source is a third of tracing.
        ("jax_traceback_in_locations_limit", 0),
    ):
        jax.config.update(option, value)
        os.environ[option.upper()] = str(value)  # for processes that this one starts: SUMO's drive planners in JAX
