"""Processes forked from one in which JAX was at work: its threads are not there, and programs wait for ever."""

import os

from jax._src import xla_bridge  # no public way to ask whether JAX is at work

from regents_cosim.errors import RegentsError

_at_work: list[bool] = [False]  # JAX, when this process was about to be forked last
_lost: list[bool] = [False]  # its threads, in this process


def require_own_threads() -> None:
    """Raise RegentsError in a process that was forked from one in which JAX was at work."""
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


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_look, after_in_child=_note)
