"""How far off vehicles are from where `CarFollowingPredictor` foresaw them, in traffic that nothing attacks.

    python -m benchmarks.prediction_error merge crossing grid roundabout signals multilane --seed 610 --count 2
    python -m benchmarks.prediction_error CITY.sumocfg

Every other second one vehicle is the ego; asked is where all others within 60 m of it are some seconds later. What
SUMO says of an ego's planner does not matter here: SUMO drives all of them.
"""

import argparse
from pathlib import Path

import numpy as np

from regents_cosim.cases.shipped import network_config
from regents_cosim.geometry.frames import Pose, to_sumo
from regents_cosim.live.host.reading import SimulationReader
from regents_cosim.live.predict.traffic_ahead import CarFollowingPredictor
from regents_cosim.simulators.sumo.process import running_sumo

_RADIUS_M, _NEAR_M, _MOST = 100.0, 60.0, 24
_BEGINS_S, _LASTS_S, _EACH_S = 30.0, 160.0, 2.0
_AFTER_S = (3.0, 6.0)
_OFF_M = 4.0


def errors(config: Path, seed: int) -> dict[float, list[tuple[float, float]]]:
    """How far each was ahead of where it was foreseen, and off it [m], after so many seconds."""
    wanted = list[tuple[int, float, str, np.ndarray, float]]()  # step, seconds, who, front [m], yaw
    where = list[dict[str, tuple[float, float]]]()
    rng = np.random.default_rng(seed)
    with running_sumo(["-c", str(config), "--seed", str(seed), "--step-length", "0.1"]) as sumo:
        reader = SimulationReader(sumo, _RADIUS_M)
        for step in range(round(_LASTS_S / 0.1)):
            sumo.simulationStep()
            names = sumo.vehicle.getIDList()
            where.append({name: sumo.vehicle.getPosition(name) for name in names})
            over_s = 0.1 * step
            if step % round(_EACH_S / 0.1) or not _BEGINS_S < over_s < _LASTS_S - max(_AFTER_S) or len(names) < 2:
                continue
            frame = reader.frame(names[rng.integers(len(names))], sumo.simulation.getTime())
            if frame is not None:
                traffic = reader.traffic(frame, _MOST, max(_AFTER_S))
                tracks = CarFollowingPredictor().predict(traffic, 0.1, round(max(_AFTER_S) / 0.1) + 1)
                for row, user in list(enumerate(traffic.users))[1:]:
                    away = np.hypot(tracks.x[row, 0] - tracks.x[0, 0], tracks.y[row, 0] - tracks.y[0, 0])
                    for after_s in _AFTER_S if away < _NEAR_M else ():
                        at = row, round(after_s / 0.1)
                        front = to_sumo(Pose(tracks.x[at], tracks.y[at], tracks.yaw[at]), user.agent.length)
                        if tracks.valid[at]:
                            place = np.array([front.x, front.y], float)
                            wanted.append((step + at[1], after_s, user.agent.id, place, float(tracks.yaw[at])))
    found: dict[float, list[tuple[float, float]]] = {after_s: [] for after_s in _AFTER_S}
    for step, after_s, name, front, yaw in wanted:
        if name in where[step]:
            off = np.array(where[step][name]) - front
            found[after_s].append((float(off @ [np.cos(yaw), np.sin(yaw)]), float(np.hypot(*off))))
    return found


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("places", nargs="+", help="shipped networks, or configurations of SUMO")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1, help="runs, each with a seed one higher")
    asked = parser.parse_args()
    print("| place | after s | n | mean m | median m | > 4 m behind % | > 4 m ahead % |\n|---|---|---|---|---|---|---|")
    for place in asked.places:
        config = Path(place) if place.endswith(".sumocfg") else network_config(place)
        runs = [errors(config, asked.seed + k) for k in range(asked.count)]
        for after_s in _AFTER_S:
            ahead, off = np.array([one for run in runs for one in run[after_s]]).T
            behind, before = (100.0 * np.mean(side) for side in (ahead < -_OFF_M, ahead > _OFF_M))
            told = after_s, len(off), off.mean().round(1), np.median(off).round(1), round(behind), round(before)
            print(f"| {config.stem} | {' | '.join(f'{value:g}' for value in told)} |")


if __name__ == "__main__":
    main()
