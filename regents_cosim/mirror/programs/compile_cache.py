"""Keep compiled and traced programs on disk, as loading one takes a tenth of the seconds of compiling it.

The cache is on by default, from the first program of a process (`jax_settings.require_device`). A cache that the user
has set up in JAX stays as it is.

JAX can bound its own cache, but then fails to write for ever after a kill between writing an entry and its time.
"""

import os
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

from regents_cosim.mirror.programs.kept_programs import private_folder, tidy
from regents_cosim.mirror.programs.traces import keep_traced_programs

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


def keep_compiled_programs(traced: bool = True) -> None:
    """Turn on JAX's persistent compilation cache for programs of any size, and with `traced` also the cache of traces.

    The first call in a process decides. Where no folder can be made, nothing is kept. Raises RegentsError for a folder
    that others can write to.
    """
    if _decided:
        return
    folder = cache_folder()
    if folder is None:
        return
    try:
        compiled, traces = (private_folder(private_folder(folder) / name) for name in ("compiled", "traced"))
        tidy(folder)
    except OSError:  # for example a read-only home
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
        # Programs are found by what they do; noting the source line of each operation takes a third of tracing.
        ("jax_traceback_in_locations_limit", 0),
    ):
        jax.config.update(option, value)
    compilation_cache.reset_cache()  # JAX looks at the folder only when it compiles the first program of a process
