"""Chooses which vehicle becomes the ego of which slot of a recording.

Pure: the same recordings, road and seed give the same Scenarios.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count, islice, pairwise
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from regents_cosim.cases.provenance import made_by, versions
from regents_cosim.checks.arguments import require_one_of
from regents_cosim.checks.names import file_name, word
from regents_cosim.checks.ranges import SEED, Range
from regents_cosim.errors import NoWindowError
from regents_cosim.geometry.boxes import overlap
from regents_cosim.maps.levels import contains
from regents_cosim.maps.roadmap import RoadMap
from regents_cosim.scenario.collisions import find_overlaps
from regents_cosim.scenario.scenario import Agent, LeftOut, Provenance, Reason, Scenario, Tracks
from regents_cosim.simulators import ANY_EGO
from regents_cosim.simulators.sumo.types import is_passenger_car
from regents_cosim.sources.conflicts import Conflicts, Others, Possible
from regents_cosim.sources.recording import Recording

Prefer = Literal["conflicts", "pedestrians", "none"]
EgoKind = Literal["auto", "any", "car", "truck", "bus", "motorcycle"]

_NEAR_M = 50.0  # other vehicles count as company within this distance of the ego
_MOVING_MPS = 1.0
_LEAST_WAY_M = 5.0  # least distance that the ego drives
_LONGER = 4  # factor on the number of slots in a longer search
_MOST_ASKED = 24  # vehicles per slot that are checked for conflicts
_RANGES = {
    "count": Range(1, 1_000_000, "windows wanted", whole=True),
    "seed": SEED,
    "horizon_s": Range(1.0, 3600.0, "the length of a window [s]"),
    "radius_m": Range(0.1, 1e6, "how near to the ego an agent must come [m]"),
    "max_agents": Range(2, 1000, "road users in a window, the ego included", whole=True),
    "company": Range(0, 1000, "moving vehicles near the ego", whole=True),
}


@dataclass(frozen=True)
class Windows:
    """The parameters of the choice of windows."""

    count: int = 8
    seed: int = 0
    horizon_s: float = 8.0
    radius_m: float = 100.0  # agents that never come closer to the ego are left out
    company: int = 2  # moving vehicles near the ego at the same instant
    prefer: Prefer = "conflicts"  # prefer egos with a possible conflict with anybody, or with pedestrians; or none

    ego: str = ANY_EGO  # or a vehicle, a vehicle type or a flow of SUMO
    max_agents: int = 64  # including the ego; if there are more, the nearest are kept
    ego_kind: EgoKind = "auto"  # auto: passenger cars before the rest; any; or only that kind

    def __post_init__(self) -> None:
        for name, one in _RANGES.items():
            one.check(f"`{name.removesuffix('_s').removesuffix('_m')}`", getattr(self, name))
        for name, known in (("prefer", get_args(Prefer)), ("ego_kind", get_args(EgoKind))):
            require_one_of(getattr(self, name), known, name)

    @property
    def others(self) -> Others:
        """The road users that count as conflicts for preferred egos."""
        return "pedestrians" if self.prefer == "pedestrians" else "all"

    def steps(self, dt: float) -> int:
        """The number of instants in a window, which is one more than its steps."""
        return round(self.horizon_s / dt) + 1


USUAL = Windows()


@dataclass(frozen=True)
class RecordingOrigin:
    """The origin of the recordings, for ids and provenance."""

    source: str  # "sumo", "fcd", "highway"
    file: str  # without folders
    sha256: str
    scene: str = ""  # name of the recording in a file with several

    @property
    def name(self) -> str:
        """The file's name without its endings, for names of folders."""
        if self.scene:
            return word(self.scene) or self.source
        return word(re.sub(r"(\.(gz|xml|csv|sumocfg|rou|net|fcd))+$", "", self.file)) or self.source


