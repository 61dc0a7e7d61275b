"""Thousands of windows attacked by Dask's workers: none fails, and no process holds more and more.

    python -m benchmarks.endurance.dask_windows FOLDER --windows 10000
    python -m benchmarks.endurance.dask_windows FOLDER --windows 80 --on local --as-users-do
    python -m benchmarks.endurance.dask_windows FOLDER --city CITY.sumocfg

Windows of the shipped networks, and of each `--city` as many as of a network. They come again under other names, in an
order drawn by chance, where more are wanted than `--recorded`. After
`--minutes` the command that attacks is killed; given again, it goes on where it was. With `--on dask:ADDRESS` the
workers live on meanwhile.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.endurance.processes import REGENTS
from benchmarks.speed.large_suite import make_large_suite
from regents_cosim.cases.shipped import NETWORKS, network
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.sources.record import record

CHEAP = ("--nearest", "1", "--attempts", "1", "--sampled", "0", "--iterations", "1", "--no-pictures")
MOST_KB_PER_WINDOW = 20.0  # that any of the processes may hold more and more
_EVERY_S = 2.0
_DONE = b'"type":"done"'
_ENDS = (0, 1)  # 1: SUMO does not confirm a crash


@dataclass(frozen=True)
class Held:
    """Memory [KB] after some windows."""

    windows: int
    caller: int
    scheduler: int
    workers: tuple[int, ...]  # each with the processes that it started


def run(
    folder: Path,
    windows: int,
    recorded: int,
    on: str,
    minutes: float = 1e6,
    options: Sequence[str] = CHEAP,
    cities: Sequence[Path] = (),
) -> dict[str, Any]:
    """Attack what is left of so many windows; what it took, and who held how much."""
    cases, output = folder / "windows", folder / on.partition(":")[0]
    if not cases.exists():
        make_large_suite(cases, windows, _traffic(min(recorded, windows), cities))
    done = _count(output, _DONE)
    with nullcontext(on) if on != "dask" else _cluster() as place, _client(place) as client:
        scheduler, workers = _pids(client)
        begun, before = time.monotonic(), _cpu_s([*scheduler, *workers])
        words = [REGENTS, "attack", cases, "-o", output, "--quiet", *options, "--executor", place]
        caller = subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL)
        samples = list(_watched(caller, scheduler, workers, output, begun + 60.0 * minutes))
        seconds, cpu_s = time.monotonic() - begun, _cpu_s([*scheduler, *workers]) - before
    return {
        "done": _count(output, _DONE),
        "failed": _count(output, b'"error":"'),
        "of": windows,
        "now": _count(output, _DONE) - done,
        "exit": caller.returncode,
        "seconds": round(seconds, 1),
        "cpu_s": round(cpu_s, 1),
        "bytes": sum(path.stat().st_size for path in output.rglob("*") if path.is_file()),
        "kb_per_window": growth(samples),
        "samples": [asdict(one) for one in samples[:: max(len(samples) // 12, 1)]],
    }


def growth(samples: Sequence[Held]) -> dict[str, float]:
    """The growth of each process per window [KB], over the later three quarters; the first quarter fills caches."""
    later = samples[len(samples) // 4 :]
    at = [one.windows for one in later]
    if len(set(at)) < 3:
        return {}
    held = {"caller": [one.caller for one in later], "scheduler": [one.scheduler for one in later]}
    held |= {
        f"worker {number}": list(each)
        for number, each in enumerate(zip(*(one.workers for one in later), strict=True), 1)
    }
    return {name: round(float(np.polyfit(at, values, 1)[0]), 2) for name, values in held.items()}


def _traffic(count: int, cities: Sequence[Path]) -> list[Scenario]:
    """Windows of the shipped networks and the cities, as many of each, shuffled."""
    places = [*map(network, NETWORKS), *cities]
    each = -(-count // len(places))
    found = [case for place in places for case in record(place, count=each, seed=0)]
    return [found[k] for k in np.random.default_rng(0).permutation(len(found))[:count]]


@contextmanager
def _cluster() -> Iterator[str]:
    """Two workers on this machine; their scheduler is in this process, and set as docs/how-to/cluster.md has it."""
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set({"distributed.admin.low-level-log-length": 10}),
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
    ):
        yield f"dask:{cluster.scheduler_address}"


@contextmanager
def _client(place: str) -> Iterator[Any]:
    """A client of the scheduler; None where the work is done here."""
    if place == "local":
        yield None
        return
    from distributed import Client

    with Client(place.partition(":")[2]) as client:
        yield client


def _pids(client: Any) -> tuple[list[int], list[int]]:
    """The process ids of the scheduler and of the workers."""
    if client is None:
        return [], []
    return [client.run_on_scheduler(os.getpid)], sorted(client.run(os.getpid).values())


def _watched(
    caller: subprocess.Popen[bytes], scheduler: list[int], workers: list[int], output: Path, until: float
) -> Iterator[Held]:
    while True:
        try:
            caller.wait(_EVERY_S)
            return
        except subprocess.TimeoutExpired:
            held = [psutil.Process(pid).memory_info().rss // 1024 for pid in scheduler]
            yield Held(_count(output, _DONE), _rss_kb(caller.pid), sum(held), tuple(map(_rss_kb, workers)))
        if time.monotonic() > until:
            caller.kill()


def _rss_kb(pid: int) -> int:
    """The memory of a process and all its descendants [KB]; 0 for a process that is gone."""
    return sum(one.memory_info().rss // 1024 for one in _tree(pid))


def _cpu_s(pids: Sequence[int]) -> float:
    """The processor time [s] of these processes, their descendants, and those that this process has waited for."""
    trees = {one.pid: one for pid in pids for one in _tree(pid)}
    times = [one.cpu_times() for one in trees.values()]
    waited = resource.getrusage(resource.RUSAGE_CHILDREN)
    return sum(one.user + one.system for one in times) + waited.ru_utime + waited.ru_stime


def _tree(pid: int) -> list[psutil.Process]:
    with suppress(psutil.NoSuchProcess):
        return [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    return []


def _count(output: Path, word: bytes) -> int:
    """How often the ledger has it: once for each window of which it holds."""
    ledger = output / ".run" / "ledger.jsonl"
    return ledger.read_bytes().count(word) if ledger.exists() else 0


def main() -> int:
    """The command; 1 where something failed or has grown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--windows", type=int, default=10_000)
    parser.add_argument("--recorded", type=int, default=600)
    parser.add_argument("--on", default="dask", help="local, dask (two workers of this machine) or dask:ADDRESS")
    parser.add_argument("--minutes", type=float, default=1e6)
    parser.add_argument("--city", type=Path, action="append", default=[], help="a .sumocfg to record as well")
    parser.add_argument("--as-users-do", action="store_true", help="the whole search of focused, in place of a short")
    asked = parser.parse_args()
    options = () if asked.as_users_do else CHEAP
    found = run(asked.folder, asked.windows, asked.recorded, asked.on, asked.minutes, options, asked.city)
    print(json.dumps(found))
    grown = any(each > MOST_KB_PER_WINDOW for each in found["kb_per_window"].values())
    return int(found["exit"] not in _ENDS or found["failed"] > 0 or found["done"] < asked.windows or grown)


if __name__ == "__main__":
    sys.exit(main())
