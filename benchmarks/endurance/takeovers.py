"""Vehicles that were made to attack: what they have before and after, how they brake once given back, and who arrives.

    python -m benchmarks.endurance.takeovers crossing merge grid multilane --attacks 200
    python -m benchmarks.endurance.takeovers CITY.sumocfg --after 600 --attacks 50

SUMO drives the egos, one after the other, and `observed` is what the adversary expects of them. Every getter of TraCI
is asked of a vehicle before it is taken and after it was given back, and its speed in the next 20 steps. The same run
without an adversary tells who arrives by itself. Exit code 1 where a vehicle has lost something, or brakes by more than
its `decel` for none that has come into its way since.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

from regents_cosim.cases.shipped import NETWORKS, network_config
from regents_cosim.live import Adversary
from regents_cosim.live.attacked_ego import SumoHost
from regents_cosim.live.host.vehicle_control import SumoVehicleControl
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs
from regents_cosim.simulators.sumo.process import running_sumo
from tests.support.vehicle_state import differences, own, state

WATCHED = 20  # steps after it was given back
STEP_S = 0.1
_EACH_S = 12.0  # of simulated time for one ego
_MOVING_M_S = 3.0
_IN_SIGHT_M = 100.0
_MORE_M_S2 = 0.05  # than `decel`: rounding


@dataclass
class Takeover:
    """A vehicle that was taken over, and its state afterwards."""

    name: str
    taken_s: float
    before: dict[str, Any] = field(repr=False)
    decel: float = 0.0
    lost: dict[str, Any] = field(default_factory=dict)  # what it had, and has not any more
    speeds: list[float] = field(default_factory=list)  # when given back, and after each step since
    asked: list[float] = field(default_factory=list)  # [m/s^2] by its model for who is ahead, at each of these speeds
    at_ease: bool = False  # when it was given back
    in_hand: bool = True

    @property
    def rates(self) -> list[float]:
        """How hard [m/s^2] it braked in each step since it was given back."""
        return [(a - b) / STEP_S for a, b in zip(self.speeds, self.speeds[1:], strict=False)]

    @property
    def braked(self) -> float:
        """The hardest [m/s^2] since it was given back."""
        return max(self.rates, default=0.0)

    @property
    def is_hard(self) -> bool:
        """Whether it braked by more than its `decel`."""
        return self.braked > self.decel + _MORE_M_S2

    @property
    def is_for_another(self) -> bool:
        """Whether it was given back at ease, and braked so hard in no step but for who had come into its way by then.

        SUMO's own model of the vehicle says so, asked for the gap to who was ahead of it before the step.
        """
        hard = [asked for rate, asked in zip(self.rates, self.asked, strict=False) if rate > self.decel + _MORE_M_S2]
        return self.is_hard and self.at_ease and all(asked > self.decel for asked in hard)


@dataclass
class Seen:
    """The events of a run."""

    takeovers: list[Takeover] = field(default_factory=list)
    arrived: set[str] = field(default_factory=set)
    told: list[str] = field(default_factory=list)
    crashes: int = 0


def run(
    place: str, attacks: int, after_s: float, seed: int = 11, at_once: bool = False, longest_s: float = 900.0
) -> dict[str, Any]:
    """Attack on a shipped network or in a configuration, as often as asked; `at_once`: give back in mid-attack."""
    config = network_config(place) if place in NETWORKS else Path(place)
    with_us = _drive(config, attacks, after_s, seed, at_once, longest_s)
    taken = {one.name for one in with_us.takeovers}
    without = _drive(config, 0, after_s, seed, at_once, longest_s, taken)
    braked = [one for one in with_us.takeovers if not one.in_hand]
    hard = [one for one in braked if one.is_hard]
    ours = [one for one in hard if not one.is_for_another]
    return {
        "place": config.parent.name,
        "attacks": len(with_us.takeovers),
        "given back": len(braked),
        "crashes": with_us.crashes,
        "lost": {f"{one.name} at {one.taken_s:.1f} s": one.lost for one in braked if one.lost},
        "brake hard": {f"{one.name} at {one.taken_s:.1f} s": [round(v, 1) for v in one.speeds] for one in ours},
        "brake for another": [f"{one.name} at {one.taken_s:.1f} s" for one in hard if one.is_for_another],
        "hardest": round(max((one.braked for one in braked), default=0.0), 2),
        "arrive without us": len(taken & without.arrived),
        "arrive with us": len(taken & without.arrived & with_us.arrived),
        "told": with_us.told,
    }


def _drive(
    config: Path,
    attacks: int,
    after_s: float,
    seed: int,
    at_once: bool,
    longest_s: float,
    asked: set[str] | None = None,
) -> Seen:
    """A run with us, or one without us that ends as soon as those that are `asked` for have arrived."""
    seen = Seen()
    command = ["-c", str(config), "--no-step-log", "--no-warnings", "--step-length", str(STEP_S), "--seed", str(seed)]
    command += ["--time-to-teleport", "300", "--collision.action", "warn", "--random", "false"]
    with running_sumo(command) as sumo, _watching(sumo, seen):
        begin = sumo.simulation.getTime() + after_s
        adversary, egos, until, ended = None, _egos(sumo), begin, None
        while ended is None or sumo.simulation.getTime() < ended + longest_s:
            sumo.simulationStep()
            now = sumo.simulation.getTime()
            seen.arrived.update(sumo.simulation.getArrivedIDList())
            _watch(sumo, seen)
            wanted = {one.name for one in seen.takeovers} if asked is None else asked
            empty = sumo.simulation.getMinExpectedNumber() == 0
            if asked is not None or ended is not None or empty or len(seen.takeovers) >= attacks:
                ended = now if ended is None else ended
                if adversary is not None and adversary.state not in ("attacking", "returning"):
                    adversary.detach()
                    adversary = None
                if adversary is not None:
                    adversary.step()
                if empty or (adversary is None and seen.arrived >= wanted):
                    break
                continue
            if now >= until and (adversary is None or at_once or adversary.state not in ("attacking", "returning")):
                if adversary is not None:
                    adversary.detach()
                ego, until = next(egos, None), now + _EACH_S
                adversary = ego and Adversary(sumo, ego, planner="observed", judged=False, tell=seen.told.append)
            if adversary is not None:
                crashes = adversary.tally.crashes
                adversary.step()
                seen.crashes += adversary.tally.crashes - crashes
                held = seen.takeovers[-1] if seen.takeovers and seen.takeovers[-1].in_hand else None
                if at_once and held is not None and now - held.taken_s > 0.3 * (1 + len(seen.takeovers) % 10):
                    adversary.detach()
                    adversary, until = None, now
        if adversary is not None:
            adversary.detach()
    return seen


@contextmanager
def _watching(sumo: Any, seen: Seen) -> Iterator[None]:
    """Ask each vehicle before it is taken, and after it was given back."""
    take, give_back = SumoHost.take, SumoVehicleControl.give_back

    def asked_before(self: SumoHost, name: str, length_m: float) -> SumoVehicleControl:
        now = float(sumo.simulation.getTime())
        seen.takeovers.append(Takeover(name, now, state(sumo, name), sumo.vehicle.getDecel(name)))
        return take(self, name, length_m)

    def asked_after(self: SumoVehicleControl) -> bool:
        at_ease = self.name in sumo.vehicle.getIDList() and self.is_at_ease()
        there = give_back(self)
        if there:
            one = seen.takeovers[-1]
            one.lost = _lost(own(one.before), own(state(sumo, self.name)), _leads_to(sumo, self.name))
            one.speeds, one.in_hand, one.at_ease = [sumo.vehicle.getSpeed(self.name)], False, at_ease
            one.asked = [_asked(sumo, self.name)]
        return there

    with ExitStack() as patches:
        patches.enter_context(patch.object(SumoHost, "take", asked_before))
        patches.enter_context(patch.object(SumoVehicleControl, "give_back", asked_after))
        yield


def _lost(before: dict[str, Any], after: dict[str, Any], edge: str) -> dict[str, Any]:
    """The values that were not restored; passed stops do not count, and a vehicle off its route may keep another one.

    `edge` is the edge of the vehicle, or the one to which its way through a junction leads.
    """
    found = differences(before, after)
    passed = len(before["getStops"]) - len(after["getStops"])
    for name in ("getStops", "stop parameters"):
        if passed >= 0 and [one[:9] for one in before[name]][passed:] == [one[:9] for one in after[name]]:
            found.pop(name, None)
    if edge not in before["getRoute"]:
        for name in ("getRoute", "getRouteID", "getVia"):
            found.pop(name, None)
    return found


def _leads_to(sumo: Any, name: str) -> str:
    """The edge that a vehicle is on, or that its way through a junction leads to."""
    lane = sumo.vehicle.getLaneID(name)
    while lane.startswith(":"):
        lane = sumo.lane.getLinks(lane)[0][0]
    return lane.rpartition("_")[0]


def _watch(sumo: Any, seen: Seen) -> None:
    """Note how fast those are that were given back lately."""
    there: set[str] = set()
    for one in seen.takeovers[-5:]:
        if not one.in_hand and len(one.speeds) <= WATCHED:
            there = there or set(sumo.vehicle.getIDList())
            if one.name in there:
                one.speeds.append(sumo.vehicle.getSpeed(one.name))
                one.asked.append(_asked(sumo, one.name))


def _asked(sumo: Any, name: str) -> float:
    """How hard [m/s^2] its model has it brake for who is ahead of it on its way."""
    vehicle, speed = sumo.vehicle, sumo.vehicle.getSpeed(name)
    leader, gap_m = vehicle.getLeader(name, _IN_SIGHT_M) or ("", 0.0)
    if not leader:
        return 0.0
    follows = vehicle.getFollowSpeed(name, speed, gap_m, vehicle.getSpeed(leader), vehicle.getDecel(leader), leader)
    return (speed - follows) / STEP_S


def _egos(sumo: Any) -> Iterator[str | None]:
    """Cars that move, each once; where there is none, None for now."""
    had: set[str] = set()
    while True:
        moving = (v for v in sumo.vehicle.getIDList() if v not in had and sumo.vehicle.getSpeed(v) > _MOVING_M_S)
        found = next((v for v in moving if sumo.vehicle.getVehicleClass(v) in ("passenger", "private")), None)
        had.update([] if found is None else [found])
        yield found


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="+", help="shipped networks, or configurations of SUMO")
    parser.add_argument("--attacks", type=int, default=50, help="at each place")
    parser.add_argument("--after", type=float, default=30.0, help="simulated seconds before the first attack")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument(
        "--at-once", action="store_true", help="give back in the middle of attacks, at a call of detach"
    )
    asked = parser.parse_args()
    keep_compiled_programs()
    bad = Counter[str]()
    for place in asked.places:
        found = run(place, asked.attacks, asked.after, asked.seed, asked.at_once)
        bad.update({"lost": len(found["lost"]), "hard": len(found["brake hard"]) * (not asked.at_once)})
        print(json.dumps(found), flush=True)
    return int(bad.total() > 0)


if __name__ == "__main__":
    sys.exit(main())
