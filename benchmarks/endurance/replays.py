"""Thousands of replays in one process: every one verified, nothing held in the end that was not held in the beginning.

    python -m benchmarks.endurance.replays --count 10000 --where sumo

SUMO's replays are one call, whose worker processes play many cases each; those in highway-env are drawn now and then.
"""

import argparse
import itertools
import json
import sys
import time
from collections.abc import Iterator
from typing import Any

from benchmarks.endurance.gauge import gauge, watched
from regents_cosim.cases.shipped import shipped
from regents_cosim.cases.suite import load_suite
from regents_cosim.replays.replay import Simulator, replay_each
from regents_cosim.replays.verify import Replay
from regents_cosim.scenario.scenario import Scenario

MOST_KB_PER_ITEM = 4.0  # a kept result of a replay takes 185
_DRAWN_EVERY = 20


def cases(where: Simulator) -> list[Scenario]:
    """Attacked cases that `where` verifies: of SUMO's networks and of highway-env's roads."""
    found = load_suite(shipped("scenarios") / "quickstart") + load_suite(shipped("scenarios") / "standard")
    crashes = [case for case in found if case.collision]
    return [case for case in crashes if where == "highway" or case.road.sumo_net]


def play(count: int, where: Simulator, every: int = 100, check_memory: bool = True) -> dict[str, Any]:
    """`count` replays; the report says what failed and what has grown."""
    known, begun = cases(where), time.monotonic()
    warm_up = min(max(len(known), every), max(count // 4, 1))
    wrong: dict[str, str] = {}
    done = 0
    with gauge() as seen:
        scenarios = list(itertools.islice(itertools.cycle(known), count))
        for replay in watched(_replays(scenarios, where), seen, warm_up, every):
            done += 1
            if not replay.verified:
                wrong[replay.case] = replay.reason
        summary = seen.summary()
        summary["grown"] = seen.growth(MOST_KB_PER_ITEM if check_memory else None)
        seen.take(count)
        summary["left"] = {"children": seen.samples[-1].children, "files": seen.samples[-1].files}
    seconds = round(time.monotonic() - begun, 1)
    return {"where": where, "count": done, "failures": wrong, "seconds": seconds, **summary}


def _replays(scenarios: list[Scenario], where: Simulator) -> Iterator[Replay]:
    if where != "highway":
        yield from replay_each(scenarios, where)
        return
    for number, scenario in enumerate(scenarios):
        yield next(replay_each([scenario], where))
        if number % _DRAWN_EVERY == 0:
            _draw(scenario)


def _draw(scenario: Scenario) -> None:
    """A few steps of the environment with a picture each, then closed."""
    from regents_cosim.envs import HighwayReplayEnv

    env = HighwayReplayEnv({"case": scenario}, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
        env.render()
    env.close()


def main() -> int:
    """The command; 1 where something failed or has grown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--where", choices=("sumo", "highway", "mirror"), default="sumo")
    asked = parser.parse_args()
    found = play(asked.count, asked.where)
    print(json.dumps(found))
    return int(bool(found["failures"] or found["grown"] or found["left"]["children"] or found["left"]["files"]))


if __name__ == "__main__":
    sys.exit(main())
