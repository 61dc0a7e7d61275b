"""Jobs in processes of their own: libsumo holds one simulation per process, and may crash it.

Any `concurrent.futures.Executor` will do; local processes are the default and `dask:ADDRESS`
names a cluster. Jobs are functions of the package, never of the caller's script, so the
script needs no `if __name__ == "__main__"` guard.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from regents_cosim.errors import RegentsError

_P = ParamSpec("_P")
_R = TypeVar("_R")
_Job = TypeVar("_Job")

_MAIN = threading.Lock()  # the caller's script is hidden by one thread at a time
_ANSWERS_S = 10.0  # how long a scheduler may take


def run_isolated(function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
    """Call `function` in a fresh process; a crash of that process is a RegentsError here."""
    with local_processes(1) as executor:
        return result_of(submit(executor, function, *args, **kwargs))


def run_each(
    function: Callable[[_Job], _R], jobs: Iterable[_Job], executor: Executor | None = None
) -> Iterator[_R | RegentsError]:
    """Results of `function` for every job, in order; a job that fails gives its error as a value.

    A crash costs its job only: without an executor a process works on one job at a time, and a
    job whose process died on an executor, perhaps by another job's fault, is tried once more in
    a process of its own.
    """
    if executor is None:
        return _each_here(function, list(jobs))
    return _each_there(function, list(jobs), executor)


def local_processes(workers: int) -> ProcessPoolExecutor:
    """Spawned (never forked) processes: JAX's threads and libsumo's state do not survive a fork."""
    return ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_leave_quietly_when_interrupted
    )


def submit(executor: Executor, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
    """Submit without letting new processes import the caller's script."""
    with main_hidden():
        return executor.submit(function, *args, **kwargs)


def result_of(future: Future[_R]) -> _R:
    """The result, or a RegentsError that says that the process died."""
    error = _failure(future)
    if _is_lost(error):
        raise RegentsError(
            "the worker process died without a word (SUMO crashed or memory ran out); "
            "the other results are not affected, run the command again for this one"
        ) from error
    return future.result()


@contextmanager
def executor_for(name: str) -> Iterator[Executor | None]:
    """`local` (None: processes of our own) or `dask:ADDRESS` (the cluster's executor)."""
    if name == "local":
        yield None
        return
    kind, _, address = name.partition(":")
    if kind != "dask" or not address:
        raise RegentsError(f"executor {name!r}, expected `local` or `dask:ADDRESS`")
    try:
        from distributed import Client
    except ImportError as error:
        raise RegentsError("`--executor dask:...` needs the extra: pip install 'regents_cosim[dask]'") from error
    try:
        client = Client(address, timeout=_ANSWERS_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise RegentsError(f"no Dask scheduler answers at {address} ({error})") from error
    with client:
        yield client.get_executor()


def _each_here(function: Callable[[_Job], _R], jobs: list[_Job]) -> Iterator[_R | RegentsError]:
    workers = min(len(jobs), _cores())
    pools = [local_processes(1) for _ in range(workers)]
    try:
        running = [submit(pool, function, job) for pool, job in zip(pools, jobs, strict=False)]
        for index in range(len(jobs)):
            outcome = _result_or_error(running[index])
            if index + workers < len(jobs):
                turn = index % workers
                if _is_lost(_failure(running[index])):
                    pools[turn].shutdown()
                    pools[turn] = local_processes(1)
                running.append(submit(pools[turn], function, jobs[index + workers]))
            yield outcome
    finally:
        for pool in pools:
            pool.shutdown(wait=True, cancel_futures=True)


def _each_there(function: Callable[[_Job], _R], jobs: list[_Job], executor: Executor) -> Iterator[_R | RegentsError]:
    futures = [_try_to_submit(executor, function, job) for job in jobs]
    for job, future in zip(jobs, futures, strict=True):
        if future is not None and not _is_lost(_failure(future)):
            yield _result_or_error(future)
            continue
        with local_processes(1) as alone:
            yield _result_or_error(submit(alone, function, job))


def _try_to_submit(executor: Executor, function: Callable[[_Job], _R], job: _Job) -> Future[_R] | None:
    """None where an earlier job has already brought the executor down."""
    try:
        return submit(executor, function, job)
    except BrokenExecutor:
        return None


def _result_or_error(future: Future[_R]) -> _R | RegentsError:
    try:
        return result_of(future)
    except RegentsError as error:
        return error


def _failure(future: Future[_R]) -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:
        return error


def _is_lost(error: BaseException | None) -> bool:
    """Whether the process died, rather than the job failed."""
    # Dask's word for it; isinstance would import Dask
    return isinstance(error, BrokenExecutor | CancelledError) or type(error).__name__ == "KilledWorker"


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _leave_quietly_when_interrupted() -> None:
    """On Ctrl-C an idle worker would print a traceback; a busy one still cleans up behind itself."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, lambda *_: sys.exit(130))


@contextmanager
def main_hidden() -> Iterator[None]:
    """Spawned processes import the parent's main script again unless it has no file and no spec."""
    main = sys.modules["__main__"]
    with _MAIN:
        hidden = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
        main.__spec__ = None
        try:
            yield
        finally:
            main.__dict__.update(hidden)
