"""How long one look of a live adversary for a plan takes in crowded places, and what it finds there.

    python benchmarks/speed/live_looks.py CITY.sumocfg --after 600 --count 100

There are 31 others within 100 m, and at each place the ego is another one, far from the one before. What is timed is
the second look at it, two tenths of a second after its first, and what is done in the step after it: the road ahead of
the ego, and samples where the look found drives that miss. With `--first` it is the first look, which asks more
vehicles. Each is timed three times by the clock, of which the least counts: the machine should be idle. A table of
percentiles is printed for each kind, and a digest of all plans, by which two versions are compared.
"""

import argparse
import copy
import hashlib
import time
from pathlib import Path
from typing import Any

import numpy as np

from regents_cosim.live.attacked_ego import SumoHost
from regents_cosim.live.host.coordination import Coordination
from regents_cosim.live.host.interface import Frame, History
from regents_cosim.live.predict.moments import MOST_AGENTS, Moments
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.live.search.plans import Search
from regents_cosim.live.search.replanner import Replanner
from regents_cosim.live.settings import HORIZON_S, live_config
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs
from regents_cosim.simulators.sumo.process import CRASHES_STAY, running_sumo

_EACH_S = 2.0  # of simulated time
_TIMES = 3  # each look is timed, and the least taken: other work on the machine slows some of them down
_RADIUS_M = 100.0
_STEP_S = 0.1
_MOVING_M_S, _FAR_M = 3.0, 80.0


class _Looks:
    """Looks in one simulation."""

    def __init__(self, sumo: Any, planner: str, first: bool) -> None:
        self._sumo, self._host, self._first = sumo, SumoHost(sumo, _RADIUS_M, None, Coordination(), print), first
        self._search = Search(planner, live_config("focused-live"))
        self._last = np.full(2, np.inf)
        self._had: set[str] = set()
        self.places, self._warm = 0, False
        self.kinds, self.took_ms, self.plans = list[str](), list[float](), list[str]()

    def look(self) -> None:
        """The looks at one ego, if there is a place for them."""
        now = float(self._sumo.simulation.getTime())
        ego = self._next()
        frame = None if ego is None else self._host.frame(ego, now)
        if ego is None or frame is None or len(frame.ids) < MOST_AGENTS:
            return
        self._had.add(ego)
        self._last = np.array([frame.x[0], frame.y[0]])
        history = History(HORIZON_S, self._host.step_s)
        history.frames.append(frame)
        self._search.forget()
        replanner = Replanner(self._host, self._search, Moments(CarFollowingPredictor(), HORIZON_S), history)
        if not self._warm:
            replanner.fresh(frame, ())  # compiles all programs
            self._warm = True
            return
        self.places += 1
        if self._first:
            self._timed("first look", frame, replanner)
            return
        replanner.fresh(frame, ())
        for step in ("before", "look", "step after it"):
            frame = self._later(ego, history)
            if frame is None:
                return
            if step == "before":
                replanner.prepare(frame)
                replanner.sampled()
            else:
                replanner = self._timed(step, frame, replanner)

    def _later(self, ego: str, history: History) -> Frame | None:
        """The frame one step later; None where it has too few vehicles."""
        now = float(self._sumo.simulation.getTime()) + _STEP_S
        self._sumo.simulationStep(now)
        frame = self._host.frame(ego, now)
        if frame is None or len(frame.ids) < MOST_AGENTS:
            return None
        history.frames.append(frame)
        return frame

    def _timed(self, kind: str, frame: Frame, replanner: Replanner) -> Replanner:
        """Note how long it takes and what it finds."""
        took, found, trial = [], None, replanner
        for _ in range(_TIMES):
            apart = copy.deepcopy(replanner._search), copy.deepcopy(replanner._moments)
            trial = Replanner(replanner._host, *apart, replanner._history)
            begun = time.perf_counter()
            if kind == "step after it":
                trial.prepare(frame)
                found = trial.sampled()
            else:
                found = trial.fresh(frame, ())
            took.append(1e3 * (time.perf_counter() - begun))
        self.kinds.append(kind)
        self.took_ms.append(min(took))
        plan = None if found is None else found[0]
        way = "" if plan is None else hashlib.sha256(np.stack([plan.x, plan.y]).round(6).tobytes()).hexdigest()[:12]
        self.plans.append(f"{frame.time_s:.1f} {frame.ids[0]} {plan and plan.adversary} {way}")
        return trial

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


def measure(config: Path, after_s: float, places: int, planner: str, first: bool) -> _Looks:
    """The looks at so many places, after one at which all programs are compiled."""
    keep_compiled_programs()
    options = {"step-length": str(_STEP_S), "seed": "11", **CRASHES_STAY}
    with running_sumo(["-c", str(config), *(w for k, v in options.items() for w in (f"--{k}", v))]) as sumo:
        begin = float(sumo.simulation.getTime()) + after_s
        sumo.simulationStep(begin)
        looks = _Looks(sumo, planner, first)
        while looks.places < places and sumo.simulation.getMinExpectedNumber() > 0:
            sumo.simulationStep(float(sumo.simulation.getTime()) + _EACH_S)
            looks.look()
    return looks


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--after", type=float, default=600.0, help="simulated seconds before the first look")
    parser.add_argument("--count", type=int, default=100, help="places")
    parser.add_argument("--planner", default="idm")
    parser.add_argument("--first", action="store_true", help="time an ego's first look")
    parser.add_argument("--plans", action="store_true", help="print what each look found")
    asked = parser.parse_args()
    looks = measure(asked.config, asked.after, asked.count, asked.planner, asked.first)
    if asked.plans:
        print(
            "\n".join(
                f"{k:8} {ms:6.1f} ms  {plan}"
                for k, ms, plan in zip(looks.kinds, looks.took_ms, looks.plans, strict=True)
            )
        )
    for kind in dict.fromkeys(looks.kinds):
        took = [ms for ms, of in zip(looks.took_ms, looks.kinds, strict=True) if of == kind]
        found = sum(" None " not in plan for plan, of in zip(looks.plans, looks.kinds, strict=True) if of == kind)
        print(f"{kind}: {len(took)} looks, {found} plans")
        for share, ms in zip((50, 90, 95, 99, 100), np.percentile(took, (50, 90, 95, 99, 100)), strict=True):
            print(f"  {share:3} % within {ms:6.1f} ms")
    print(f"digest {hashlib.sha256(chr(10).join(looks.plans).encode()).hexdigest()[:16]}")


if __name__ == "__main__":
    main()
