"""LoggedScene: the form in which every reader returns its log, whatever the format.

Frame: the log's own map frame, converted to x east, y north, metres, box centres, yaw in radians counter-clockwise from
+x. Tracks hold only the samples that the log calls valid, so a recording of hours takes the memory of its rows.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from regents_cosim.checks.work import STEPS, Work
from regents_cosim.errors import LogError, require
from regents_cosim.geometry.frames import from_front
from regents_cosim.geometry.lines import steps_along
from regents_cosim.maps.roadmap import Approach
from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.scenario.scenario import MOST_SIZE_M, VEHICLE_KINDS, Agent, Kind, LeftOut
from regents_cosim.short_repr import ShortRepr

_FARTHEST_M = 1e8
_LONGEST_M = 5000.0  # longest straight piece of a kerb or lane
COARSEST_S = 1.0  # between samples further apart, the path of a vehicle would be a guess
FINEST_S = 1e-3
LATEST_STEP = 10**13  # 30,000 years at 10 Hz; so late, consecutive instants are still different floats
_JOIN_M = 0.6  # between the end of a lane and the start of its successor
_LEAST_M = 0.05  # least length or width; smaller numbers are damaged
_LONGEST_USER_M = 100.0
_WIDEST_VEHICLE_M = 3.0
DEFAULT_SIZES: dict[Kind, tuple[float, float]] = {
    "car": (4.7, 2.0), "truck": (9.0, 2.6), "bus": (11.0, 2.6), "motorcycle": (2.1, 0.8),
    "bicycle": (1.8, 0.65), "pedestrian": (0.6, 0.6), "other": (0.7, 0.7),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Track:
    """The samples of one road user."""

    agent: Agent
    step: Int[np.ndarray, " sample"]  # increasing numbers of the log's instants
    x: Float[np.ndarray, " sample"]  # [m]
    y: Float[np.ndarray, " sample"]  # [m]
    yaw: Float[np.ndarray, " sample"]  # [rad]
    z: Float[np.ndarray, " sample"] | None = None  # [m] of the ground or the box, where the log has it
    guessed: bool = False  # the headings are a guess: neither the log nor its surroundings tell them

    def __post_init__(self) -> None:
        name = f"track {self.agent.id[:40]!r}"
        require(len(self.step) > 0, f"{name}: no samples", LogError)
        for values in (self.x, self.y, self.yaw, *(() if self.z is None else (self.z,))):
            require(values.shape == self.step.shape, f"{name}: arrays of different lengths", LogError)
            require(bool(np.isfinite(values).all()), f"{name}: NaN or infinite numbers at valid samples", LogError)
            require(np.abs(values).max() < _FARTHEST_M, f"{name}: a number beyond {_FARTHEST_M:g}", LogError)
        require(bool((np.diff(self.step) > 0).all()), f"{name}: time does not increase", LogError)
        require(self.step[0] >= 0 and self.step[-1] <= LATEST_STEP, f"{name}: time is out of range", LogError)
        least, most = _LEAST_M, MOST_SIZE_M if self.agent.kind == "other" else _LONGEST_USER_M  # walls are longer
        for size in (self.agent.length, self.agent.width):
            require(least <= size <= most, f"{name}: {size:g} m long or wide, expected {least} to {most} m", LogError)

    @cached_property
    def breaks(self) -> Int[np.ndarray, " gap"]:
        """The indices of samples that follow a gap."""
        return np.flatnonzero(np.diff(self.step) != 1) + 1

    @cached_property
    def motion(self) -> Float[np.ndarray, "3 sample"]:
        """x, y and the unwrapped yaw."""
        return np.stack([self.x, self.y, np.unwrap(self.yaw)])

    def pieces(self) -> Iterator[tuple[int, int]]:
        """First and last step of every piece without a gap."""
        starts, ends = np.concatenate([[0], self.breaks]), np.concatenate([self.breaks - 1, [len(self.step) - 1]])
        yield from zip(self.step[starts].tolist(), self.step[ends].tolist(), strict=True)


def _check_line(name: str, points: np.ndarray, z: np.ndarray | None) -> None:
    require(points.ndim == 2 and points.shape[1:] == (2,) and len(points) >= 2, f"{name}: no line", LogError)
    require(z is None or z.shape == points.shape[:1], f"{name}: heights of another length", LogError)
    for values in (points, *(() if z is None else (z,))):
        require(bool(np.isfinite(values).all()), f"{name}: NaN or infinite numbers", LogError)
        require(np.abs(values).max() < _FARTHEST_M, f"{name}: a number beyond {_FARTHEST_M:g}", LogError)
    jump = float(steps_along(*points.T).max())
    require(jump < _LONGEST_M, f"{name} jumps by {jump:.0f} m, expected less than {_LONGEST_M:.0f} m", LogError)


@dataclass(frozen=True, eq=False)
class LoggedLane:
    """A lane as the log has it; its neighbours run the same way."""

    id: str
    centre: Float[np.ndarray, "point 2"]  # [m] in the direction of travel
    width: float = 3.5  # [m]
    speed_limit: float = ASSUMED_LIMIT_M_S  # [m/s]
    exits: tuple[str, ...] = ()  # lanes it continues into
    left: str | None = None
    right: str | None = None
    junction: bool = False
    z: Float[np.ndarray, " point"] | None = None  # [m]
    open_start: bool = True  # no lane of the map leads here, so traffic comes from beyond the map
    open_end: bool = True
    approach: Approach | None = None  # by the signs at its end or begin

    def __post_init__(self) -> None:
        _check_line(f"lane {self.id[:40]!r}", self.centre, self.z)
        for value in (self.width, self.speed_limit):
            require(bool(np.isfinite(value)) and value > 0, f"lane {self.id[:40]!r}: {value} wide or fast", LogError)


@dataclass(frozen=True, eq=False)
class RoadEdge:
    """A kerb with the road on its left."""

    points: Float[np.ndarray, "point 2"]  # [m]
    z: Float[np.ndarray, " point"] | None = None  # [m]

    def __post_init__(self) -> None:
        _check_line("a kerb", self.points, self.z)


@dataclass(frozen=True, eq=False)
class LoggedMap:
    """The road of a log: kerbs or areas to drive on (without both, it is where vehicles drove), lanes and crossings."""

    lanes: tuple[LoggedLane, ...] = ()
    edges: tuple[RoadEdge, ...] = ()
    areas: tuple[shapely.Polygon, ...] = ()
    crossings: tuple[shapely.Polygon, ...] | None = None  # None: the map does not tell them

    def __post_init__(self) -> None:
        areas = (*self.areas, *(self.crossings or ()))
        farthest = float(np.abs(shapely.total_bounds(areas)).max()) if areas else 0.0
        require(farthest < _FARTHEST_M, f"an area to drive on: a number beyond {_FARTHEST_M:g}", LogError)


@dataclass(frozen=True)
class LoggedSignal:
    """A traffic light with its letters (SUMO's), and the lane at whose start or end it stands.

    Without `ends` there is one letter per instant of the log, and the last one stays. With `ends` each letter is shown
    until its step in `ends`, counted from `offset`, and the cycle begins again after the last.
    """

    id: str
    letters: str
    lanes: tuple[str, ...]
    at_start: bool = False
    ends: tuple[int, ...] = ()  # steps after `offset`
    offset: int = 0

    def shown(self, step: Int[np.ndarray, " instant"]) -> list[str]:
        """The letter at each of the given instants of the log."""
        if not self.ends:
            index = np.clip(step, 0, len(self.letters) - 1)
        else:
            index = np.searchsorted(self.ends, (step - self.offset) % self.ends[-1], side="right")
        return [self.letters[i] for i in index]


@dataclass(frozen=True, eq=False, repr=False)
class LoggedScene(ShortRepr):
    """One recording of a log."""

    name: str
    dt: float  # [s] between the instants of the log
    tracks: tuple[Track, ...]
    road: LoggedMap = field(default_factory=LoggedMap)
    ego: str | None = None  # the recorder's own vehicle, or the one a planning problem is about
    target: tuple[float, float] | None = None  # [m] of that ego
    signals: tuple[LoggedSignal, ...] = ()
    begin_s: float = 0.0  # time of instant 0 in the log [s]
    notes: tuple[str, ...] = ()  # assumptions of the reader
    left_out: tuple[LeftOut, ...] = ()  # road users of the file that have no track; `notes` says so too

    def __post_init__(self) -> None:
        require(
            FINEST_S <= self.dt <= COARSEST_S,
            f"{self.name}: one sample every {self.dt:g} s, expected {FINEST_S} to {COARSEST_S:g} s",
            LogError,
        )
        require(len(self.tracks) > 0, f"{self.name}: it holds no road user", LogError)
        ids = [track.agent.id for track in self.tracks]
        require(len(set(ids)) == len(ids), f"{self.name}: two road users have the same id", LogError)
        require(self.ego is None or self.ego in ids, f"{self.name}: the ego {self.ego!r} has no track", LogError)
        lanes = {lane.id for lane in self.road.lanes}
        require(len(lanes) == len(self.road.lanes), f"{self.name}: two lanes have the same id", LogError)

    @property
    def first_step(self) -> int:
        """The first instant at which a road user is present."""
        return int(min(track.step[0] for track in self.tracks))

    @property
    def last_step(self) -> int:
        """The last instant at which a road user is present."""
        return int(max(track.step[-1] for track in self.tracks))

    @property
    def duration_s(self) -> float:
        """The time from the first sample to the last [s]."""
        return (self.last_step - self.first_step) * self.dt


def agent_with_size(
    name: str, kind: Kind, length: float | Float[np.ndarray, " sample"], width: float | Float[np.ndarray, " sample"]
) -> Agent:
    """An Agent of the median size of its samples that have one, else, or if it is not positive, of that of its kind.

    A motor vehicle that is wider than long, and wider than any road allows, has the two swapped. Signs may be thin.
    """
    long, wide = _median(length), _median(width)
    if min(long, wide) <= 0.0:
        long, wide = DEFAULT_SIZES[kind]
    if kind in VEHICLE_KINDS and wide > max(long, _WIDEST_VEHICLE_M):
        long, wide = wide, long
    least = _LEAST_M if kind == "other" else 0.0
    return Agent(name, kind, max(long, least), max(wide, least))


def _median(size: float | Float[np.ndarray, " sample"]) -> float:
    """The median of the samples that have a size; 0 where none has."""
    known = np.ravel(size)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) else 0.0


def of_centre(track: Track) -> Track:
    """The track of a box's centre, given that of its front bumper."""
    pose = from_front(track.x, track.y, track.yaw, track.agent.length)
    return replace(track, x=np.asarray(pose.x), y=np.asarray(pose.y))


def with_distinct_ids(tracks: Iterable[Track]) -> tuple[Track, ...]:
    """The tracks, with a P put before the id of each pedestrian whose number is also that of a vehicle."""
    seen: set[str] = set()
    found = []
    for track in tracks:
        if track.agent.id in seen:
            track = replace(track, agent=replace(track.agent, id=f"P{track.agent.id}"))
        seen.add(track.agent.id)
        found.append(track)
    return tuple(found)


def heights_of(
    points: Float[np.ndarray, "point axis"], among: Bool[np.ndarray, " point"] | slice = slice(None)
) -> Float[np.ndarray, " point"] | None:
    """The heights of points [m]; None where they have only x and y, or one of those `among` them has no height."""
    return points[:, 2] if points.shape[1] > 2 and np.isfinite(points[among, 2]).all() else None


def dense_track(
    name: str,
    kind: Kind,
    size: tuple[float | Float[np.ndarray, " time"], float | Float[np.ndarray, " time"]],
    valid: Bool[np.ndarray, " time"],
    x: Float[np.ndarray, " time"],
    y: Float[np.ndarray, " time"],
    yaw: Float[np.ndarray, " time"],
    z: Float[np.ndarray, " time"] | None = None,
) -> Track | None:
    """The valid samples of arrays over time as a Track; None where there are none. `size`: length and width [m]."""
    step = np.flatnonzero(valid)
    if not len(step):
        return None
    length, width = (one[step] if isinstance(one, np.ndarray) else one for one in size)
    x, y, yaw = (values[step].astype(float) for values in (x, y, yaw))
    agent = agent_with_size(name, kind, length, width)
    return Track(agent, step, x, y, yaw, None if z is None else z[step].astype(float))


def with_openings(lanes: tuple[LoggedLane, ...]) -> tuple[LoggedLane, ...]:
    """The lanes without exits off the map, each marked with which of its ends lie at the end of the map."""
    known = {lane.id for lane in lanes}
    kept = [replace(lane, exits=tuple(name for name in lane.exits if name in known)) for lane in lanes]
    entered = {name for lane in kept for name in lane.exits}
    return tuple(replace(lane, open_start=lane.id not in entered, open_end=not lane.exits) for lane in kept)


def joined(lanes: Sequence[LoggedLane], work: Work) -> tuple[LoggedLane, ...]:
    """Lanes with exits by position, for logs without successors: a lane continues into those that begin at its end.

    `work` is asked for each such pair.
    """
    if not lanes:
        return ()
    starts, ends = (np.asarray(shapely.points([lane.centre[point] for lane in lanes])) for point in (0, -1))
    tree, exits = shapely.STRtree(starts), list[tuple[str, ...]]()
    for lane, end in zip(lanes, ends, strict=True):
        onward = np.sort(tree.query(end, "dwithin", _JOIN_M)).tolist()
        work.spend("lanes that begin where another ends x steps", len(onward), STEPS)
        exits.append(tuple(after.id for after in map(lanes.__getitem__, onward) if after is not lane))
    return with_openings(tuple(replace(lane, exits=names) for lane, names in zip(lanes, exits, strict=True)))
