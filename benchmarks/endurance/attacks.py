"""Thousands of attacks in one process: none fails, and nothing is held in the end that was not held in the beginning.

    python -m benchmarks.endurance.attacks --count 2000

Two methods with few iterations, on shipped traffic of several shapes: programs are compiled for each shape once.
"""

import argparse
import itertools
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

from benchmarks.endurance.gauge import gauge, watched
from regents_cosim.attacks.attack import attack
from regents_cosim.attacks.methods.presets import REGENTS, REGENTS_FOCUSED, AttackConfig
from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.scenario.scenario import Scenario

MOST_KB_PER_ITEM = 20.0
_ITERATIONS = 5


def traffic() -> list[Scenario]:
    """Cases as they were before their attack, of every network two."""
    return [case.before_attack() for case in load_suite(shipped("scenarios") / "quickstart")]


def methods() -> list[AttackConfig]:
    """ReGentS, and our own preset."""
    focused = REGENTS_FOCUSED.but(iterations=_ITERATIONS, nearest=2, attempts=1, adversaries="one")
    return [REGENTS.but(iterations=_ITERATIONS), focused]


def run(count: int, every: int = 100, check_memory: bool = True, most_jobs: int | None = None) -> dict[str, Any]:
    """`count` attacks; the report says how they ended and what has grown."""
    begun, ends = time.monotonic(), Counter[str]()
    jobs = list(itertools.product(traffic(), methods()))[:most_jobs]
    warm_up = min(max(2 * len(jobs), every), max(count // 2, 1))
    with gauge() as seen:
        for ended in watched(_attacks(itertools.islice(itertools.cycle(jobs), count)), seen, warm_up, every):
            ends[ended] += 1
        seen.take(count)
        summary = seen.summary()
        summary["grown"] = seen.growth(MOST_KB_PER_ITEM if check_memory else None)
    bad = sum(ends[outcome] for outcome in ("diverged", "planner_error", "already_colliding"))
    seconds = round(time.monotonic() - begun, 1)
    return {"count": sum(ends.values()), "failures": bad, "outcomes": dict(ends), "seconds": seconds, **summary}


def _attacks(jobs: Iterator[tuple[Scenario, AttackConfig]]) -> Iterator[str]:
    for scenario, config in jobs:
        (result,) = attack([scenario], config)
        assert result.attack is not None
        yield result.attack.outcome


def main() -> int:
    """The command; 1 where something failed or has grown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    found = run(parser.parse_args().count)
    print(json.dumps(found))
    return int(bool(found["failures"] or found["grown"]))


if __name__ == "__main__":
    sys.exit(main())
