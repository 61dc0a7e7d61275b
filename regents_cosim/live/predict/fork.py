"""A predictor that continues a copy of the simulation in a second SUMO, in a separate process.

It is exact as far as SUMO's saved states are complete. They omit the random state, unless SUMO runs with
`--save-state.rng`, and some intentions of drivers, so that single vehicles may move differently. In the copy SUMO
drives the adversary. Each prediction starts SUMO, and saves and loads a state: about 50 ms, more with the network of a
city.
"""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from regents_cosim.geometry.frames import SumoPose, from_sumo
from regents_cosim.live.predict.traffic import TrafficState
from regents_cosim.scenario import Tracks
from regents_cosim.simulators.sumo.config import SumoInput, read_input, write_config
from regents_cosim.simulators.sumo.files import ShownFiles, survey
from regents_cosim.simulators.sumo.options import path_of
from regents_cosim.simulators.sumo.process import CRASHES_STAY, running_sumo
from regents_cosim.system.workers import LocalProcesses, local_processes, result_of, submit

_SAME_OPTIONS = ("lateral-resolution", "lanechange.duration", "step-method.ballistic", "default.action-step-length")
_MOST_DIGITS = "16"


class Fork:
    """A predictor for one running simulation; `close` ends its process."""

    def __init__(self, connection: Any) -> None:
        """`connection` is libsumo, traci, or one of traci's connections, with a running simulation."""
        self._sumo = connection
        self._folder = tempfile.TemporaryDirectory()
        self._process: LocalProcesses | None = None

    def predict(self, traffic: TrafficState, dt: float, steps: int) -> Tracks:
        """The tracks [user, time] from now on, by a second SUMO. Raises SumoError where that refuses."""
        folder = Path(self._folder.name)
        if self._process is None:
            self._process = local_processes(1)
            self._config = self._write_config(folder)
        state = folder / "state.xml"
        self._sumo.simulation.saveState(str(state))
        ids = tuple(user.agent.id for user in traffic.users)
        step_s = float(self._sumo.simulation.getDeltaT())
        shown = ShownFiles(survey([state]), folder).of(state)  # its vehicles may have devices that write
        seen = result_of(submit(self._process, _run_ahead, self._config, shown, ids, round((steps - 1) * dt / step_s)))
        return _tracks(traffic, seen, step_s, np.arange(steps) * dt)

    def close(self) -> None:
        """End the process, and delete its files."""
        if self._process is not None:
            self._process.shutdown()
            self._process = None
        self._folder.cleanup()

    def _write_config(self, folder: Path) -> Path:
        """Write a configuration for the second SUMO: the same network and traffic, without outputs."""
        option = self._option
        routes, additional = ([path_of(one.strip()) for one in option(name).split(",") if one.strip()] for name in
                              ("route-files", "additional-files"))  # fmt: skip
        given = read_input(SumoInput(net=path_of(option("net-file")), routes=(*routes,), additional=(*additional,)))
        same = {name: value for name in _SAME_OPTIONS if (value := option(name))}
        same |= {"step-length": option("step-length"), "seed": option("seed"), "save-state.precision": _MOST_DIGITS}
        return write_config(given, folder, same | CRASHES_STAY, {})

    def _option(self, name: str) -> str:
        try:
            return str(self._sumo.simulation.getOption(name))
        except Exception:  # an older SUMO lacks some of them; TraCI's errors have no common class
            return ""


def _run_ahead(config: Path, state: Path, ids: tuple[str, ...], steps: int) -> Float[np.ndarray, "time user 4"]:
    """X, y of front bumpers, angle and speed in SUMO's terms, now and after each step; NaN for vehicles that are gone.

    SUMO is restarted for each prediction, since loading a state does not reset its random state.
    """
    seen = np.full((steps + 1, len(ids), 4), np.nan)
    with running_sumo(["-c", str(config)]) as sumo:
        vehicle = sumo.vehicle
        sumo.simulation.loadState(str(state))
        for step in range(steps + 1):
            if step:
                sumo.simulationStep()
            there = set(vehicle.getIDList())
            for row, name in enumerate(ids):
                if name in there:
                    seen[step, row] = *vehicle.getPosition(name), vehicle.getAngle(name), vehicle.getSpeed(name)
    return seen


def _tracks(
    traffic: TrafficState,
    seen: Float[np.ndarray, "step user 4"],
    step_s: float,
    times_s: Float[np.ndarray, " time"],
) -> Tracks:
    """The tracks in the map's frame at the wanted times; a vehicle that is gone does not come back."""
    length = [user.agent.length for user in traffic.users]
    there = np.logical_and.accumulate(np.isfinite(seen[..., 0]), axis=0)
    at = np.arange(len(seen)) * step_s
    columns = {name: np.zeros((len(length), len(times_s))) for name in ("x", "y", "yaw", "speed")}
    valid = np.zeros((len(length), len(times_s)), bool)
    for row, user in enumerate(traffic.users):
        known = int(there[:, row].sum())
        now = np.array([[user.x], [user.y], [user.yaw], [user.speed]])
        x, y, angle, speed = seen[:known, row].T
        pose = from_sumo(SumoPose(x, y, angle), length[row])
        path = np.concatenate([now, np.stack([*map(np.asarray, pose), np.maximum(speed, 0.0)])[:, 1:]], axis=1)
        path[2] = np.unwrap(path[2])
        valid[row] = (times_s <= at[max(known - 1, 0)] + 1e-9) | (row == 0)
        for values, own in zip(columns.values(), path, strict=True):
            values[row] = np.where(valid[row], np.interp(times_s, at[: path.shape[1]], own), 0.0)
    z = np.where(valid, traffic.values("z")[:, None], 0.0)
    return Tracks(**columns, valid=valid, z=z)
