"""Recording: the motion of every vehicle and every person on foot over one slot of time, as plain arrays.

Simulators and logs are turned into Recordings; `windows` makes Scenarios of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, count

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.errors import LogError, require
from regents_cosim.geometry.boxes import Boxes
from regents_cosim.geometry.frames import SumoPose, from_sumo, wrap
from regents_cosim.geometry.jumps import jumps
from regents_cosim.scenario.scenario import VEHICLE_KINDS, LeftOut, Signal
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
    given_speed: Float[np.ndarray, "vehicle time"] | None = None  # [m/s] where it agrees with the positions
    driven: Bool[np.ndarray, "vehicle step"] | None = None  # steps that are no jumps, however sudden they look
    egos: frozenset[str] | None = None  # vehicles that may be the ego; None: all
    riders: frozenset[str] = frozenset()  # persons who are left out while they ride
    z: Float[np.ndarray, "vehicle time"] | None = None  # [m] of the road; None: all at height 0
    guessed: frozenset[str] = frozenset()  # road users whose headings are a guess
    jumped: frozenset[str] = frozenset()  # road users without the instants at which they jump
    left_out: tuple[LeftOut, ...] = ()  # road users of the source that are not in here

    @cached_property
    def speed(self) -> Float[np.ndarray, "vehicle time"]:
        """Speeds [m/s], 0 where absent: those given, else from the positions."""
        if self.given_speed is not None:
            return np.where(self.valid, self.given_speed, 0.0)
        return speeds(self.x, self.y, self.yaw, self.valid, self.dt)

    @cached_property
    def motor(self) -> Bool[np.ndarray, " vehicle"]:
        """Which of them are motor vehicles."""
        return np.array([kind.kind in VEHICLE_KINDS for kind in self.types], bool)

    @property
    def heights(self) -> Float[np.ndarray, "vehicle time"]:
        """Heights of the road [m]."""
        return np.zeros(self.valid.shape) if self.z is None else self.z

    def distances(self, ego: int) -> Float[np.ndarray, "vehicle time"]:
        """Distances from the ego's centre to all others [m]; infinite where one of them is absent, and to itself."""
        apart = np.hypot(self.x - self.x[ego], self.y - self.y[ego])
        apart = np.where(self.valid & self.valid[ego], apart, np.inf)
        apart[ego] = np.inf
        return apart

    def jumps_of(self, one: int) -> bool:
        """Whether a vehicle jumps."""
        own = slice(one, one + 1)
        links = self.valid[own, :-1] & self.valid[own, 1:]
        found = jumps(self.x[own], self.y[own], links, self.dt)
        return bool((found if self.driven is None else found & ~self.driven[own]).any())

    def boxes(self, of: slice | Bool[np.ndarray, " vehicle"]) -> Boxes:
        """The boxes of some vehicles, [vehicle, time]."""
        sizes = np.array([(kind.length, kind.width) for kind in self.types])[of]
        return Boxes(self.x[of], self.y[of], self.yaw[of], sizes[:, :1], sizes[:, 1:], self.heights[of])


def speeds(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    yaw: Float[np.ndarray, "agent time"],
    valid: Bool[np.ndarray, "agent time"],
    dt: float,
) -> Float[np.ndarray, "agent time"]:
    """Speed of the box centre along its heading [m/s], never negative, 0 where invalid.

    Each displacement is projected on the heading midway. With the distance s driven so far, v[k] = (s[k+1] - s[k-1]) /
    (2 dt), and at the ends, also of second order, (-3 s[k] + 4 s[k+1] - s[k+2]) / (2 dt). So speed and positions agree,
    and a bicycle model can follow both; the speed that SUMO reports belongs to the next step and to the front bumper. A
    jump is not a motion: a step with a jump is ignored where a neighbouring step gives the speed. An instant with jumps
    alone beside it, as before a jump at the begin of a window, has the speed of the other side of the jump.
    """
    links = valid[:, :-1] & valid[:, 1:]
    middle = yaw[:, :-1] + 0.5 * wrap(np.diff(yaw))
    rates = (np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)) / dt
    driven = _of_rates(np.where(links & ~jumps(x, y, links, dt), rates, np.nan))
    border = np.full((len(x), 1), np.nan)
    later, earlier = (np.where(links, side, np.nan) for side in (driven[:, 1:], driven[:, :-1]))
    found = driven
    for estimate in (
        np.hstack([later, border]),
        np.hstack([border, earlier]),
        _of_rates(np.where(links, rates, np.nan)),
    ):
        found = np.where(np.isnan(found), estimate, found)
    return np.where(valid & ~np.isnan(found), np.maximum(found, 0.0), 0.0)


