"""Distribute the scenarios of an attack over threads, over processes of planners, or into one program."""

import itertools
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from regents_cosim.attacks.pursuit import in_process
from regents_cosim.attacks.searches import batched_searches, pursuits, search_together
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.errors import DriveError
from regents_cosim.planners.host_pool import HostPool
from regents_cosim.scenario import Scenario

_T = TypeVar("_T")


def in_threads(given: Iterable[_T], search: Callable[[_T], list[Scenario]], batch: int) -> Iterator[list[Scenario]]:
    """Search one item per core; at most `batch` items are begun before the first result is handed on."""
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        waiting: deque[Future[list[Scenario]]] = deque()
        try:
            for one in given:
                waiting.append(pool.submit(search, one))
                if len(waiting) >= batch:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)  # if no more results are wanted


def on_hosts(
    scenarios: Iterable[Scenario], setup: AttackSetup, batch: int, hosts: HostPool
) -> Iterator[list[Scenario]]:
    """Attack with planners outside the mirror: batches in one process, or one process per core."""
    together = side_by_side(hosts)
    rest = iter(scenarios)
    with ThreadPoolExecutor(1 if together else os.cpu_count() or 1) as pool:
        waiting: deque[Future[list[list[Scenario]]]] = deque()
        while some := list(itertools.islice(rest, batch if together else 1)):
            waiting.append(pool.submit(_driven_on_host, setup, some, hosts))
            if len(waiting) >= batch:
                yield from waiting.popleft().result()
        while waiting:
            yield from waiting.popleft().result()


def side_by_side(hosts: HostPool) -> bool:
    """Whether a planner decides for several scenarios at once."""
    with hosts.lend() as host:
        try:
            return host.batches()
        except DriveError:
            return False  # each case will report the error


def _driven_on_host(setup: AttackSetup, some: list[Scenario], hosts: HostPool) -> list[list[Scenario]]:
    with hosts.lend() as host:
        drives = in_process(host)
        return search_together(setup, some, pursuits(setup, drives), drives)


def in_batches(scenarios: Iterable[Scenario], setup: AttackSetup, batch: int) -> Iterator[list[Scenario]]:
    """Attack `batch` scenarios at a time in one program."""
    rest = iter(scenarios)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        while some := list(itertools.islice(rest, batch)):
            yield from search_together(setup, some, batched_searches(setup, batch), setup.loop(), pool)
