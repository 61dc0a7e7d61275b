"""Hundreds of live episodes in one process: none raises, and nothing is held in the end that was not in the beginning.

    python -m tests.endurance.live --count 1000

Short ones on two shipped networks, each with a simulation, a planner at the wheel and an adversary of its own.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

from regents_cosim.cases.shipped import network_config
from regents_cosim.live.episodes import Episodes, run_episode
from regents_cosim.sources.sumo_config import SumoInput, read_input
from tests.endurance.gauge import gauge, watched

MOST_KB_PER_ITEM = 20.0
_NETS = ("crossing", "merge")


def run(
    count: int, every: int = 25, check_memory: bool = True, longest_s: float = 8.0, talk: bool = False
) -> dict[str, Any]:
    """`count` episodes; the report says how they ended and what has grown."""
    begun, ends = time.monotonic(), Counter[str]()
    with gauge() as seen:
        for ended in watched(_episodes(count, longest_s), seen, min(2 * every, max(count // 2, 1)), every):
            ends[ended] += 1
            if ends.total() % every == 0 and talk:
                print(f"{ends.total()} of {count}: {dict(ends)}", file=sys.stderr, flush=True)
        seen.take(count)
        summary = seen.summary()
        summary["grown"] = seen.growth(MOST_KB_PER_ITEM if check_memory else None)
    bad = ends["planner failed"] + ends["told"]
    seconds = round(time.monotonic() - begun, 1)
    return {"count": sum(ends.values()), "failures": bad, "ends": dict(ends), "seconds": seconds, **summary}


def _episodes(count: int, longest_s: float) -> Iterator[str]:
    made = [
        Episodes(read_input(SumoInput(config=network_config(net))), "auto", "idm", most_s=longest_s) for net in _NETS
    ]
    for seed in range(count):
        ended = run_episode(made[seed % len(made)], seed)
        yield "told" if ended.told else ended.how


def main() -> int:
    """The command; 1 where something failed or has grown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--longest", type=float, default=8.0, help="seconds after which an episode ends")
    asked = parser.parse_args()
    found = run(asked.count, longest_s=asked.longest, talk=True)
    print(json.dumps(found))
    return int(bool(found["failures"] or found["grown"]))


if __name__ == "__main__":
    sys.exit(main())
