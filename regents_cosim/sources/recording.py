"""Recording: the motion of every vehicle and every person on foot over one slot of time, as plain arrays.

Simulators and logs are turned into Recordings; `windows` makes Scenarios of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.errors import LogError, require
from regents_cosim.geometry.frames import SumoPose, from_sumo
from regents_cosim.scenario import LeftOut, Signal
from regents_cosim.simulators import ANY_EGO
from regents_cosim.simulators.sumo.types import VehicleType

_MOST_CELLS = 20_000_000  # of a window: vehicles times instants
_NOWHERE_M = 1e8  # SUMO puts a vehicle without a position beyond this


@dataclass(frozen=True, eq=False)
class Recording:
    """Motion of all vehicles and persons over consecutive instants, box centres, in the map's frame."""

    begin_s: float  # time of the first instant [s]
    dt: float  # [s]
    ids: tuple[str, ...]  # increasing
    types: tuple[VehicleType, ...]
    x: Float[np.ndarray, "vehicle time"]  # [m]
    y: Float[np.ndarray, "vehicle time"]  # [m]
    yaw: Float[np.ndarray, "vehicle time"]  # [rad]
    valid: Bool[np.ndarray, "vehicle time"]
    signals: tuple[Signal, ...] = ()
    speed: Float[np.ndarray, "vehicle time"] | None = None  # [m/s] given where it agrees with the positions
    egos: frozenset[str] | None = None  # vehicles that may be the ego; None: all
    riders: frozenset[str] = frozenset()  # persons who are left out while they ride
    z: Float[np.ndarray, "vehicle time"] | None = None  # [m] of the road; None: all at height 0
    guessed: frozenset[str] = frozenset()  # road users whose headings are a guess
    jumped: frozenset[str] = frozenset()  # road users without the instants at which they jump
    left_out: tuple[LeftOut, ...] = ()  # road users of the source that are not in here


class DistinctIds:
    """Ids that tell vehicles apart if they use one id in turn, with different types: `car`, then `car#2`."""

    def __init__(self) -> None:
        self._kinds: dict[str, list[str]] = {}

    def of(self, name: str, kind: str) -> str:
        """The id of the vehicle that is called `name` and has the type `kind`."""
        known = self._kinds.setdefault(name, [])
        if kind not in known:
            known.append(kind)
        number = known.index(kind) + 1
        return name if number == 1 else f"{name}#{number}"


def matches_vehicle(wanted: str, vehicle: str, kind: str) -> bool:
    """Whether `wanted` names a vehicle of SUMO: by its id, its type `kind`, or the flow that it belongs to."""
    return wanted in (vehicle, kind, vehicle.rpartition(".")[0])


@dataclass
class GrowingRecording:
    """A Recording under construction, in SUMO's terms."""

    begin_s: float
    dt: float  # [s]
    steps: int
    # Vehicle or person, step, x and y of the front [m], degrees clockwise from north, height of the road [m].
    rows: list[tuple[str, int, float, float, float, float]] = field(default_factory=list)
    letters: dict[str, list[str]] = field(default_factory=dict)  # letters of every signal, per step
    riders: set[str] = field(default_factory=set)
    names: DistinctIds = field(default_factory=DistinctIds)
    ego: str = ANY_EGO  # which vehicles may be the ego
    egos: set[str] = field(default_factory=set)

    def named(self, name: str, kind: str) -> str:
        """The id of a vehicle that SUMO calls `name` and that has the type `kind`."""
        one = self.names.of(name, kind)
        if self.ego != ANY_EGO and matches_vehicle(self.ego, name, kind):
            self.egos.add(one)
        return one

    def person(self, name: str, kind: str) -> str:
        """The id of a person, who may have the id of a vehicle, and is never the ego."""
        return self.names.of(name, f"person {kind}")

    def finish(self, types: dict[str, VehicleType]) -> Recording:
        """The finished Recording; `types` gives the type of every vehicle."""
        rows = [row for row in self.rows if abs(row[2]) < _NOWHERE_M and abs(row[3]) < _NOWHERE_M]
        ids = tuple(sorted({row[0] for row in rows}))
        require(
            len(ids) * self.steps <= _MOST_CELLS,
            f"{len(ids)} vehicles at {self.steps} instants in one window, expected fewer than {_MOST_CELLS:g} places",
            LogError,
        )
        index = {name: i for i, name in enumerate(ids)}
        at = (np.array([index[row[0]] for row in rows], int), np.array([row[1] for row in rows], int))
        x, y, angle, z = np.array([row[2:] for row in rows], float).reshape(-1, 4).T
        lengths = np.array([types[name].length for name in ids], float)
        pose = from_sumo(SumoPose(x, y, angle), lengths[at[0]])
        arrays = {name: np.zeros((len(ids), self.steps)) for name in (*pose._fields, "z")}
        for name, values in (pose._asdict() | {"z": z}).items():
            arrays[name][at] = values
        valid = np.zeros((len(ids), self.steps), bool)
        valid[at] = True
        signals = tuple(Signal(name, changes(letters)) for name, letters in sorted(self.letters.items()))
        return Recording(
            begin_s=self.begin_s,
            dt=self.dt,
            ids=ids,
            types=tuple(types[name] for name in ids),
            x=arrays["x"],
            y=arrays["y"],
            yaw=arrays["yaw"],
            valid=valid,
            signals=signals,
            egos=None if self.ego == ANY_EGO else frozenset(self.egos),
            riders=frozenset(self.riders),
            z=arrays["z"],
        )


def changes(letters: Sequence[str]) -> tuple[tuple[int, str], ...]:
    """The steps at which a light changes, each with the new letter."""
    before = [None, *letters]
    return tuple((step, now) for step, now in enumerate(letters) if now != before[step])
