"""Refuse to run programs in a process forked after JAX was used: its threads are missing, so programs would hang."""

import os

from jax._src import xla_bridge  # no public way to ask whether JAX is at work

from regents_cosim.errors import RegentsError

_at_work: list[bool] = [False]  # whether JAX was in use when this process was last about to be forked
_lost: list[bool] = [False]  # whether this process has lost the threads of JAX


def require_own_threads() -> None:
    """Raise RegentsError in a process that was forked after JAX was used."""
    if _lost[0]:
        raise RegentsError(
            "this process was forked from one that has used JAX, whose threads a fork leaves behind: it would wait for "
            'them for ever. Start processes by forkserver or spawn: AsyncVectorEnv(..., context="forkserver"), '
            'SubprocVecEnv(..., start_method="forkserver"), multiprocessing.get_context("spawn")'
        )


def _look() -> None:
    _at_work[0] = xla_bridge.backends_are_initialized()


def _note() -> None:
    _lost[0] = _lost[0] or _at_work[0]


os.register_at_fork(before=_look, after_in_child=_note)