def _of_rates(rates: Float[np.ndarray, "agent step"]) -> Float[np.ndarray, "agent step+1"]:
    """Speed [m/s] at every instant from the mean speeds between instants; NaN where those are NaN."""
    border = np.full((len(rates), 2), np.nan)
    padded = np.hstack([border, rates, border])
    before2, before, after, after2 = padded[:, :-3], padded[:, 1:-2], padded[:, 2:-1], padded[:, 3:]
    found = 0.5 * (before + after)
    for near, far in ((after, after2), (before, before2)):
        for estimate in (1.5 * near - 0.5 * far, near):
            found = np.where(np.isnan(found), estimate, found)
    return found


def gathered(
    rows: Sequence[tuple[str, int, float, float, float, float]], steps: int
) -> tuple[tuple[str, ...], Bool[np.ndarray, "vehicle time"], Float[np.ndarray, "4 vehicle time"]]:
    """The ids in rows of an id, a step and four numbers, when each is there, and its numbers, 0 where it is not.

    Raises LogError for too many vehicles.
    """
    ids = tuple(sorted({row[0] for row in rows}))
    require(
        len(ids) * steps <= _MOST_CELLS,
        f"{len(ids)} vehicles at {steps} instants in one window, expected fewer than {_MOST_CELLS:g} places",
        LogError,
    )
    index = {name: i for i, name in enumerate(ids)}
    who, when = np.array([(index[row[0]], row[1]) for row in rows], int).reshape(-1, 2).T
    valid, values = np.zeros((len(ids), steps), bool), np.zeros((4, len(ids), steps))
    valid[who, when] = True
    values[:, who, when] = np.array([row[2:] for row in rows], float).reshape(-1, 4).T
    return ids, valid, values


class DistinctIds:
    """Ids that tell road users of one name apart if they differ in outline, or one is a person: `car`, then `car#2`.

    Types of another name are no reason: SUMO gives a vehicle that makes way for a blue light a type of its own for a
    while (`car@id`), and one that is handed over to its driver the type of that driver.
    """

    def __init__(self) -> None:
        self._ids: dict[tuple[str, VehicleType, bool], str] = {}
        self.types: dict[str, VehicleType] = {}  # by id

    def of(self, name: str, outline: VehicleType, walks: bool = False) -> str:
        """The id of the vehicle, or of the person, that is called `name`."""
        one = self._ids.get((name, outline, walks))
        if one is None:
            every = chain([name], (f"{name}#{number}" for number in count(2)))
            one = self._ids[name, outline, walks] = next(free for free in every if free not in self.types)
            self.types[one] = outline
        return one


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

    def named(self, name: str, kind: str, outline: VehicleType) -> str:
        """The id of a vehicle that SUMO calls `name` and that has the type `kind`."""
        one = self.names.of(name, outline)
        if self.ego != ANY_EGO and matches_vehicle(self.ego, name, kind):
            self.egos.add(one)
        return one

    def person(self, name: str, outline: VehicleType) -> str:
        """The id of a person, who may have the id of a vehicle, and is never the ego."""
        return self.names.of(name, outline, walks=True)

    def finish(self) -> Recording:
        """The finished Recording."""
        types = self.names.types
        rows = [row for row in self.rows if abs(row[2]) < _NOWHERE_M and abs(row[3]) < _NOWHERE_M]
        ids, valid, (x, y, angle, z) = gathered(rows, self.steps)
        lengths = np.array([types[name].length for name in ids], float)
        x, y, yaw = (np.where(valid, values, 0.0) for values in from_sumo(SumoPose(x, y, angle), lengths[:, None]))
        signals = tuple(Signal.of(name, letters) for name, letters in sorted(self.letters.items()))
        return Recording(
            begin_s=self.begin_s,
            dt=self.dt,
            ids=ids,
            types=tuple(types[name] for name in ids),
            x=x,
            y=y,
            yaw=yaw,
            valid=valid,
            signals=signals,
            egos=None if self.ego == ANY_EGO else frozenset(self.egos),
            riders=frozenset(self.riders),
            z=z,
        )
