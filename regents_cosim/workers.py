"""Jobs in processes of their own: libsumo holds one simulation per process, and may crash it.

Any `concurrent.futures.Executor` will do; local processes are the default and `dask:ADDRESS`
names a cluster. Jobs are functions of the package, never of the caller's script, so the
script needs no `if __name__ == "__main__"` guard.
"""

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from regents_cosim.errors import RegentsError

_P = ParamSpec("_P")
_R = TypeVar("_R")
_Job = TypeVar("_Job")


def run_isolated(function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
    """Call `function` in a fresh process; a crash of that process is a RegentsError here."""
    with local_processes(1) as executor:
        return result_of(submit(executor, function, *args, **kwargs))


def run_each(
    function: Callable[[_Job], _R], jobs: Iterable[_Job], executor: Executor | None = None
) -> Iterator[_R | RegentsError]:
    """Results of `function` for every job, in order; a job that fails gives its error as a value.

    Without an executor each job has a process of its own, so that a crash costs its job only.
    """
    jobs = list(jobs)
    if executor is not None:
        futures = [executor.submit(function, job) for job in jobs]
        yield from (_result_or_error(future) for future in futures)
        return
    workers = min(len(jobs), os.cpu_count() or 1)
    pools = [local_processes(1) for _ in range(workers)]
    try:
        running: list[Future[_R]] = []
        for index, job in enumerate(jobs):
            if index >= workers:
                yield _result_or_error(running[index - workers])
                if _is_broken(running[index - workers]):
                    pools[index % workers] = local_processes(1)
            running.append(submit(pools[index % workers], function, job))
        yield from (_result_or_error(future) for future in running[max(len(jobs) - workers, 0) :])
    finally:
        for pool in pools:
            pool.shutdown(wait=True, cancel_futures=True)


def local_processes(workers: int) -> ProcessPoolExecutor:
    """Spawned (never forked) processes: JAX's threads and libsumo's state do not survive a fork."""
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def submit(executor: Executor, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
    """Submit without letting new processes import the caller's script."""
    with _main_hidden():
        return executor.submit(function, *args, **kwargs)


def result_of(future: Future[_R]) -> _R:
    """The result, or a RegentsError that says that the process died."""
    try:
        return future.result()
    except BrokenProcessPool as error:
        raise RegentsError(
            "the worker process died without a word (SUMO crashed or memory ran out); "
            "the other results are not affected, run the command again for this one"
        ) from error


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
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise RegentsError(f"no Dask scheduler answers at {address} ({error})") from error
    with client:
        yield client.get_executor()


def _result_or_error(future: "Future[_R]") -> _R | RegentsError:
    try:
        return result_of(future)
    except RegentsError as error:
        return error


def _is_broken(future: Future[object]) -> bool:
    return isinstance(future.exception(), BrokenProcessPool)


@contextmanager
def _main_hidden() -> Iterator[None]:
    """Spawned processes import the parent's main script again unless it has no file and no spec."""
    main = sys.modules["__main__"]
    hidden = {name: main.__dict__.pop(name) for name in ("__file__", "__spec__") if name in main.__dict__}
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(hidden)
