"""Compiled and traced programs kept on disk: to make them costs seconds, to load them a tenth.

They are kept by default, from when a process first wants one (`jax_settings.require_device`). A cache that the user has
set up in JAX stays as it is.

JAX can bound its cache itself, but then fails to write for ever where a kill fell between an entry and its time.
"""

import os
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from regents_cosim.mirror.kept_programs import private_folder, tidy
from regents_cosim.mirror.traces import keep_traced_programs

OFF = "off"
_decided: list[bool] = []  # once in a process


def cache_folder() -> Path | None:
    """Where programs are kept: $REGENTS_CACHE, else the user's cache folder; None where it is `off`."""
    chosen = os.environ.get("REGENTS_CACHE", "")
    if chosen == OFF:
        return None
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "regents_cosim"


def keep_compiled_programs(traced: bool = True) -> None:
    """Turn JAX's persistent compilation cache on, for programs however small; and ours of what it compiles.

    The first call in a process decides. Where no folder can be made nothing is kept. Raises RegentsError for one that
    others can write to.
    """
    if _decided:
        return
    folder = cache_folder()
    if folder is None:
        return
    try:
        compiled, traces = (private_folder(private_folder(folder) / name) for name in ("compiled", "traced"))
        tidy(folder)
    except OSError:  # a home that is read-only, say
        return
    _decided.append(True)
    if traced:
        keep_traced_programs(traces)
    if jax.config.jax_compilation_cache_dir is not None:  # pyright: ignore[reportAttributeAccessIssue]
        return
    for option, value in (
        ("jax_compilation_cache_dir", str(compiled)),
        ("jax_persistent_cache_min_compile_time_secs", 0.0),
        ("jax_persistent_cache_min_entry_size_bytes", -1),
        # A program is found by what it does. To note where each operation stands in the source is a third of tracing.
        ("jax_traceback_in_locations_limit", 0),
    ):
        jax.config.update(option, value)
    compilation_cache.reset_cache()  # JAX looks at the folder once, when it compiles a process's first program
