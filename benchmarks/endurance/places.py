"""Links, second names, pipes and devices in place of each file and folder of a suite, and all that is done with it.

    python -m benchmarks.endurance.places --count 100000

Nothing outside the suite may change, nothing may wait, and what is refused is said in one line. In a working directory
full of modules with the names of all that there are, no process that is started may import one (`--spawns`).
"""

import argparse
import itertools
import json
import random
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path

from regents_cosim.saving import SuiteWriter

sys.path.insert(0, str(Path(__file__).parents[2] / "tests/support"))
from hostile_places import DEEDS, KINDS, places, problem, whole_suite
from scenes import platoon
from trapped_folder import trapped_folder

_BIN = Path(sys.executable).parent


@dataclass
class Tally:
    """The number of tries, and their problems."""

    tried: int = 0
    places: int = 0
    spawns: int = 0
    problems: list[str] = field(default_factory=list)


def run(count: int, seed: int, work: Path) -> Tally:
    """So many of all combinations, in an order drawn by chance; each has its turn before one has a second."""
    whole = whole_suite(work / "whole")
    found = places(whole)
    tally = Tally(places=len(found))
    every = list(itertools.product(found, KINDS, DEEDS))
    random.Random(seed).shuffle(every)
    for place, kind, deed in itertools.islice(every, count):
        try:
            said = problem(whole, place, kind, deed, work / "work")
        except PermissionError:  # only root makes devices
            continue
        tally.tried += 1
        tally.problems += [said] if said else []
    return tally


def spawn_in_a_trap(work: Path, tally: Tally) -> None:
    """Commands in a folder that is a suite and holds modules of all names."""
    with trapped_folder(work / "trap") as trap:
        SuiteWriter(trap, 0).add(platoon())
        case, out = trap / "platoon0", work / "out"
        for words in (
            ["record", "-c", "shipped:crossing", "--count", "1", "--horizon", "5", "-o", out],
            ["replay", out],
            ["evaluate", out, "--planner", "idm", "--in", "sumo"],
            ["evaluate", out, "--planner", "idm", "--in", "sumo", "--executor", "dask"],
            ["report", case, "-o", work / "page.html"],
            ["suite", "check", trap],
        ):
            command = [str(_BIN / "regents"), *map(str, words)]
            done = subprocess.run(command, cwd=trap, capture_output=True, text=True)
            tally.spawns += 1
            tally.problems += [done.stderr[-300:]] if done.returncode not in (0, 1) else []


def main() -> None:
    """Print one JSON line; return exit code 1 where a promise was broken."""
    options = argparse.ArgumentParser()
    options.add_argument("--count", type=int, default=100_000)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--spawns", action="store_true")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as work:
        tally = run(given.count, given.seed, Path(work))
        if given.spawns:
            spawn_in_a_trap(Path(work), tally)
    print(json.dumps(asdict(tally)))
    sys.exit(1 if tally.problems else 0)


if __name__ == "__main__":
    main()
