"""Closed-loop drives of a network in training: the states that it reaches by itself, and how well it drives."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from regents_cosim.mirror.bicycle import Motion, clip, step
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.separation import Box, overlaps
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS
from regents_cosim.planners.aim_bev.controller import steer
from regents_cosim.training.lessons.classroom import Classroom, Lesson

LOST_M = 8.0  # an ego further from its log has nothing to learn from it
_EVERY = 3  # steps from one state that is a lesson to the next

# From views [batch 192 192 3], speeds [batch], targets [batch 2], closed lights [batch] to waypoints [batch 8 2].
Predict = Callable[[Array, Array, Array, Array], np.ndarray]


@dataclass(frozen=True, eq=False)
class ReachedStates:
    """States by scene, agent and step."""

    rows: Int[np.ndarray, "lesson 3"]
    states: Float[np.ndarray, "lesson 4"]  # x, y [m], yaw [rad], speed [m/s]

    @classmethod
    def nothing(cls) -> "ReachedStates":
        """An empty set of states."""
        return cls(np.zeros((0, 3), int), np.zeros((0, 4)))

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, chosen: np.ndarray) -> "ReachedStates":
        return ReachedStates(self.rows[chosen], self.states[chosen])

    def __add__(self, more: "ReachedStates") -> "ReachedStates":
        return ReachedStates(np.concatenate([self.rows, more.rows]), np.concatenate([self.states, more.states]))

    def balanced(self, danger: Bool[np.ndarray, " lesson"], rng: np.random.Generator) -> "ReachedStates":
        """The states in `danger`, and equally many others."""
        others = rng.permutation(np.flatnonzero(~danger))[: int(danger.sum())]
        return self[np.concatenate([np.flatnonzero(danger), others])]

    def drawn_into(self, own: "ReachedStates", share: float, rng: np.random.Generator) -> "ReachedStates":
        """The lessons `own` with a `share` of them replaced by states of this set, if it has any."""
        if not len(self) or not share:
            return own
        those = rng.random(len(own)) < share
        drawn = self[rng.integers(len(self), size=len(own))]
        return ReachedStates(
            np.where(those[:, None], drawn.rows, own.rows), np.where(those[:, None], drawn.states, own.states)
        )


@dataclass(frozen=True, eq=False)
class Practice:
    """The states that drives reached, as lessons yet to be given, with scores of the drives."""

    met: ReachedStates
    collision_rate: float
    mean_away_m: float  # from the log, while the drive lasted


def practise(room: Classroom, predict: Predict, scene: Int[np.ndarray, " drive"], lost_m: float = LOST_M) -> Practice:
    """Drive the egos of some scenes from their first step, with all others on their logs.

    A drive ends where the ego is further than `lost_m` [m] from its log, as it has nothing to learn there.
    """
    alive, hit = np.ones(len(scene), bool), np.zeros(len(scene), bool)
    rows, states, away = [], [], []
    for now, (lesson, known) in enumerate(islice(drive(room, predict, scene), room.steps - WAYPOINTS)):
        hits, missed_m = map(np.asarray, _mishaps(room, lesson))
        hit |= alive & hits
        alive &= ~(hits | (missed_m > lost_m))
        away.append(missed_m[alive])
        if now % _EVERY == 0:
            rows.append(np.stack([scene, 0 * scene, 0 * scene + now], axis=-1)[alive])
            states.append(known[alive])
    met = ReachedStates(np.concatenate(rows), np.concatenate(states))
    return Practice(met, float(hit.mean()), float(np.concatenate(away).mean()))


def drive(
    room: Classroom, predict: Predict, scene: Int[np.ndarray, " drive"]
) -> Iterator[tuple[Lesson, Float[np.ndarray, "drive 4"]]]:
    """The drives of the egos of some scenes, step by step, as lessons and as states (x, y, yaw, speed)."""
    drives = jnp.asarray(scene)
    state = jax.tree.map(lambda values: values[drives, 0, 0], room.log)
    for now in range(room.steps):
        lesson = Lesson(drives, jnp.zeros_like(drives), jnp.full_like(drives, now), room.target[drives], state)
        known = np.stack([np.asarray(value) for value in (state.x, state.y, state.yaw, state.speed)], axis=-1)
        yield lesson, known
        waypoints = predict(room.views(lesson), state.speed, room.targets(lesson), room.closed_lights(lesson))
        state = _advance(jnp.asarray(waypoints), state, room.dt)


@compiled
def _advance(waypoints: Float[Array, "drive waypoint 2"], state: Motion, dt: float) -> Motion:
    return step(state, clip(jax.vmap(steer)(waypoints, state.speed)), dt)


@compiled
def _mishaps(room: Classroom, lesson: Lesson) -> tuple[Bool[Array, " drive"], Float[Array, " drive"]]:
    """Which egos overlap another agent, and the distance of each from its log [m]."""

    def touches(one: Lesson) -> Bool[Array, ""]:
        boxes, others = room.boxes(one)
        mine = boxes.half_length[one.agent], boxes.half_width[one.agent]
        ego = Box(one.state.x, one.state.y, jnp.cos(one.state.yaw), jnp.sin(one.state.yaw), *mine)
        return (others & overlaps(ego, boxes)).any()

    at = (lesson.scene, lesson.agent, lesson.step)
    return jax.vmap(touches)(lesson), jnp.hypot(room.log.x[at] - lesson.state.x, room.log.y[at] - lesson.state.y)
