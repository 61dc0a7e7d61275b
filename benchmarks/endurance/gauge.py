"""Measures again and again what a process holds: memory, open files, threads, children and temporary files.

glibc gives each thread a heap of its own, and keeps what is freed there: with XLA's threads that is some 250 MB which
fill up over a hundred attacks and stay as they are. So all threads share one heap here, and what is free is given
back before memory is read: what grows then is held.
"""

import ctypes
import gc
import os
import platform
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil

_ONE_HEAP = -8, 1  # mallopt's M_ARENA_MAX


@dataclass(frozen=True)
class Sample:
    """The resources that are held after some items."""

    items: int
    rss_kb: int
    children_rss_kb: int
    fds: int
    threads: int
    children: int
    files: int  # in the temporary folder


@dataclass
class Gauge:
    """Samples of this process, whose temporary files lie in `folder`, without the children that it had before."""

    folder: Path
    samples: list[Sample] = field(default_factory=list)
    earlier: frozenset[psutil.Process] = field(default_factory=lambda: frozenset(_children()))

    def take(self, items: int) -> None:
        """Take one more sample, once everything is freed that can be."""
        gc.collect()
        if _glibc():
            ctypes.CDLL(None).malloc_trim(0)
        me = psutil.Process()
        children = [child for child in _children() if child not in self.earlier]
        self.samples.append(
            Sample(
                items=items,
                rss_kb=me.memory_info().rss // 1024,
                children_rss_kb=sum(map(_rss_kb, children)),
                fds=me.num_fds(),
                threads=me.num_threads(),
                children=len(children),
                files=sum(len(files) for _, _, files in os.walk(self.folder)),
            )
        )

    def slope_kb(self, name: str = "rss_kb") -> float:
        """Growth per item over the later three quarters of the samples; the first still fill caches."""
        later = self.samples[len(self.samples) // 4 :]
        if len(later) < 2:
            return 0.0
        return float(np.polyfit([s.items for s in later], [getattr(s, name) for s in later], 1)[0])

    def summary(self) -> dict[str, Any]:
        """The first and the last sample, and the growth, for the line of JSON."""
        return {
            "first": asdict(self.samples[0]),
            "last": asdict(self.samples[-1]),
            "kb_per_item": round(self.slope_kb(), 2),
            "children_kb_per_item": round(self.slope_kb("children_rss_kb"), 2),
        }

    def growth(self, most_kb_per_item: float | None) -> list[str]:
        """The resources of which more and more are held; None leaves out memory, for runs that are too short."""
        first, last = self.samples[0], self.samples[-1]
        found = [
            f"{name}: {getattr(first, name)} at first, {getattr(last, name)} at last"
            for name in ("fds", "threads", "children", "files")
            if getattr(last, name) > getattr(first, name)
        ]
        for name in ("rss_kb", "children_rss_kb") if most_kb_per_item is not None else ():
            if self.slope_kb(name) > (most_kb_per_item or 0.0):
                found.append(f"{name}: {self.slope_kb(name):.1f} KB per item, at most {most_kb_per_item} expected")
        return found


@contextmanager
def gauge() -> Iterator[Gauge]:
    """Puts the temporary files of this process and of its children into a folder of their own."""
    if _glibc():
        ctypes.CDLL(None).mallopt(*_ONE_HEAP)
    before = tempfile.tempdir, os.environ.get("TMPDIR")
    with tempfile.TemporaryDirectory(prefix="endurance-") as folder:
        tempfile.tempdir = os.environ["TMPDIR"] = folder
        try:
            yield Gauge(Path(folder))
        finally:
            tempfile.tempdir, given = before
            os.environ.pop("TMPDIR")
            os.environ.update({"TMPDIR": given} if given is not None else {})


def watched(items: Iterable[object], seen: Gauge, warm_up: int, every: int) -> Iterator[Any]:
    """Yield the items; take a sample after the first `warm_up` ones, then after each `every`."""
    for count, item in enumerate(items, 1):
        yield item
        if count >= warm_up and (count - warm_up) % every == 0:
            seen.take(count)


def _glibc() -> bool:
    return platform.libc_ver()[0] == "glibc"


def _children() -> list[psutil.Process]:
    return [child for child in psutil.Process().children(recursive=True) if not _is_tracker(child)]


def _is_tracker(process: psutil.Process) -> bool:
    """Python's own, one for all spawned processes as long as this one lives."""
    try:
        return any("resource_tracker" in word for word in process.cmdline())
    except psutil.NoSuchProcess:
        return True


def _rss_kb(process: psutil.Process) -> int:
    try:
        return process.memory_info().rss // 1024
    except psutil.NoSuchProcess:
        return 0
