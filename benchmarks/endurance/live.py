"""Hundreds of live episodes in one process: none raises, and nothing is held in the end that was not in the beginning.

    python -m benchmarks.endurance.live --count 1000
    python -m benchmarks.endurance.live --count 300 --listeners

Short ones on two shipped networks, each with a simulation, a planner at the wheel and an adversary of its own. As
`--listeners` they are the guide's: SUMO drives, the adversary is a step listener, and nothing but `close` ends it.
Memory counts from 240 episodes on: fewer are needed to fill what is kept of the latest scenes.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from benchmarks.endurance.gauge import gauge, watched
from regents_cosim.cases.shipped import network_config
from regents_cosim.live import Adversary
from regents_cosim.live.episodes import Episodes, run_episode
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs
from regents_cosim.mirror.programs.compiled import COMPILING
from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.simulators.sumo.process import load_libsumo

MOST_KB_PER_ITEM = 20.0
_FILLED = 120  # episodes, after which the bounded caches of scenes are full: the largest keeps 64, one for a crash
_NETS = ("crossing", "merge")
_QUIET = ("--no-step-log", "--no-warnings", "--step-length", "0.1")


def run(
    count: int,
    every: int = 25,
    check_memory: bool = True,
    longest_s: float = 8.0,
    talk: bool = False,
    listeners: bool = False,
) -> dict[str, Any]:
    """`count` episodes; the report says how they ended and what has grown."""
    begun, ends = time.monotonic(), Counter[str]()
    with gauge() as seen:
        episodes = _listeners(count, longest_s) if listeners else _episodes(count, longest_s)
        for ended in watched(episodes, seen, min(_FILLED, max(count // 2, 1)), every):
            ends[ended] += 1
            if ends.total() % every == 0 and talk:
                print(f"{ends.total()} of {count}: {dict(ends)}", file=sys.stderr, flush=True)
        seen.take(count)
        summary = seen.summary()
        summary["grown"] = seen.growth(MOST_KB_PER_ITEM if check_memory and count >= 2 * _FILLED else None)
    bad = ends["planner failed"] + ends["told"]
    seconds = round(time.monotonic() - begun, 1)
    return {"count": sum(ends.values()), "failures": bad, "ends": dict(ends), "seconds": seconds, **summary}


def _episodes(count: int, longest_s: float) -> Iterator[str]:
    made = [
        Episodes(read_input(SumoInput(config=network_config(net))), "auto", "idm", most_s=longest_s) for net in _NETS
    ]
    for seed in range(count):
        ended = run_episode(made[seed % len(made)], seed)
        yield "told" if _complaints(ended.told) else ended.how


def _complaints(told: Sequence[str]) -> list[str]:
    """The lines that tell of something wrong: not those that a program is compiled."""
    return [line for line in told if COMPILING not in line]


def _listeners(count: int, longest_s: float) -> Iterator[str]:
    """Listeners as in the guide, except that each lasts a given time after its ego has departed."""
    keep_compiled_programs()
    libsumo = load_libsumo()
    for seed in range(count):
        config, told = network_config(_NETS[seed % len(_NETS)]), list[str]()
        command = ["sumo", "-c", str(config), "--collision.action", "warn", "--seed", str(seed), *_QUIET]
        libsumo.start(command)
        adversary, departed_s = Adversary(libsumo, "passenger", "observed", tell=told.append), None
        libsumo.addStepListener(adversary)
        while departed_s is None or libsumo.simulation.getTime() < departed_s + longest_s:
            libsumo.simulationStep()
            departed_s = libsumo.simulation.getTime() if departed_s is None and adversary.ego else departed_s
        libsumo.close()
        yield "told" if _complaints(told) else adversary.state


def main() -> int:
    """The command; 1 where something failed or has grown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--longest", type=float, default=8.0, help="seconds after which an episode ends")
    parser.add_argument("--listeners", action="store_true", help="the guide's example again and again")
    asked = parser.parse_args()
    found = run(asked.count, longest_s=asked.longest, talk=True, listeners=asked.listeners)
    print(json.dumps(found))
    return int(bool(found["failures"] or found["grown"]))


if __name__ == "__main__":
    sys.exit(main())
