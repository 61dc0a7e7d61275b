"""Scenario: one traffic scene over a horizon, the value that all stages exchange.

It is frozen, and validated at construction. Frame: the map's own (x east, y north, metres); positions are box centres,
yaw is in radians counter-clockwise from +x, heights are those of the road. Entries where `valid` is False are 0.
"""

import bisect
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from jaxtyping import Bool, Float

from regents_cosim.checks.names import require_file_name, require_id
from regents_cosim.errors import require
from regents_cosim.geometry.boxes import Boxes
from regents_cosim.maps.levels import Heights
from regents_cosim.maps.roadmap import MOST_COORDINATE_M, RoadMap
from regents_cosim.scenario.attack_record import AttackRecord, Collision, Dynamics
from regents_cosim.scenario.judgement import Judgement
from regents_cosim.scenario.road_users import VEHICLE_KINDS as VEHICLE_KINDS
from regents_cosim.scenario.road_users import Kind as Kind
from regents_cosim.short_repr import html_table
from regents_cosim.system.data_frames import Tabular

if TYPE_CHECKING:
    from PIL.Image import Image

Role = Literal["ego", "background", "adversary"]

MOST_EXTENT_M = 100e3  # the largest extent of a scene: twenty minutes at 300 km/h
MOST_SIZE_M = 2e3  # the largest size of a road user: no train is longer
_DT_S = (1e-4, 100.0)
# Greatest magnitudes. No speed on Earth is greater; the bounds of controls allow the finest fit to a track that jumps.
MOST = {
    "x": MOST_COORDINATE_M,
    "y": MOST_COORDINATE_M,
    "z": 1e5,
    "yaw": 1e6,
    "speed": 1e5,
    "accel": 1e9,
    "curvature": 1e9,
}


@dataclass(frozen=True)
class Agent:
    """One road user."""

    id: str
    kind: Kind
    length: float  # [m]
    width: float  # [m]
    role: Role = "background"

    def __post_init__(self) -> None:
        require_id(self.id, "agent id")
        for name in ("length", "width"):
            size = getattr(self, name)
            require(
                bool(np.isfinite(size)) and 0 < size <= MOST_SIZE_M,
                f"agent {self.id}: {name} {size} m, expected a positive number, at most {MOST_SIZE_M:g}",
            )


