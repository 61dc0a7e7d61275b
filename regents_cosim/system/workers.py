"""Runs jobs in separate processes, since libsumo allows one simulation per process, and may crash it.

Any `concurrent.futures.Executor` can be used; local processes are the default, `dask` and `dask:ADDRESS` name clusters.
Jobs are functions of the package, never of the caller's script, so that the script needs no `if __name__ == "__main__"`
guard.
"""

import itertools
import os
import queue
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from importlib.metadata import PackageNotFoundError, version
from typing import Any, ParamSpec, TypeVar

from regents_cosim.errors import MissingDependencyError, RegentsError, WorkerError, install_hint
from regents_cosim.system.files.atomic import scratch_folder
from regents_cosim.system.processes import Worker, main_hidden, safe_path

_P = ParamSpec("_P")
_R = TypeVar("_R")
_Job = TypeVar("_Job")

_ANSWERS_S = 10.0  # longest wait for a scheduler's answer
_MESSAGES_KEPT = 10  # messages per connection that Dask keeps for its developers
_NEEDED = f"`--executor dask` needs the extra: {install_hint('dask')}"
_PER_CORE = 2  # items per core that are begun ahead of the result that is due
_AHEAD = 256  # jobs given to a foreign executor before the first result is read


def cores() -> int:
    """The number of processor cores that this process may use: a job of a cluster often has a part of a machine."""
    return len(os.sched_getaffinity(0))


def in_turn(function: Callable[..., _R], *columns: Iterable[Any], ahead: int | None = None) -> Iterator[_R]:
    """Like `map`, but on all cores: results in order, items read when their turn comes. Columns are equally long.

    At most `ahead` items are begun before the first result is given, by default two for each core.
    """
    at_once = cores()
    with ThreadPoolExecutor(at_once) as pool:
        begun: deque[Future[_R]] = deque()
        try:
            for items in zip(*columns, strict=True):
                begun.append(pool.submit(function, *items))
                if len(begun) >= (ahead or _PER_CORE * at_once):
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)  # when the caller stops early


