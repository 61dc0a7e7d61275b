"""Who waits for a program that is made is told so: it takes long, once, and nothing else is to be seen meanwhile.

JAX says when it begins to compile a program and when that is there; `traces` tells of tracing one. One that is kept is
there so soon that nothing is shown.
"""

from functools import cache
from typing import Any

import jax

from regents_cosim.system.progress import DOING

COMPILING = "compiling once, about 30 s"
_PROGRAM = "/jax/core/compile/backend_compile_duration"


@cache
def tell_of_compiling() -> None:
    """From now on, in this process."""
    jax.monitoring.register_scalar_listener(_begun)
    jax.monitoring.register_event_duration_secs_listener(_done)


def _begun(event: str, value: float | int, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.begin(COMPILING)


def _done(event: str, duration_secs: float, **kwargs: Any) -> None:
    if event == _PROGRAM:
        DOING.end()