@dataclass(frozen=True, eq=False)
class Tracks:
    """The motion of all agents, in the order of `Scenario.agents`.

    `accel` and `curvature` are constant from step k to k + 1; both are None where only the motion was observed. `z` is
    0 everywhere unless given, as on a flat map.
    """

    x: Float[np.ndarray, "agent time"]  # [m]
    y: Float[np.ndarray, "agent time"]  # [m]
    yaw: Float[np.ndarray, "agent time"]  # [rad]
    speed: Float[np.ndarray, "agent time"]  # [m/s] never negative
    valid: Bool[np.ndarray, "agent time"]
    accel: Float[np.ndarray, "agent time-1"] | None = None  # [m/s^2]
    curvature: Float[np.ndarray, "agent time-1"] | None = None  # [1/m] positive turns left
    z: Float[np.ndarray, "agent time"] = None  # pyright: ignore  # [m] of the road under the agent

    def __post_init__(self) -> None:
        if self.z is None:
            object.__setattr__(self, "z", np.zeros(np.shape(self.x)))
        for name in (f.name for f in fields(self)):
            self._freeze(name)
        require(self.x.ndim == 2, f"tracks of {self.x.ndim} axes, expected [agent, time]")
        agents, steps = self.x.shape
        for name in (f.name for f in fields(self)):
            self._check(name, (agents, steps - 1 if name in ("accel", "curvature") else steps))
        require(bool((self.speed >= 0).all()), "tracks: a speed is negative, expected 0 or more [m/s]")
        require((self.accel is None) == (self.curvature is None), "tracks: accel and curvature come together")

    def _freeze(self, name: str) -> None:
        value = getattr(self, name)
        if value is not None:
            array = np.array(value, bool if name == "valid" else np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def _check(self, name: str, shape: tuple[int, int]) -> None:
        value = getattr(self, name)
        if value is None:
            return
        require(
            value.shape == shape,
            f"tracks: {name} has shape {list(value.shape)}, expected {list(shape)} [agent, time]",
        )
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            require(False, f"tracks: {name} is not finite at agent {bad[0][0]}, step {bad[0][1]}")
        most = MOST.get(name, np.inf)
        far = np.argwhere(np.abs(value) > most)
        if len(far):
            agent, step = far[0].tolist()
            require(
                False,
                f"tracks: {name} is {value[agent, step]:g} at agent {agent}, step {step}, expected at most {most:g} "
                "from 0 (look for a mistake in its unit)",
            )

    @property
    def flat(self) -> bool:
        """Whether all agents are at height 0, as on every map without heights."""
        return not self.z.any()

    def __repr__(self) -> str:
        return f"Tracks({len(self.x)} agents, {self.steps} steps)"

    @property
    def steps(self) -> int:
        """Number of instants, one more than the number of controls."""
        return self.x.shape[1]


RED = "ru"  # letters of a Signal that mean stop: red, and red with yellow


@dataclass(frozen=True)
class Signal:
    """One traffic light: the letters that it shows, and from which step on.

    Letters are SUMO's: r red, y yellow, g/G green, u red-yellow, s stop, o/O off. There is one letter per controlled
    link, so a Connection names a light by (signal id, link index).
    """

    id: str
    changes: tuple[tuple[int, str], ...]  # (step, letters), first at step 0

    def __post_init__(self) -> None:
        require_id(self.id, "signal id")
        steps = [step for step, _ in self.changes]
        require(
            bool(steps) and steps[0] == 0 and all(a < b for a, b in itertools.pairwise(steps)),
            f"signal {self.id}: changes at steps {steps[:5]}, expected increasing steps from 0",
        )
        require(
            len({len(letters) for _, letters in self.changes}) == 1,
            f"signal {self.id}: changes show different numbers of lights",
        )

    @classmethod
    def of(cls, name: str, letters: Sequence[str]) -> "Signal":
        """The light that shows these letters, one entry for each step."""
        before = [None, *letters]
        return cls(name, tuple((step, now) for step, now in enumerate(letters) if now != before[step]))

    def phases(self, steps: int) -> list[tuple[int, str]]:
        """The phases among the first `steps` in order, each as (number of steps, letters)."""
        begins = [(step, letters) for step, letters in self.changes if step < steps]
        ends = [*(step for step, _ in begins[1:]), steps]
        return [(end - begin, letters) for (begin, letters), end in zip(begins, ends, strict=True)]

    def letters(self, step: int) -> str:
        """The letters that the light shows at `step`."""
        return self.changes[bisect.bisect_right(self.changes, step, key=lambda change: change[0]) - 1][1]


@dataclass(frozen=True)
class Overlap:
    """Two agents whose boxes overlap in the recorded traffic."""

    agents: tuple[str, str]
    first_step: int
    last_step: int


# Why a scenario lacks a road user of the source, or shows it changed.
Reason = Literal["radius", "limit", "rider", "unlogged", "jump", "gap", "level", "guessed", "unsupported"]


@dataclass(frozen=True)
class LeftOut:
    """Road users of the source that a scenario leaves out, in whole or in part, for one reason."""

    reason: Reason
    count: int
    ids: tuple[str, ...] = ()  # empty where they are many and of no concern, such as those outside the radius
    detail: str = ""


@dataclass(frozen=True)
class Provenance:
    """The source of a Scenario: enough to make it again, and what the Scenario lacks of it."""

    source: str  # "sumo", "fcd", ...
    file: str  # file name of the configuration or log
    sha256: str  # hash of that file
    begin_s: float  # time of step 0 in the source [s]
    seed: int = 0
    versions: dict[str, str] = field(default_factory=dict)
    command: str = ""
    left_out: tuple[LeftOut, ...] = ()

    @property
    def guessed(self) -> frozenset[str]:
        """The ids of agents whose heading is a guess."""
        return frozenset(name for one in self.left_out if one.reason == "guessed" for name in one.ids)


@dataclass(frozen=True, eq=False)
class Scenario(Tabular):
    """One traffic scene: map, agents, signals, tracks and target; s = (g, v, w, q) of ReGentS, section 3.1.

    Everything is in the map's frame: x east, y north. Raises RegentsError for parts that do not fit together.
    """

    id: str
    dt: float  # [s] length of a step
    agents: tuple[Agent, ...]  # the ego first, then by increasing id
    tracks: Tracks  # the motion, in an attacked scenario with the attack
    target: tuple[float, float]  # [m] where the ego should arrive
    road: RoadMap
    provenance: Provenance  # where the scene comes from
    signals: tuple[Signal, ...] = ()
    overlaps: tuple[Overlap, ...] = ()  # agents that overlap in the recorded traffic
    attack: AttackRecord | None = None  # None before an attack
    log: Tracks | None = None  # the recorded motion, if an attack changed `tracks`
    judgement: Judgement | None = None  # of the crash, if there is one that was judged
    evasion: Tracks | None = None  # [1, time] the careful driver's drive, if that avoids the crash

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self  # nothing in it changes, and a search copies the environment that holds it at every node

    def __post_init__(self) -> None:
        require_file_name(self.id, "case id")
        require(_DT_S[0] <= self.dt <= _DT_S[1], f"dt is {self.dt} s, expected {_DT_S[0]:g} to {_DT_S[1]:g} seconds")
        require(bool(np.isfinite(self.target).all()), f"target {self.target} is not finite")
        require(
            max(map(abs, self.target)) <= MOST_COORDINATE_M,
            f"target {self.target} is further than {MOST_COORDINATE_M:g} m from 0",
        )
        self._check_agents()
        for tracks in filter(None, (self.tracks, self.log)):
            self._check_tracks(tracks)
        require(
            (self.attack is None) == (self.log is None),
            "an attacked scenario keeps its log, and only an attacked one",
        )
        self._check_collision()
        self._check_evasion()

    def _check_agents(self) -> None:
        roles = [agent.role for agent in self.agents]
        require(
            roles[:1] == ["ego"] and roles.count("ego") == 1,
            f"agents have roles {roles[:4]}, expected the ego first and only once",
        )
        others = [agent.id for agent in self.agents[1:]]
        for before, after in itertools.pairwise(others):
            require(before < after, f"agent ids {before!r}, {after!r}: expected increasing ids after the ego's")
        require(self.agents[0].id not in others, f"agent id {self.agents[0].id!r} occurs twice")

    def _check_tracks(self, tracks: Tracks) -> None:
        require(
            len(tracks.x) == len(self.agents),
            f"tracks of {len(tracks.x)} agents, expected {len(self.agents)} as listed",
        )
        require(tracks.steps >= 2, f"{tracks.steps} steps, expected at least 2")
        for name in ("x", "y"):
            placed = getattr(tracks, name)[tracks.valid]
            extent_m = float(np.ptp(placed)) if placed.size else 0.0
            require(
                extent_m <= MOST_EXTENT_M,
                f"tracks are spread over {extent_m / 1e3:.4g} km in {name}, expected at most "
                f"{MOST_EXTENT_M / 1e3:g} km (look for a position that is a mistake)",
            )
        missing = np.flatnonzero(~tracks.valid[0])
        if len(missing):
            require(False, f"ego {self.agents[0].id!r} is absent at step {missing[0]}, expected throughout")

    def _check_collision(self) -> None:
        hit = self.collision
        if hit is None:
            return
        require(
            any(agent.id == hit.agent for agent in self.agents[1:]),
            f"the collision is with {hit.agent!r}, expected one of the road users besides the ego",
        )
        require(
            0 <= hit.step < self.tracks.steps,
            f"the collision is at step {hit.step}, expected 0 to {self.tracks.steps - 1}, as the tracks have",
        )

    def _check_evasion(self) -> None:
        evasion = self.evasion
        if evasion is None:
            return
        require(
            self.judgement is not None and self.judgement.evades_s is not None,
            "only a collision that the careful driver avoids has an evasion, which is that driver's drive",
        )
        require(
            evasion.x.shape == (1, self.tracks.steps),
            f"evasion of shape {list(evasion.x.shape)}, expected the ego alone: [1, {self.tracks.steps}]",
        )
        require(bool(evasion.valid.all()), "the ego's evasion has gaps, expected it throughout")

    def __repr__(self) -> str:
        return f"Scenario({', '.join(f'{name}={value!r}' for name, value in self.summary().items())})"

    def _repr_html_(self) -> str:
        return html_table([self.summary()], upright=True)

    def plot(self) -> "Image":
        """A picture of the collision, or of the end where there is none; notebooks show it, `.save(NAME)` writes it."""
        from regents_cosim.reports.picture import still_image

        return still_image(self)

    def to_dict(self) -> list[dict[str, object]]:
        """One row per agent and instant, with the columns of `regents export --to csv`, as `to_frame()` has."""
        from regents_cosim.exports.table import track_rows

        return track_rows(self)

    def summary(self) -> dict[str, object]:
        """The main facts of the scenario, by name."""
        found: dict[str, object] = {
            "id": self.id,
            "agents": len(self.agents),
            "seconds": round((self.tracks.steps - 1) * self.dt, 3),
            "ego": self.ego.id,
        }
        if self.attack is not None:
            found |= {"method": self.attack.method, "planner": self.attack.planner, "outcome": self.attack.outcome}
        if self.attack is not None and self.attack.collision is not None:
            found["adversary"] = self.attack.collision.agent
        if self.judgement is not None:
            found |= {"telling": self.judgement.telling, "flawless": self.judgement.flawless}
        return found

    @property
    def ego(self) -> Agent:
        """The agent that the planner drives."""
        return self.agents[0]

    def index(self, agent: str) -> int:
        """The row of a road user in the tracks, by its id. Raises ValueError for an unknown one."""
        return [one.id for one in self.agents].index(agent)

    @property
    def adversary(self) -> int | None:
        """The row of the road user in the role of the adversary; None without one."""
        return next((row for row, one in enumerate(self.agents) if one.role == "adversary"), None)

    @property
    def collision(self) -> Collision | None:
        """The collision that the record of the attack has, however the attack ended; None without one."""
        return self.attack.collision if self.attack else None

    @property
    def crash(self) -> Collision | None:
        """The collision in which the attack ended; None without one."""
        return self.attack.crash if self.attack else None

    def shows(self, signal: str | None, link: int, step: int) -> str:
        """The letter that a light shows for one of its links at `step`; "-" where it has none, or none is recorded."""
        light = next((one for one in self.signals if one.id == signal), None)
        letters = "" if light is None else light.letters(step)
        return letters[link] if link < len(letters) else "-"

    @property
    def recorded_tracks(self) -> Tracks:
        """The motion as it was recorded: the log of an attacked scenario, the tracks of any other."""
        return self.tracks if self.log is None else self.log

    @cached_property
    def boxes(self) -> Boxes:
        """Boxes of all agents at all steps, [agent, time]."""
        return boxes_of(self.agents, self.tracks)

    @cached_property
    def heights(self) -> Heights:
        """The height of the road under each agent, at any place."""
        way = self.recorded_tracks
        return Heights(self.road, way.x, way.y, way.z, way.valid)

    def with_heights(self, tracks: Tracks) -> Tracks:
        """`tracks` of the same agents with the heights of the road under them, as they may have moved elsewhere."""
        if self.heights.flat:
            return tracks
        return replace(tracks, z=np.where(tracks.valid, self.heights(tracks.x, tracks.y), 0.0))

    @property
    def dynamics(self) -> Dynamics:
        """The vehicle model of the controls: the attack's, or highway-env's where that simulator made the tracks."""
        if self.attack is not None:
            return self.attack.dynamics or "bicycle"
        return "highway" if self.provenance.source == "highway" else "bicycle"

    def before_attack(self) -> "Scenario":
        """The scenario as it was recorded, without the attack."""
        if self.log is None:
            return self
        agents = tuple(replace(a, role="ego" if i == 0 else "background") for i, a in enumerate(self.agents))
        return replace(self, agents=agents, tracks=self.log, attack=None, log=None, judgement=None, evasion=None)

    @property
    def evades_from(self) -> int | None:
        """The step at which the evasion leaves the ego's own drive; None where there is no evasion."""
        evades_s = self.judgement.evades_s if self.judgement else None
        return None if self.evasion is None or evades_s is None else int(evades_s / self.dt + 1e-6)

    def keeping(self, kept: Bool[np.ndarray, " agent"]) -> "Scenario":
        """The scenario with the `kept` agents only; its verdicts are dropped."""
        agents = tuple(agent for agent, stays in zip(self.agents, kept, strict=True) if stays)
        names, record = {agent.id for agent in agents}, self.attack
        return replace(
            self,
            agents=agents,
            tracks=_rows(self.tracks, kept),
            log=self.log and _rows(self.log, kept),
            overlaps=tuple(pair for pair in self.overlaps if names.issuperset(pair.agents)),
            attack=record and replace(record, candidates=tuple(name for name in record.candidates if name in names)),
            judgement=None,
            evasion=None,
        )


def _rows(tracks: Tracks, kept: Bool[np.ndarray, " agent"] | slice) -> Tracks:
    given = {item.name: getattr(tracks, item.name) for item in fields(tracks)}
    return Tracks(**{name: values[kept] for name, values in given.items() if values is not None})


def with_rows(tracks: Tracks, other: Tracks, chosen: Bool[np.ndarray, " agent"]) -> Tracks:
    """The `tracks` with the motion of the `chosen` rows of `other`; their controls are dropped."""
    names = ("x", "y", "yaw", "speed", "valid", "z")
    return Tracks(**{name: np.where(chosen[:, None], getattr(other, name), getattr(tracks, name)) for name in names})


def boxes_of(agents: tuple[Agent, ...], tracks: Tracks) -> Boxes:
    """Boxes of `agents` along `tracks`, [agent, time]."""
    length = np.array([agent.length for agent in agents])[:, None]
    width = np.array([agent.width for agent in agents])[:, None]
    return Boxes(tracks.x, tracks.y, tracks.yaw, length, width, tracks.z)