def draw_slots(total: int, windows: Windows, longer: bool = False) -> list[int]:
    """The slots to record out of `total` consecutive ones, spread evenly and drawn by seed.

    Reading every vehicle at every step costs as much as simulating it, so at most a third of the time is read, unless
    there are only a few slots. More is read where egos with a conflict are preferred, and four times as much (`longer`)
    where too few were found. For a named ego all slots are read, since it may occur in only one of them.
    """
    if windows.ego != ANY_EGO:
        return list(range(total))
    spare = 1.5 if windows.prefer == "none" else 3.0
    wanted = math.ceil(spare * windows.count)
    wanted = min(total, _LONGER * max(4, wanted) if longer else max(4, min(wanted, total // 3)))
    bounds = np.linspace(0, total, wanted + 1).astype(int)
    rng = np.random.default_rng(windows.seed)
    return [int(rng.integers(low, high)) for low, high in pairwise(bounds)]


def choose_windows(
    recordings: Sequence[Recording], road: RoadMap, origin: RecordingOrigin, windows: Windows
) -> list[Scenario]:
    """Up to `windows.count` Scenarios, ordered by time; every Recording is one slot of the horizon.

    Each slot gives one ego, then a second one and so on, until there are enough. An ego is a motor vehicle that

    - its Recording allows as ego,
    - is present at every instant, without a jump,
    - drives at least 5 m, at more than 1 m/s on average,
    - has, at some instant, at least `windows.company` other motor vehicles within 50 m (centre to centre) that drive
      faster than 1 m/s at that instant,
    - overlaps no other box at any instant,
    - keeps its centre on the drivable area (buses on their own lanes do not).

    Egos whose path another road user can cross or join (`conflicts`) come first, led by those that have to give way to
    it; `windows.prefer` restricts this to pedestrians or turns it off. Among equals passenger cars come first, unless
    `windows.ego_kind` says otherwise. The other road users are as recorded, gaps and jumps included. Raises
    NoWindowError with the number of vehicles that fail each rule where there is no window.
    """
    rng = np.random.default_rng(windows.seed)
    refused: Counter[str] = Counter()
    queues = {
        slot: egos(recordings[slot], road, windows, rng.permutation(len(recordings[slot].ids)), refused)
        for slot in rng.permutation(len(recordings)).tolist()
    }
    found = sorted(islice(preferred(queues, recordings, road, windows), windows.count))
    if not found:
        raise NoWindowError(why_none(recordings, refused, windows))
    taken: Counter[str] = Counter()
    return [make_scenario(recordings[slot], ego, road, origin, windows, taken) for slot, ego in found]


def preferred(
    queues: dict[int, Iterator[int]], recordings: Sequence[Recording], road: RoadMap, windows: Windows
) -> Iterator[tuple[int, int]]:
    """Slots and egos in rounds over the slots, as `prefer` says.

    First come egos that another road user with the right of way could meet, then those that any other could meet.
    """
    if windows.prefer == "none":
        yield from _cars_first(queues, recordings, windows)
        return

    some: dict[int, list[int]] = {slot: [] for slot in queues}
    rest: dict[int, list[int]] = {slot: [] for slot in queues}
    conflicts = {slot: Conflicts(recordings[slot], road) for slot in queues}
    first = {
        slot: _sifted(
            islice(queue, _MOST_ASKED),  # of a large city only the first few
            lambda ego, found=conflicts[slot]: Possible.WITH_RIGHT_OF_WAY - found.possible_for(ego, windows.others),
            some[slot],
            rest[slot],
        )
        for slot, queue in queues.items()
    }
    yield from _cars_first(first, recordings, windows)
    yield from _cars_first({slot: iter(left) for slot, left in some.items()}, recordings, windows)
    yield from _cars_first({slot: chain(left, queues[slot]) for slot, left in rest.items()}, recordings, windows)


def _sifted(queue: Iterator[int], below: Callable[[int], int], *rest: list[int]) -> Iterator[int]:
    """Yield the egos that are `below` none, and put those below k others into the k-th list of the rest."""
    for ego in queue:
        if rank := below(ego):
            rest[rank - 1].append(ego)
        else:
            yield ego


def _cars_first(
    queues: dict[int, Iterator[int]], recordings: Sequence[Recording], windows: Windows
) -> Iterator[tuple[int, int]]:
    """Slots and egos in rounds over the slots: first passenger cars, then the rest, unless a kind is asked for."""
    if windows.ego_kind != "auto":
        yield from _in_rounds(queues)
        return
    rest: dict[int, list[int]] = {slot: [] for slot in queues}
    cars = {
        slot: _sifted(queue, lambda ego, types=recordings[slot].types: not is_passenger_car(types[ego]), rest[slot])
        for slot, queue in queues.items()
    }
    yield from _in_rounds(cars)
    yield from _in_rounds({slot: iter(left) for slot, left in rest.items()})


def _in_rounds(queues: dict[int, Iterator[int]]) -> Iterator[tuple[int, int]]:
    while queues:
        for slot, queue in list(queues.items()):
            ego = next(queue, None)
            if ego is None:
                del queues[slot]
            else:
                yield slot, ego


# --- egos ---------------------------------------------------------------------------------------


def egos(
    recording: Recording, road: RoadMap, windows: Windows, order: np.ndarray, refused: Counter[str]
) -> Iterator[int]:
    """The vehicles that may be the ego, in the given order; `refused` counts the others by reason."""
    for ego in order.tolist():
        if recording.egos is not None and recording.ids[ego] not in recording.egos:
            continue
        reason = other_kind(recording, ego, windows) or refusal(recording, ego, road, windows.company)
        if reason is None:
            yield ego
        else:
            refused[reason] += 1


def other_kind(recording: Recording, ego: int, windows: Windows) -> str | None:
    """The reason why a vehicle's kind forbids it as ego; None where it is allowed."""
    if windows.ego_kind in ("auto", "any", recording.types[ego].kind):
        return None
    return f"were of another kind than `ego_kind` {windows.ego_kind}"


def stands(recording: Recording, ego: int) -> bool:
    """Whether a vehicle goes too short a way, or too slowly, to be an ego."""
    speed = recording.speed[ego]
    way = np.trapezoid(speed, dx=recording.dt)
    return bool(way < _LEAST_WAY_M or speed.mean() <= _MOVING_MPS)


def refusal(recording: Recording, ego: int, road: RoadMap, company: int) -> str | None:
    """The reason why a vehicle may not be the ego, or None; `company` is how many others must move near it."""
    if not recording.motor[ego]:
        return "were not motor vehicles"
    if not recording.valid[ego].all():
        return "were not there throughout"
    if recording.jumps_of(ego):
        return "jumped (teleported, or changed lanes at once)"
    if stands(recording, ego):
        return "stood or crept"
    apart = recording.distances(ego)
    moving = (recording.speed > _MOVING_MPS) & recording.motor[:, None]
    if ((apart <= _NEAR_M) & moving).sum(axis=0).max() < company:
        return f"had fewer than {company} moving vehicle{'s' * (company != 1)} within {_NEAR_M:.0f} m"
    if _overlaps_any(recording, ego, apart):
        return "overlapped another vehicle in the recorded traffic"
    way = np.stack([recording.x[ego], recording.y[ego]], axis=-1)
    if not contains(road, way, recording.heights[ego]).all():
        return "left the lanes for cars"
    return None


def _overlaps_any(recording: Recording, ego: int, apart: Float[np.ndarray, "vehicle time"]) -> bool:
    lengths = np.array([kind.length + kind.width for kind in recording.types])
    close = apart.min(axis=1) <= lengths + lengths[ego]  # at least the sum of both half diagonals
    hits = overlap(recording.boxes(slice(ego, ego + 1)), recording.boxes(close))
    return bool((hits & recording.valid[close]).any())


def why_none(recordings: Sequence[Recording], refused: Counter[str], windows: Windows) -> str:
    """The message where no vehicle of the recordings may be the ego; `refused` counts them by reason."""
    if windows.ego != ANY_EGO and not any(recording.egos for recording in recordings):
        return (
            f"no window found: the ego {windows.ego!r} is never on the road (expected the id of a vehicle, a vehicle "
            "type or a flow; see `begin` and `end`)"
        )
    tried = f"{len(recordings)} slot{'s' * (len(recordings) != 1)} of {windows.horizon_s:g} s"
    if not refused:
        when = f"in {tried}" if recordings else "at any time"
        return f"no window found: no vehicle was on the road {when} (expected traffic; see `begin` and the routes)"
    reasons = ", ".join(f"{number} {reason}" for reason, number in refused.most_common())
    return (
        f"no window found: of {refused.total()} candidate egos in {tried}, {reasons} "
        "(try another `begin` or --seed, a shorter `horizon`, or more traffic)"
    )


def no_cars(found: Sequence[Scenario]) -> str:
    """A message about egos that are not passenger cars; empty where all are."""
    egos = [one.ego for one in found if not is_passenger_car(one.ego)]
    if not egos:
        return ""
    which = ", ".join(dict.fromkeys(f"{ego.kind} {ego.length:.3g} m" for ego in egos))
    return (
        f"the ego is no passenger car in {len(egos)} of {len(found)} windows: {which} (`ego_kind` car takes no other)"
    )


# --- Scenarios ----------------------------------------------------------------------------------


def make_scenario(
    recording: Recording, ego: int, road: RoadMap, origin: RecordingOrigin, windows: Windows, taken: Counter[str]
) -> Scenario:
    """The Scenario of an ego and the road users that come near it; `taken` counts the names in use."""
    near, left_out = _company(recording, ego, windows)
    members = [ego, *near]
    agents = tuple(
        Agent(recording.ids[i], t.kind, t.length, t.width, "ego" if i == ego else "background")
        for i, t in ((i, recording.types[i]) for i in members)
    )
    tracks = _tracks(recording, members)
    lights = {link.signal for link in road.connections}
    return Scenario(
        id=_unique(file_name(origin.name, f"{recording.begin_s:07.1f}s", word(recording.ids[ego])), taken),
        dt=recording.dt,
        agents=agents,
        tracks=tracks,
        target=(float(tracks.x[0, -1]), float(tracks.y[0, -1])),
        road=road,
        provenance=Provenance(
            origin.source, origin.file, origin.sha256, recording.begin_s, windows.seed, versions(), made_by(), left_out
        ),
        signals=tuple(signal for signal in recording.signals if signal.id in lights),
        overlaps=find_overlaps(agents, tracks),
    )


def _company(recording: Recording, ego: int, windows: Windows) -> tuple[list[int], tuple[LeftOut, ...]]:
    """The indices of the others, increasing: those within the radius at some instant, the nearest up to the limit.

    Also returns the road users that are left out. Distances are measured from centre to centre.
    """
    least = recording.distances(ego).min(axis=1)
    by_distance = [int(i) for i in np.argsort(least, kind="stable") if i != ego]
    near = [i for i in by_distance if least[i] <= windows.radius_m]
    kept, beyond = near[: windows.max_agents - 1], near[windows.max_agents - 1 :]
    left_out: list[LeftOut] = list(recording.left_out)
    if away := len(by_distance) - len(near):
        left_out.append(LeftOut("radius", away, detail=f"never within {windows.radius_m:g} m of the ego"))
    if beyond:
        ids = tuple(sorted(recording.ids[i] for i in beyond))
        left_out.append(LeftOut("limit", len(ids), ids, f"the nearest comes to {least[beyond[0]]:.0f} m from the ego"))
    if recording.riders:
        riders = tuple(sorted(recording.riders))
        left_out.append(LeftOut("rider", len(riders), riders, "while they have no place of their own on the road"))
    return sorted(kept), (*left_out, *_of_members(recording, [ego, *kept]))


def _of_members(recording: Recording, members: list[int]) -> Iterator[LeftOut]:
    """Entries for members of a window whose motion is incomplete or partly assumed."""
    here = {recording.ids[i] for i in members}
    lost = recording.jumped - (set(recording.ids) - here)
    lapses = {recording.ids[i] for i in members if (np.diff(np.flatnonzero(recording.valid[i])) > 1).any()}
    found: list[tuple[Reason, set[str] | frozenset[str], str]] = [
        ("jump", lost, "instants at which the log lets them jump"),
        ("gap", lapses - lost, "instants between others"),
        ("guessed", recording.guessed & here, "they never move, and on no lane"),
    ]
    for reason, names, why in found:
        if names:
            yield LeftOut(reason, len(names), tuple(sorted(names)), why)


def _tracks(recording: Recording, members: list[int]) -> Tracks:
    valid = recording.valid[members]
    x, y, yaw, speed, z = (
        np.where(valid, values[members], 0.0)
        for values in (recording.x, recording.y, recording.yaw, recording.speed, recording.heights)
    )
    return Tracks(x, y, yaw, speed, valid, z=z)


def _unique(name: str, taken: Counter[str]) -> str:
    """The name, or the first one with a number behind it that is free; it is taken from now on."""
    every = chain([name], (file_name(name, str(number)) for number in count(max(taken[name] + 1, 2))))
    free = next(one for one in every if not taken[one])
    taken.update({name, free})
    return free
