"""A city with an adversary after one ordinary vehicle after the other; what becomes of vehicles that are given back.

    python -m benchmarks.endurance.city CITY.sumocfg --after 600 --minutes 20

SUMO drives the egos, `observed` is what the adversary expects of them. The same run without it tells which vehicles
arrive by themselves. Exit code 1 where fewer than 95 % of those that attacked arrive as they do in that run.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from regents_cosim.live import Adversary

ARRIVE = 0.95
_EACH_S = 60.0  # of simulated time for one ego
_MOVING_M_S = 3.0
_EDGES_LEFT = 3


@dataclass
class Seen:
    """The events of a run."""

    arrived: set[str] = field(default_factory=set)
    attacked: set[str] = field(default_factory=set)  # vehicles that were made to attack
    attacks: int = 0
    crashes: int = 0
    told: list[str] = field(default_factory=list)
    vehicles: list[int] = field(default_factory=list)
    last: dict[str, str] = field(default_factory=dict)  # of those that attacked: when, where and how they were last


def run(config: Path, after_s: float, minutes: float, scale: float = 1.0, longest_s: float = 900.0) -> dict[str, Any]:
    """Both runs; `longest_s` is what vehicles are given to arrive when the attacks are over.

    Of each vehicle that the configuration has there are `scale`.
    """
    given = config, after_s, 60.0 * minutes, scale, longest_s
    with_us = _drive(*given)
    without = _drive(*given, asked=with_us.attacked)
    would = with_us.attacked & without.arrived
    return {
        "vehicles": round(sum(with_us.vehicles) / max(len(with_us.vehicles), 1)),
        "least vehicles": min(with_us.vehicles, default=0),
        "attacks": with_us.attacks,
        "crashes": with_us.crashes,
        "given back": len(with_us.attacked),
        "arrive without us": len(would),
        "arrive with us": len(would & with_us.arrived),
        "do not": {name: with_us.last[name] for name in sorted(would - with_us.arrived)},
        "told": with_us.told,
    }


def _drive(
    config: Path, after_s: float, lasting_s: float, scale: float, longest_s: float, asked: set[str] | None = None
) -> Seen:
    """A run with us, or one without us that ends as soon as those that are `asked` for have arrived."""
    import libsumo as sumo  # one simulation a process: not before it is needed

    seen = Seen()
    options = ["--no-step-log", "--no-warnings", "--step-length", "0.1", "--seed", "11", "--time-to-teleport", "300"]
    options += ["--scale", str(scale), "--random", "false"]  # both runs are to throw the same dice
    sumo.start(["sumo", "-c", str(config), "--collision.action", "warn", *options])
    begin = sumo.simulation.getTime() + after_s
    adversary, egos, until = None, _egos(sumo), 0.0
    while (now := sumo.simulation.getTime()) < begin + lasting_s + longest_s:
        sumo.simulationStep()
        seen.arrived.update(sumo.simulation.getArrivedIDList())
        there = seen.attacked.intersection(sumo.vehicle.getIDList() if seen.attacked else ())
        seen.last.update({name: _where(sumo, name) for name in there})
        over = asked is not None or now >= begin + lasting_s + _EACH_S
        if over and seen.arrived >= (seen.attacked if asked is None else asked):
            break
        if asked is not None or not begin <= now < begin + lasting_s + _EACH_S:
            continue
        seen.vehicles.append(sumo.vehicle.getIDCount())
        if adversary is None or now >= until:
            adversary, until = _next(sumo, adversary, egos, seen, now < begin + lasting_s), now + _EACH_S
        if adversary is not None:
            adversary.step()
            seen.attacked.update(filter(None, [adversary.adversary]))
    sumo.close()
    return seen


def _where(sumo: Any, name: str) -> str:
    """When and where a vehicle is, what it does there, and how far it has come on its route."""
    vehicle = sumo.vehicle
    on = f"{vehicle.getRouteIndex(name) + 1} of {len(vehicle.getRoute(name))} edges"
    waited = f"{vehicle.getSpeed(name):.1f} m/s, waited {vehicle.getAccumulatedWaitingTime(name):.0f} s of late"
    lane = vehicle.getLaneID(name) or "no lane"
    return f"{sumo.simulation.getTime():.1f} s, {lane} at {vehicle.getLanePosition(name):.0f} m, {on}, {waited}"


def _next(sumo: Any, last: Adversary | None, egos: Iterator[str | None], seen: Seen, wanted: bool) -> Adversary | None:
    """Give back what the last one held, and attach one to the next ego."""
    if last is not None:
        last.detach()
        seen.attacks += last.tally.attacks
        seen.crashes += last.tally.crashes
    ego = next(egos, None) if wanted else None
    return None if ego is None else Adversary(sumo, ego, planner="observed", judged=False, tell=seen.told.append)


def _egos(sumo: Any) -> Iterator[str | None]:
    """Cars that move and have a way ahead, each once; where there is none, None for now."""
    had: set[str] = set()
    while True:
        found = next((v for v in sumo.vehicle.getIDList() if v not in had and _suits(sumo, v)), None)
        had.update([] if found is None else [found])
        yield found


def _suits(sumo: Any, vehicle: str) -> bool:
    left = len(sumo.vehicle.getRoute(vehicle)) - sumo.vehicle.getRouteIndex(vehicle)
    moves = sumo.vehicle.getSpeed(vehicle) > _MOVING_M_S
    return moves and left > _EDGES_LEFT and sumo.vehicle.getVehicleClass(vehicle) in ("passenger", "private")


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", type=Path)
    parser.add_argument("--after", type=float, default=600.0, help="simulated seconds before the first attack")
    parser.add_argument("--minutes", type=float, default=20.0, help="of attacks, simulated")
    parser.add_argument("--scale", type=float, default=1.0, help="so many times the traffic of the configuration")
    asked = parser.parse_args()
    found = run(asked.config, asked.after, asked.minutes, asked.scale)
    print(json.dumps(found))
    return int(found["arrive with us"] < ARRIVE * found["arrive without us"])


if __name__ == "__main__":
    sys.exit(main())
