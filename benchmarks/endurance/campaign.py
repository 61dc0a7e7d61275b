"""An attack killed a hundred times, and one divided into shards, against the same attack that nothing disturbed.

    python -m benchmarks.endurance.campaign --windows 200 --kills 100 --shards 8

SIGKILL goes to the command, or to one of the processes that it started, some moments after so many more windows were
done. In the end all files have to be byte for byte those of the run that was left alone.
"""

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import psutil

from benchmarks.endurance.processes import REGENTS, Marked, start

_MOST_WINDOWS = 2  # done between two kills
_LATER_S = 1.0


def run(windows: int, kills: int, shards: int, seed: int = 0) -> dict[str, Any]:
    """Run all parts; return the differences, and the ends of the killed processes."""
    rng, ends = random.Random(seed), Counter[str]()
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        command = ["attack", "-c", "shipped:crossing", "--count", windows, "--seed", "3", "--method", "regents"]
        command += ["--iterations", "20", "--quiet", "-o"]
        _finish([*command, "whole"], folder)
        for _ in range(kills):
            ends[_killed([*command, "killed"], folder, rng)] += 1
        _finish([*command, "killed"], folder)
        for number in range(1, shards + 1):
            _finish([*command, f"shards/{number}", "--shard", f"{number}/{shards}"], folder)
        _finish(["suite", "merge", *(f"shards/{n}" for n in range(1, shards + 1)), "-o", "merged"], folder)
        whole = _tree(folder / "whole")
        found = {name: _differ(whole, _tree(folder / name)) for name in ("killed", "merged")}
    return {
        "windows": windows,
        "files": len(whole),
        "ends": dict(ends),
        "differ": found,
        "seconds": round(time.monotonic() - begun),
    }


def _finish(words: list[object], folder: Path) -> None:
    done = start([REGENTS, *words], folder, folder / "errors.txt")
    if done.process.wait() != 0:
        raise RuntimeError(f"{words}: exit code {done.process.returncode}: {done.errors.read_text()[-500:]}")


def _killed(words: list[object], folder: Path, rng: random.Random) -> str:
    """How a run ended: before it was killed, by its own kill, or by that of a process that it had started."""
    ledger = folder / "killed" / ".run" / "ledger.jsonl"
    wanted, later_s = _lines(ledger) + rng.randint(0, _MOST_WINDOWS), rng.uniform(0.0, _LATER_S)
    running = start([REGENTS, *words], folder, folder / "errors.txt")
    while running.process.poll() is None and _lines(ledger) < wanted:
        time.sleep(0.02)
    time.sleep(later_s)
    if running.process.poll() is not None:
        return "had ended"
    children = [one for one in running.alive() if one.pid != running.process.pid]
    if children and rng.random() < 0.3:
        return _kill_child(running, rng.choice(children))
    running.send(signal.SIGKILL, whole_group=False)
    running.process.wait()
    return "killed, and left a process" if running.left_after(3.0) else "killed"


def _kill_child(running: Marked, child: psutil.Process) -> str:
    """A command that loses a process goes on, or ends by itself."""
    child.kill()
    try:
        running.process.wait(timeout=3.0)
    except subprocess.TimeoutExpired:
        running.send(signal.SIGKILL, whole_group=False)
        running.process.wait()
    running.left_after(3.0)
    return "a process of it killed"


def _lines(ledger: Path) -> int:
    return len(ledger.read_bytes().splitlines()) if ledger.exists() else 0


def _tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _differ(whole: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    """Names of files that only one has, or that are not the same in both."""
    return sorted(name for name in whole.keys() | other.keys() if whole.get(name) != other.get(name))[:20]


def main() -> int:
    """The command; 1 where a file differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=200)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--shards", type=int, default=8)
    asked = parser.parse_args()
    found = run(asked.windows, asked.kills, asked.shards)
    print(json.dumps(found))
    return int(any(found["differ"].values()))


if __name__ == "__main__":
    sys.exit(main())
