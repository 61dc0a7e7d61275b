"""What one look of a live adversary for a plan costs in crowded places, in CPU time, and what it finds there.

    python tests/speed/live_looks.py ../shared/data/sumo/bologna_acosta/run.sumocfg --after 600 --count 100

At each look there are 31 others within 100 m, and the ego is another one, far from the one before. What is timed is
the second look at it, two tenths of a second after its first; with `--first` the first, which asks more vehicles and
finds nothing prepared. Each look is timed three times, of which the least counts. A table of percentiles is printed,
and a digest of all plans, by which two versions are compared.
"""

import argparse
import copy
import hashlib
import time
from pathlib import Path
from typing import Any

import numpy as np

from regents_cosim.live.history import History
from regents_cosim.live.moments import MOST_AGENTS, Moments
from regents_cosim.live.predict import Mirror
from regents_cosim.live.reading import Reader
from regents_cosim.live.replanner import Replanner
from regents_cosim.live.search import Search
from regents_cosim.live.settings import HORIZON_S, live_config
from regents_cosim.live.sumo_host import SumoHost
from regents_cosim.mirror.compile_cache import keep_compiled_programs
from regents_cosim.simulators.sumo_process import CRASHES_STAY, running_sumo

_EACH_S = 2.0  # of simulated time
_TIMES = 3  # each look is timed, and the least taken: other work on the machine slows some of them down
_RADIUS_M = 100.0
_NEXT_S = 0.2  # from one look to the next
_MOVING_M_S, _FAR_M = 3.0, 80.0


class _Looks:
    """Looks in one simulation."""

    def __init__(self, sumo: Any, planner: str, first: bool, quick: bool) -> None:
        self._sumo, self._reader, self._first = sumo, Reader(sumo, _RADIUS_M), first
        self._search = Search(planner, live_config("focused", quick))
        self._last = np.full(2, np.inf)
        self._had: set[str] = set()
        self.took_ms, self.plans = list[float](), list[str]()

    def look(self) -> None:
        """One look, if there is a place for it."""
        now = float(self._sumo.simulation.getTime())
        ego = self._next()
        frame = None if ego is None else self._reader.frame(ego, now)
        if ego is None or frame is None or len(frame.ids) < MOST_AGENTS:
            return
        self._had.add(ego)
        self._last = np.array([frame.x[0], frame.y[0]])
        history = History(HORIZON_S, self._reader.step_s)
        history.add(frame)
        self._search.forget()
        if not self._first:
            self._replanner(self._search, history).fresh(frame, ())
            self._sumo.simulationStep(now + _NEXT_S)
            frame = self._reader.frame(ego, now + _NEXT_S)
            if frame is None or len(frame.ids) < MOST_AGENTS:
                return
            history.add(frame)
        took, found = [], None
        for _ in range(_TIMES):
            replanner = self._replanner(copy.deepcopy(self._search), history)
            if not self._first:
                replanner.prepare(frame)
            begun = time.process_time()
            found = replanner.fresh(frame, ())
            took.append(1e3 * (time.process_time() - begun))
        self.took_ms.append(min(took))
        plan = None if found is None else found[0]
        way = "" if plan is None else hashlib.sha256(np.stack([plan.x, plan.y]).round(6).tobytes()).hexdigest()[:12]
        self.plans.append(f"{now:.1f} {ego} {plan and plan.adversary} {way}")

    def _replanner(self, search: Search, history: History) -> Replanner:
        return Replanner(SumoHost(self._sumo, self._reader), search, Moments(Mirror(), HORIZON_S), history)

    def _next(self) -> str | None:
        """A vehicle that moves and has enough others around it; not the ego of before, nor near the last place."""
        vehicle = self._sumo.vehicle
        names = vehicle.getIDList()
        at = np.array([vehicle.getPosition(name) for name in names]).reshape(-1, 2)
        around = (np.hypot(*(at[:, None] - at).transpose(2, 0, 1)) < _RADIUS_M).sum(axis=1)
        far = np.hypot(*(at - self._last).T) > _FAR_M
        for name in (names[k] for k in np.flatnonzero(far & (around >= MOST_AGENTS))):
            if name not in self._had and vehicle.getSpeed(name) > _MOVING_M_S:
                return name
        return None


def measure(config: Path, after_s: float, count: int, planner: str, first: bool, quick: bool) -> _Looks:
    """So many looks, after one that compiles all programs."""
    keep_compiled_programs()
    options = {"step-length": "0.1", "seed": "11", **CRASHES_STAY}
    with running_sumo(["-c", str(config), *(w for k, v in options.items() for w in (f"--{k}", v))]) as sumo:
        begin = float(sumo.simulation.getTime()) + after_s
        sumo.simulationStep(begin)
        looks = _Looks(sumo, planner, first, quick)
        while len(looks.took_ms) < count + 1 and sumo.simulation.getMinExpectedNumber() > 0:
            sumo.simulationStep(float(sumo.simulation.getTime()) + _EACH_S)
            looks.look()
    return looks


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--after", type=float, default=600.0, help="simulated seconds before the first look")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--planner", default="idm")
    parser.add_argument("--first", action="store_true", help="time an ego's first look")
    parser.add_argument("--quick", action="store_true", help="without samples")
    parser.add_argument("--plans", action="store_true", help="print what each look found")
    asked = parser.parse_args()
    looks = measure(asked.config, asked.after, asked.count, asked.planner, asked.first, asked.quick)
    took, plans = np.array(looks.took_ms[1:]), looks.plans[1:]
    if asked.plans:
        print("\n".join(f"{ms:6.1f} ms  {plan}" for ms, plan in zip(took, plans, strict=True)))
    for share, ms in zip((50, 90, 95, 99, 100), np.percentile(took, (50, 90, 95, 99, 100)), strict=True):
        print(f"{share:3} % within {ms:6.1f} ms")
    found = sum(" None " not in plan for plan in plans)
    print(f"{len(took)} looks, {found} plans, digest {hashlib.sha256(chr(10).join(plans).encode()).hexdigest()[:16]}")


if __name__ == "__main__":
    main()
