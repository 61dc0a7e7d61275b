"""Tell the user while a program is compiled, since that takes long and shows nothing else.

JAX reports the begin and end of a compilation; `traces` reports tracing. A program from the cache is ready so soon that
nothing is shown.
"""

from functools import cache
from typing import Any

import jax

from regents_cosim.system.progress import DOING

COMPILING = "compiling once, about 30 s"
_PROGRAM = "/jax/core/compile/backend_compile_duration"


@cache
def tell_of_compiling() -> None:
    """Report compilations in this process from now on."""
    jax.monitoring.register_scalar_listener(_begun)
    jax.monitoring.register_event_duration_secs_listener(_done)


def _begun(event: str, value: float | int, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.begin(COMPILING)


def _done(event: str, duration_secs: float, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.end()