def run_isolated(function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
    """Call `function` in a new process; a crash of that process raises a RegentsError here."""
    with local_processes(1) as executor:
        return result_of(submit(executor, function, *args, **kwargs))


def run_each(
    function: Callable[[_Job], _R], jobs: Iterable[_Job], executor: Executor | None = None
) -> Iterator[_R | RegentsError]:
    """The results of `function` for all jobs, in order; a job that fails gives its error as a value.

    Jobs are read when their turn comes, and freed once their result was given. A crash loses only its own job, as a
    process works on one job at a time. If the process of a foreign executor dies, perhaps because of another job, the
    job is tried once more in a separate process.
    """
    with local_processes() if executor is None else nullcontext(executor) as there:
        yield from _each_there(function, iter(jobs), there)


def local_processes(workers: int | None = None) -> "LocalProcesses":
    """An executor with `workers` local processes, by default one per core."""
    return LocalProcesses(cores() if workers is None else workers)


class LocalProcesses(Executor):
    """An executor of processes that do one job at a time; a process that dies loses only its job, and is replaced.

    Processes are started on demand: only when all existing ones are busy.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers  # most processes
        self._threads = ThreadPoolExecutor(workers)
        self._idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
        self._all: list[Worker] = []

    def submit(self, fn: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
        """Let a process call `fn`."""
        return self._threads.submit(self._call, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: with `wait` after their jobs, otherwise at once."""
        if not wait:
            self.kill()
        self._threads.shutdown(wait=True, cancel_futures=cancel_futures)
        for worker in self._all:
            worker.close()

    def kill(self) -> None:
        """End the running jobs, and cancel those that wait."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for worker in list(self._all):
            worker.kill()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(wait=kind is None, cancel_futures=kind is not None)

    def _call(self, function: Callable[..., _R], args: tuple[Any, ...], kwargs: dict[str, Any]) -> _R:
        worker = self._free()
        try:
            worker.begin(function, *args, **kwargs)
            return worker.result()
        finally:
            self._idle.put(worker)

    def _free(self) -> Worker:
        """An idle process, else a new one."""
        with suppress(queue.Empty):
            while True:
                worker = self._idle.get_nowait()
                if worker.is_alive():
                    return worker
                worker.close()
                self._all.remove(worker)
        worker = Worker()
        self._all.append(worker)
        return worker


def submit(executor: Executor, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> Future[_R]:
    """Submit a job, while new processes do not import the caller's script."""
    with main_hidden():
        return executor.submit(function, *args, **kwargs)


def result_of(future: Future[_R]) -> _R:
    """The result of a job. Raises WorkerError where its process died."""
    if not _is_lost(future):
        return future.result()
    raise WorkerError(
        "the worker process died without a word (SUMO crashed or memory ran out); "
        "the other results are not affected, run the command again for this one"
    )


@contextmanager
def executor_for(name: str) -> Iterator[Executor | None]:
    """The executor called `name`: `local` (None: local processes), `dask` (a local cluster) or `dask:ADDRESS`.

    Raises RegentsError for a scheduler that does not answer, and for workers that cannot do the work.
    """
    if name == "local":
        yield None
        return
    kind, _, address = name.partition(":")
    if kind != "dask" or name == "dask:":
        raise RegentsError(f"executor {name!r}, expected `local`, `dask` or `dask:ADDRESS`")
    with ExitStack() as stack:
        # By default Dask stores the last thousand messages of every connection, each of which contains a whole job.
        stack.enter_context(_configured({"distributed.admin.low-level-log-length": _MESSAGES_KEPT}))
        client = stack.enter_context(_client(address) if address else _local_cluster(stack))
        _check_workers(client)
        yield client.get_executor()


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingDependencyError(_NEEDED) from error
    return distributed


def _configured(settings: dict[str, Any]) -> Any:
    """A context with these settings of Dask, for this process and the workers that it starts."""
    _distributed()
    import dask.config

    return dask.config.set(settings)


def _client(address: str) -> Any:
    distributed = _distributed()
    try:
        return distributed.Client(address, timeout=_ANSWERS_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise RegentsError(f"no Dask scheduler answers at {address} ({error})") from error


def _local_cluster(stack: ExitStack) -> Any:
    """A cluster with a worker for each core of this machine, closed to its other users.

    Whoever reaches a scheduler can run code with the rights of its owner. So all traffic is encrypted with a key that
    only this process and its workers have; nothing is served over HTTP; and the workers' folder, where they look for
    modules, is ours.
    """
    distributed = _distributed()
    stack.enter_context(_configured({f"distributed.{kind}.http.routes": [] for kind in ("scheduler", "worker")}))
    folder = stack.enter_context(scratch_folder())
    stack.enter_context(safe_path())  # a worker that dies is restarted later
    try:
        key = distributed.Security.temporary()  # it exists only in the memory of this process
    except ImportError as error:  # of the package `cryptography`
        raise MissingDependencyError(_NEEDED) from error
    with main_hidden():
        cluster = distributed.LocalCluster(
            n_workers=cores(),
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,  # no dashboard, and its HTTP server on any port
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            protocol="tls://",
            security=key,
            local_directory=str(folder),
        )
    return distributed.Client(stack.enter_context(cluster))


def _check_workers(client: Any) -> None:
    """Raise RegentsError that lists workers without libsumo, or with another version of this package."""
    ours = installed()
    answers = client.run(installed, on_error="return")
    wrong = []
    for address, theirs in sorted(answers.items()):
        if isinstance(theirs, Exception):
            wrong.append(f"{address} does not have this package ({type(theirs).__name__}: {theirs})")
        elif theirs != ours:
            odd = (f"{name} {theirs.get(name)}, here {ours[name]}" for name in ours if theirs.get(name) != ours[name])
            wrong.append(f"{address} has {', '.join(odd)}")
    if wrong:
        raise RegentsError(f"workers of the Dask cluster cannot do this work: {'; '.join(wrong)}")


def installed() -> dict[str, str | None]:
    """Versions of the packages that a worker needs; None for missing ones."""
    found: dict[str, str | None] = {}
    for package in ("regents_cosim", "libsumo", "jax"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found


def _each_there(
    function: Callable[[_Job], _R], jobs: Iterator[_Job], executor: Executor
) -> Iterator[_R | RegentsError]:
    begun: deque[tuple[_Job, Future[_R] | None]] = deque()
    ahead = executor.workers if isinstance(executor, LocalProcesses) else _AHEAD
    while True:
        for job in itertools.islice(jobs, ahead - len(begun)):
            begun.append((job, _try_to_submit(executor, function, job)))
        if not begun:
            return
        job, future = begun.popleft()
        alone = future is None or (_is_lost(future) and not isinstance(executor, LocalProcesses))
        yield _alone(function, job) if alone or future is None else _outcome(future)
        del job, future


def _alone(function: Callable[[_Job], _R], job: _Job) -> _R | RegentsError:
    with local_processes(1) as executor:
        return _outcome(executor.submit(function, job))


def _try_to_submit(executor: Executor, function: Callable[[_Job], _R], job: _Job) -> Future[_R] | None:
    """Submit a job; None where an earlier job has already broken the executor."""
    try:
        return submit(executor, function, job)
    except BrokenExecutor:
        return None


def _outcome(future: Future[_R]) -> _R | RegentsError:
    """The result of a job, or its RegentsError as a value; a missing dependency is raised, since all jobs need it."""
    try:
        return result_of(future)
    except MissingDependencyError:
        raise
    except RegentsError as error:
        return error


def _is_lost(future: Future[_R]) -> bool:
    """Whether the process of a job died, rather than the job failed."""
    try:
        error = future.exception()
    except CancelledError:
        return True
    # Dask's name for it; isinstance would import Dask
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"
