"""Choose the lessons of a training: balanced over what vehicles do, and from states beside the log.

Imitation of the log alone drifts: an ego that leaves its log has never seen what to do there. So every lesson starts
from a perturbed state, and states that the network itself drove into are added (DAgger, Ross et al. 2011).

Crashes that a careful driver avoids make lessons of their own kind: only their ego is taught, on that driver's drive.
Its lessons before the evasion are ordinary ones, since there is nothing to brake for yet.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from regents_cosim.errors import ScenarioError
from regents_cosim.geometry.frames import ahead_and_left, wrap
from regents_cosim.geometry.lines import distances_along
from regents_cosim.mirror.bicycle import Motion
from regents_cosim.norms.limits import ALONG_RAD
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS
from regents_cosim.planners.idm import to_stop_lines
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.training.lessons.classroom import Classroom, Lesson

EVADING = "evading"
_HELD, _FREE = "held", "free"  # a closed, or an open, light of the own way in view
# the first kind that holds counts
KINDS = (EVADING, _HELD, _FREE, "stopping", "merging", "turning", "following", "cruising")
_AHEAD_STEPS = 30  # how far the log is looked ahead to tell what a vehicle does
_TURN_RAD = np.deg2rad(15.0)
_ASIDE_M = 1.2  # to the side while hardly turning: a lane change
_HARDLY_RAD = np.deg2rad(10.0)
_STOP_M_S = 1.0
_LEADER_M = 22.0
_BESIDE_M = 1.5
_SEEN_M = 60.0  # around a window's ego: within this distance its neighbours are in the window too
_PERTURBED = 0.75  # share of the lessons
_LATE = 0.35  # share of those that start where the log would be if it had kept its speed ...
_LATE_STEPS = 20  # ... for up to 2 s,
_LATE_M = 7.0  # ... or up to this distance
_FURTHER_M = 12.0  # greatest displacement along its log of an ego at a random place
_PACE, _PACE_M_S = (0.5, 1.5), 1.5  # its speed as a share of the logged one, plus noise
_OVER_S = 1.0  # after the crash: the avoiding drive has then avoided it


@dataclass(frozen=True, eq=False)
class Curriculum:
    """Lessons by kind, as rows (scene, agent, step)."""

    rows: dict[str, Int[np.ndarray, "lesson 3"]]
    last: Int[np.ndarray, "scene agent"]
    log: tuple[Float[np.ndarray, "scene agent time"], ...]  # x, y [m], yaw [rad], speed [m/s]
    valid: Bool[np.ndarray, "scene agent time"]
    targets: Float[np.ndarray, "scene 2"]  # [m] of the egos
    evasions: Mapping[int, range]  # the steps at which the ego evades, by scene
    egos: bool  # whether only egos are taught
    dt: float  # [s]

    def draw(self, count: int, rng: np.random.Generator, evading: float = 0.0) -> Lesson:
        """Draw `count` lessons from perturbed states: a share `evading` of that kind, equal shares of the others."""
        kinds = rng.choice(KINDS, count, p=self._shares(evading))
        rows = np.array([self.rows[kind][rng.integers(len(self.rows[kind]))] for kind in kinds])
        late = rng.random(count) < _LATE
        states = self.states(rows)
        states[late] = [self._too_late(row, rng) for row in rows[late]]
        return self.lessons(rows, _perturbed(states, rng), rng)

    def lessons(self, rows: Int[np.ndarray, "lesson 3"], states: np.ndarray, rng: np.random.Generator) -> Lesson:
        """Lessons from given states (x, y, yaw, speed), each with a target: the end of the log, or a step before it.

        An ego that evades keeps its former target, as the end of its evasion would give it away. Where only egos are
        taught, all keep their targets, as they may get further than their log.
        """
        scene, agent, step = rows.T
        last = self.last[scene, agent]
        soonest = np.minimum(step + WAYPOINTS, last)
        goal = np.where(rng.random(len(rows)) < 0.5, last, rng.integers(soonest, last + 1))
        logged = np.stack([values[scene, agent, goal] for values in self.log[:2]], axis=-1)
        kept = self.egos | np.isin(scene, list(self.evasions))
        goal = jnp.asarray(np.where(kept[:, None], self.targets[scene], logged), jnp.float32)
        scene, agent, step = (jnp.asarray(values, jnp.int32) for values in (scene, agent, step))
        x, y, yaw, speed = (jnp.asarray(values, jnp.float32) for values in states.T)
        return Lesson(scene, agent, step, goal, Motion(x, y, yaw, speed))

    def split(self, window: Int[np.ndarray, " scene"]) -> tuple["Curriculum", "Curriculum"]:
        """Split the lessons into those to teach, and those of every tenth window, which are held back.

        Scenes that are the same `window` with other lights are on the same side.
        """
        back = {kind: window[rows[:, 0]] % 10 == 9 for kind, rows in self.rows.items()}
        taught = {kind: rows[~back[kind]] for kind, rows in self.rows.items()}
        held_back = {kind: rows[back[kind]] for kind, rows in self.rows.items()}
        if not all(len(rows) for rows in held_back.values()):
            held_back = {kind: held_back[kind] if len(held_back[kind]) else taught[kind] for kind in KINDS}
        return replace(self, rows=taught), replace(self, rows=held_back)

    def worth_teaching(self, rows: Int[np.ndarray, "lesson 3"]) -> Bool[np.ndarray, " lesson"]:
        """Whether each state of a drive has a teacher; where an ego evades, only those up to the end of the evasion."""
        over = {scene: steps.stop for scene, steps in self.evasions.items()}
        return np.array([step < over.get(scene, step + 1) for scene, _, step in rows.tolist()], bool)

    def _shares(self, evading: float) -> Float[np.ndarray, " kind"]:
        there = np.array([len(self.rows[kind]) > 0 for kind in KINDS])
        evades = np.array([kind == EVADING for kind in KINDS])
        ordinary = there & ~evades
        shares = np.where(evades & there, evading, (1.0 - evading) * ordinary / max(ordinary.sum(), 1))
        return shares / shares.sum()

    def _too_late(self, row: Int[np.ndarray, " 3"], rng: np.random.Generator) -> Float[np.ndarray, " 4"]:
        """The state (x, y, yaw, speed) of an ego that kept its speed for some time while its log did not.

        Without such lessons, the network brakes too little for what comes into view late.
        """
        scene, agent, step = row.tolist()
        x, y, _, speed = self._driven(scene, agent)
        before = max(step - rng.integers(1, _LATE_STEPS + 1), int(np.argmax(self.valid[scene, agent])))
        along = distances_along(x, y).astype(float)
        reached = along[before] + speed[before] * (step - before) * self.dt
        reached = np.clip(reached, along[step] - _LATE_M, along[step] + _LATE_M)
        return np.array([*self._at(scene, agent, along, reached)[:3], speed[before]])

    def anywhere(
        self, count: int, rng: np.random.Generator
    ) -> tuple[Int[np.ndarray, "lesson 3"], Float[np.ndarray, "lesson 4"]]:
        """Rows and states (x, y, yaw, speed) of egos far off their logs: ahead or behind, faster or slower.

        The others drive as recorded, so that the ego meets agents that it has missed in its log.
        """
        rows = np.concatenate(list(self.rows.values()))
        rows = rows[rows[:, 1] == 0]
        rows = rows[rng.integers(len(rows), size=count)]
        return rows, _perturbed(np.array([self._further(row, rng) for row in rows]), rng)

    def _further(self, row: Int[np.ndarray, " 3"], rng: np.random.Generator) -> Float[np.ndarray, " 4"]:
        scene, agent, step = row.tolist()
        along = distances_along(*self._driven(scene, agent)[:2]).astype(float)
        reached = float(along[min(step, len(along) - 1)]) + rng.uniform(-_FURTHER_M, _FURTHER_M)
        x, y, yaw, speed = self._at(scene, agent, along, reached)
        return np.array([x, y, yaw, max(speed * rng.uniform(*_PACE) + rng.normal(0.0, _PACE_M_S), 0.0)])

    def _driven(self, scene: int, agent: int) -> tuple[Float[np.ndarray, " time"], ...]:
        return tuple(values[scene, agent, : self.last[scene, agent] + 1] for values in self.log)

    def _at(self, scene: int, agent: int, along: Float[np.ndarray, " time"], reached: float) -> Float[np.ndarray, " 4"]:
        """The state (x, y, yaw, speed) at a distance [m] along a log, which is extended straight at both ends."""
        x, y, yaw, speed = self._driven(scene, agent)
        near = min(int(np.searchsorted(along, reached)), len(x) - 1)
        further = reached - along[near]
        return np.array(
            [x[near] + further * np.cos(yaw[near]), y[near] + further * np.sin(yaw[near]), yaw[near], speed[near]]
        )

    def states(self, rows: Int[np.ndarray, "lesson 3"]) -> Float[np.ndarray, "lesson 4"]:
        """The logged states (x, y, yaw, speed)."""
        return np.stack([values[tuple(rows.T)] for values in self.log], axis=-1)


def plan(room: Classroom, evasions: Mapping[int, range] = MappingProxyType({}), egos: bool = False) -> Curriculum:
    """All lessons in `room`: vehicles near the window's ego that stay for the next 0.8 s; with `egos` only the ego.

    In the scenes of `evasions` only the ego is taught, up to the end of its evasion, as the others drive there as an
    attack wants.
    """
    log = tuple(np.asarray(values) for values in (room.log.x, room.log.y, room.log.yaw, room.log.speed))
    valid, half_width = np.asarray(room.valid), np.asarray(room.half_width)
    lights = _at_lights(room)
    found: dict[str, list[np.ndarray]] = {kind: [] for kind in KINDS}
    for scene in range(len(valid)):
        taught = _usable(log, valid, half_width, scene)
        x, y, yaw, speed = (values[scene] for values in log)
        evades = _of_ego(np.isin(np.arange(valid.shape[2]), evasions.get(scene, range(0))), valid[scene])
        kinds = _kinds(x, y, yaw, speed, valid[scene]) | {EVADING: evades}
        kinds |= {kind: _of_ego(when[scene], evades) for kind, when in lights.items()}
        if scene in evasions:
            taught[1:], taught[0, evasions[scene].stop :] = False, False
        if egos:
            taught[1:] = False
        for kind in KINDS:
            found[kind].append(np.insert(np.argwhere(taught & kinds[kind]), 0, scene, axis=1))
            taught &= ~kinds[kind]
    rows = {kind: np.concatenate(lessons) for kind, lessons in found.items()}
    return Curriculum(rows, np.asarray(room.last), log, valid, np.asarray(room.target), evasions, egos, room.dt)


def evading_steps(crash: Scenario) -> range:
    """The steps at which the careful driver evades `crash`.

    Once the danger is over, an ego that stands on a free road teaches nothing. Raises ScenarioError where the crash has
    no evasion.
    """
    begins, hit = crash.evades_from, crash.collision
    if begins is None or hit is None:
        raise ScenarioError(f"case {crash.id} has no evasion, expected a collision that a careful driver avoids")
    return range(begins, hit.step + round(_OVER_S / crash.dt))


def _usable(log: tuple[np.ndarray, ...], valid: np.ndarray, half_width: np.ndarray, scene: int) -> np.ndarray:
    x, y, _, speed = (values[scene] for values in log)
    stays = np.zeros_like(valid[scene])
    stays[:, :-WAYPOINTS] = valid[scene][:, :-WAYPOINTS] & valid[scene][:, WAYPOINTS:]
    near = np.hypot(x - x[0], y - y[0]) < _SEEN_M
    moves = (speed * valid[scene]).sum(axis=1, keepdims=True) > 10.0  # a metre in all
    return stays & near & moves & (half_width[scene][:, None] > 0.5)


def _at_lights(room: Classroom) -> dict[str, Bool[np.ndarray, "scene time"]]:
    """When the next light of an ego's way is in view, closed and open separately; never where logs follow no route.

    Few steps of a drive have a light in view, so they are a kind of their own; otherwise braking at red would drown.
    """
    if room.way is None:
        never = np.zeros(room.valid.shape[::2], bool)
        return {_HELD: never, _FREE: never}
    route = room.way.route
    gap = np.asarray(jax.vmap(jax.vmap(to_stop_lines, (None, 0, 0)))(route, room.log.x[:, 0], room.log.y[:, 0]))
    gap = np.where((gap > 0.0) & (gap < room.camera.view_m), gap, np.inf)
    closed = np.take_along_axis(np.asarray(route.closed), gap.argmin(axis=-1)[..., None], axis=-1)[..., 0]
    seen = np.isfinite(gap).any(axis=-1) & np.asarray(room.valid[:, 0])
    return {_HELD: seen & closed, _FREE: seen & ~closed}


def _of_ego(when: Bool[np.ndarray, " time"], like: np.ndarray) -> Bool[np.ndarray, "agent time"]:
    found = np.zeros_like(like)
    found[0] = when
    return found


def _kinds(
    x: Float[np.ndarray, "agent time"],
    y: Float[np.ndarray, "agent time"],
    yaw: Float[np.ndarray, "agent time"],
    speed: Float[np.ndarray, "agent time"],
    valid: Bool[np.ndarray, "agent time"],
) -> dict[str, Bool[np.ndarray, "agent time"]]:
    """The actions of each vehicle at each step, from its next three seconds."""
    later = np.minimum(np.arange(x.shape[1]) + _AHEAD_STEPS, x.shape[1] - 1)
    turn = np.abs(wrap(yaw[:, later] - yaw))
    _, aside = ahead_and_left(np, x[:, later] - x, y[:, later] - y, yaw)
    return {
        "stopping": (speed[:, later] < _STOP_M_S) & (speed > 0.1) | (speed < _STOP_M_S),
        "merging": (np.abs(aside) > _ASIDE_M) & (turn < _HARDLY_RAD),
        "turning": turn > _TURN_RAD,
        "following": _follows(x, y, yaw, valid),
        "cruising": np.ones_like(valid),
    }


def _follows(x: np.ndarray, y: np.ndarray, yaw: np.ndarray, valid: np.ndarray) -> Bool[np.ndarray, "agent time"]:
    """Whether another vehicle drives close ahead in the same direction."""
    found = np.zeros_like(valid)
    for other in range(len(x)):
        ahead, left = ahead_and_left(np, x[other] - x, y[other] - y, yaw)
        same = np.abs(wrap(yaw[other] - yaw)) < ALONG_RAD
        found |= valid[other] & same & (ahead > 1.0) & (ahead < _LEADER_M) & (np.abs(left) < _BESIDE_M)
    return found


def _perturbed(states: Float[np.ndarray, "lesson 4"], rng: np.random.Generator) -> Float[np.ndarray, "lesson 4"]:
    """States, most of them moved off their log: along it, sideways, in heading and in speed."""
    count = len(states)
    on = rng.random(count) < _PERTURBED
    x, y, yaw, speed = states.T
    along = on * np.clip(rng.normal(0.0, 1.0, count), -2.0, 2.0) * np.minimum(speed / 5.0, 1.0)
    aside = on * np.clip(rng.normal(0.0, 0.4, count), -1.2, 1.2)
    turned = on * np.clip(rng.normal(0.0, 0.1, count), -0.35, 0.35)
    faster = on * rng.normal(0.0, 1.0, count) * (0.6 + 0.1 * speed)
    return np.stack(
        [
            x + along * np.cos(yaw) - aside * np.sin(yaw),
            y + along * np.sin(yaw) + aside * np.cos(yaw),
            yaw + turned,
            np.maximum(speed + faster, 0.0),
        ],
        axis=-1,
    )
