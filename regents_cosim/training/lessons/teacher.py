"""A teacher for states in which the log tells nothing: IDM on the ego's route, which sees no more than the view shows.

The log shows how to return to it. A network that has driven elsewhere needs to know what to do there: brake for an
agent that is ahead now. What lies beyond the view must not count, or the network would be taught to brake for what it
cannot see.

The teacher keeps the pace of SUMO's traffic, whose drivers accelerate to the limit without slackening and turn at up to
5.5 m/s^2 (netconvert's `junctions.limit-turn-speed`): those who drive as logged would run into a slower pupil.

IDM brakes for agents in its way, not for those that will be. A careful teacher brakes for these too (`_must_brake`).
Neither gives way. In ordinary traffic the log does, so near it a careful teacher follows it, unless an attack changed
it.
"""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import ControlArrays, Motion, clip, step
from regents_cosim.mirror.lane_centres import LaneCentres, lane_centres
from regents_cosim.mirror.programs.compiled import compiled
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.mirror.separation import Box
from regents_cosim.norms.careful import FORESIGHT, seen_over_steps
from regents_cosim.norms.foresight import further, place_of
from regents_cosim.norms.limits import ACCEL_LIMIT
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS
from regents_cosim.planners.aim_bev.camera import PAPERS, Camera
from regents_cosim.planners.aim_bev.route_ahead import OVER_M
from regents_cosim.planners.careful.foresight import EGO_TIMES_S, ExpectedMotion, is_risk, may_meet
from regents_cosim.planners.idm import IDM, IdmMemory, place_on_route, route_poses, to_stop_lines
from regents_cosim.scenario.scenario import Scenario
from regents_cosim.training.lessons.classroom import Classroom, Lesson, to_frame

# Find the road users that a careful driver in the ego's place expects to meet, by the rules of the careful planner.
# The others are expected to continue as in the last 0.3 s, the ego to brake as IDM does. Only agents in view count. A
# danger needs no evaluation time, since a network that sees one picture cannot know how long it has lasted. To avoid
# braking at nothing, the driver brakes only when it has to begin: when they would meet even if it braked a little
# later. And it brakes only for agents that come in the recording too, since most of those that are expected to meet
# it give way.
_MOST = 16  # agents that are considered: the nearest
_LATER_S, _BRAKING_M_S2 = 0.8, 5.0  # firm braking a little later: where that is enough, there is no danger yet


def _lanes_around(scenarios: Sequence[Scenario], camera: Camera) -> LaneCentres:
    """The lanes [scene] around the egos of `scenarios`, in the coordinates of their maps."""
    around = [lane_centres(scenario, np.zeros(2), around_ego_m=camera.view_m) for scenario in scenarios]
    points = max(lanes.x.shape[0] for lanes in around)

    def padded(values: Float[Array, " point"]) -> Float[Array, " more"]:
        return jnp.pad(values, (0, points - len(values)), constant_values=1e6)  # far from everything

    return jax.tree.map(lambda *values: jnp.stack(list(map(padded, values))), *around)


def _must_brake(
    room: Classroom,
    lanes: LaneCentres,
    route: IdmMemory,
    one: Lesson,
    near: Bool[Array, " agent"],
    accel: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether the taught ego, about to apply `accel` [m/s^2], must brake now; only agents in `near` count."""
    log = jax.tree.map(lambda values: values[one.scene], room.log)
    valid = room.valid[one.scene]
    away = jnp.hypot(log.x[:, one.step] - one.state.x, log.y[:, one.step] - one.state.y)
    _, those = jax.lax.top_k(jnp.where(near & valid[:, one.step], -away, -jnp.inf), min(_MOST, len(near)))
    log, valid, near = jax.tree.map(lambda values: values[those], (log, valid, near))
    sizes = room.half_length[one.scene][those], room.half_width[one.scene][those]
    courses = _courses(log, valid, one.step, room, sizes)
    along, across, yaw = place_on_route(route, courses.x, courses.y)
    mine, aside, _ = place_on_route(route, one.state.x, one.state.y)
    own_half = route.half_length, route.half_width
    place = place_of(jnp, along - mine, across - aside, courses.yaw - yaw, *sizes, own_half)
    off_m = lanes.off_centre(courses.x, courses.y, courses.yaw)
    line_m = lanes.to_yield_line(courses.x, courses.y, courses.yaw)
    then, there = _as_recorded(log, valid, one.step, room, sizes)

    def meets(way_m: Float[Array, " time"]) -> Bool[Array, ""]:
        x, y, cos, sin = route_poses(route, mine + way_m)
        ego = Box(x - aside * sin, y + aside * cos, cos, sin, *own_half)
        comes = (may_meet(ego, then) & there).any(axis=-1)
        risks = is_risk(ego, courses, place, off_m, line_m, jnp.asarray(False))
        return (risks & comes & near & valid[:, one.step]).any()

    goes_on = further(jnp, one.state.speed, jnp.maximum(-accel, 0.0), EGO_TIMES_S)
    late = one.state.speed * np.minimum(EGO_TIMES_S, _LATER_S)
    late += further(jnp, one.state.speed, jnp.float32(_BRAKING_M_S2), np.maximum(EGO_TIMES_S - _LATER_S, 0.0))
    return meets(goes_on) & meets(late)


def _courses(
    log: Motion, valid: Bool[Array, "agent time"], step: Array, room: Classroom, sizes: tuple[Array, Array]
) -> ExpectedMotion:
    """The expected motion of the others, from their recent motion."""
    now = jax.tree.map(lambda values: values[:, step], log)
    before = jnp.maximum(step - int(seen_over_steps(np, room.dt)), 0)
    passed_s = jnp.maximum((step - before) * room.dt, room.dt)
    known = valid[:, before] & (before < step)
    return ExpectedMotion.since((log.yaw[:, before], log.speed[:, before]), now, known, passed_s, sizes)


def _as_recorded(
    log: Motion, valid: Bool[Array, "agent time"], step: Array, room: Classroom, sizes: tuple[Array, Array]
) -> tuple[Box, Bool[Array, "agent later"]]:
    """The recorded boxes of the others at the times of `FORESIGHT` after a step, and whether they will be present.

    After the end of the recording they go straight on.
    """
    steps = step + np.round(FORESIGHT.times_s / room.dt).astype(int)
    known = jnp.minimum(steps, room.steps - 1)
    then = jax.tree.map(lambda values: values[:, known], log)
    cos, sin = jnp.cos(then.yaw), jnp.sin(then.yaw)
    beyond = then.speed * (steps - known) * room.dt
    boxes = Box(then.x + beyond * cos, then.y + beyond * sin, cos, sin, *(size[:, None] for size in sizes))
    return boxes, valid[:, known]


# IDM stands half a metre before a stop line: one or two pixels, which no network keeps to, and past the line it drives
# on. So the teacher stands further off, up to a metre past the line.
_ROOM_M, _FIRM_M_S2 = 3.0, 4.0
# Where it is slow this near, it stops: a network that is taught to creep to the 3 m creeps over the line.
_NEAR_M, _SLOW_M_S = 6.0, 1.0

_AT_LOG_M, _AT_LOG_S = 2.0, 0.3  # nearer to its log than this, plus its way in that time, an ego follows the log

_PACE = IDM(max_accel=3.0, exponent=12.0, lateral_accel=5.0)

_Drives = Callable[[Motion, Array], ControlArrays]  # gives the controls for a state, a number of steps ahead


class Teacher(eqx.Module):
    """IDM with the egos' routes, in the coordinates of their maps."""

    idm: IDM
    routes: IdmMemory  # [scene]
    lanes: LaneCentres | None  # [scene] by which a careful teacher tells dangers; None: IDM alone
    by_log: Bool[Array, " scene"]  # whether the ego is taught its log where it is near

    @classmethod
    def of(
        cls,
        scenarios: Sequence[Scenario],
        careful: bool = False,
        camera: Camera = PAPERS,
        by_log: Sequence[bool] | None = None,
    ) -> "Teacher":
        """A teacher on the egos' routes through `scenarios`; `by_log` says where logs teach, by default nowhere."""
        idm = _PACE
        routes = [idm.on_route(scenario, np.zeros(2)) for scenario in scenarios]
        lanes = _lanes_around(scenarios, camera) if careful else None
        logs = jnp.asarray(np.zeros(len(scenarios), bool) if by_log is None else np.array(by_log))
        return cls(idm, jax.tree.map(lambda *values: jnp.stack(values), *routes), lanes, logs)

    @compiled
    def labels(self, room: Classroom, lesson: Lesson) -> Float[Array, "batch waypoint 2"]:
        """The teacher's waypoints over the next 0.8 s [m, ego frame] in the egos' places; others drive as recorded."""
        return jax.vmap(lambda one: self._label(room, one))(lesson)

    @compiled
    def brakes(self, room: Classroom, lesson: Lesson) -> Bool[Array, " batch"]:
        """Whether the teacher fully brakes for an agent that will be in its way; IDM alone never does."""

        def one_brakes(one: Lesson) -> Bool[Array, ""]:
            return self._in_danger(room, one, self._idm(room, one)) & ~self._log_shows(room, one)

        return jax.vmap(one_brakes)(lesson)

    def _in_danger(self, room: Classroom, one: Lesson, idm: _Drives) -> Bool[Array, ""]:
        if self.lanes is None:
            return jnp.bool_(False)
        lanes, route = jax.tree.map(lambda values: values[one.scene], (self.lanes, self.routes))
        return _must_brake(room, lanes, route, one, _in_view(room, one), idm(one.state, jnp.int32(0)).accel)

    def _log_shows(self, room: Classroom, one: Lesson) -> Bool[Array, ""]:
        """Whether the log teaches here: it is near, and no closed light ahead needs more room."""
        log = jax.tree.map(lambda values: values[one.scene, 0, one.step], room.log)
        away = jnp.hypot(log.x - one.state.x, log.y - one.state.y)
        near = (away < _AT_LOG_M + _AT_LOG_S * log.speed) & (one.step + WAYPOINTS < room.steps)
        closed = jnp.bool_(False) if room.way is None else room.closed_light(one) > 0.0
        return self.by_log[one.scene] & near & ~closed

    def _idm(self, room: Classroom, one: Lesson) -> _Drives:
        route = jax.tree.map(lambda values: values[one.scene], self.routes)
        others = jax.tree.map(lambda values: values[one.scene], room.log)
        seen = room.valid[one.scene] & _in_view(room, one)[:, None]
        sizes = room.half_length[one.scene], room.half_width[one.scene]

        def drives(ego: Motion, ahead: Array) -> ControlArrays:
            now = jnp.minimum(one.step + ahead, room.steps - 1)
            motion, valid = jax.tree.map(lambda values: values[:, now][:, None], (others, seen))
            sight = jax.tree.map(lambda values: values[0], self.idm.look(route, Traffic(motion, valid, *sizes)))
            return self.idm.step(eqx.tree_at(lambda m: m.now, route, now), sight, ego)[0]

        return drives

    def _label(self, room: Classroom, one: Lesson) -> Float[Array, "waypoint 2"]:
        route, idm = jax.tree.map(lambda values: values[one.scene], self.routes), self._idm(room, one)
        braking = jnp.where(self._in_danger(room, one, idm), ACCEL_LIMIT, _before_light(route, one))

        def advance(ego: Motion, ahead: Array) -> tuple[Motion, Motion]:
            control = idm(ego, ahead)
            control = ControlArrays(
                jnp.where(braking > 0.0, jnp.minimum(control.accel, -braking), control.accel), control.curvature
            )
            after = step(ego, clip(control), room.dt)
            return after, after

        _, way = jax.lax.scan(advance, one.state, jnp.arange(WAYPOINTS))
        own = jax.vmap(to_frame, (0, 0, None))(way.x, way.y, one.state)
        return jnp.where(self._log_shows(room, one), room.label(one), own)


def _before_light(route: IdmMemory, one: Lesson) -> Float[Array, ""]:
    """The braking [m/s^2] that keeps a distance before a closed light; 0 where IDM's is enough, or it is too late."""
    to_line, square = to_stop_lines(route, one.state.x, one.state.y), one.state.speed**2
    can_stop = (to_line > -OVER_M) & (square < 2.0 * ACCEL_LIMIT * (to_line + OVER_M))
    slow_and_near = (one.state.speed < _SLOW_M_S) & (to_line < _NEAR_M)
    due = route.closed[one.step] & can_stop & (slow_and_near | (to_line - square / (2.0 * _FIRM_M_S2) < _ROOM_M))
    wanted = jnp.clip(square / (2.0 * jnp.maximum(to_line - _ROOM_M, 0.5)), _FIRM_M_S2, ACCEL_LIMIT)
    return jnp.where(due, wanted, 0.0).max()


def _in_view(room: Classroom, one: Lesson) -> Bool[Array, " agent"]:
    """Which agents have their centres in the taught ego's view, without the ego itself."""
    now = jax.tree.map(lambda values: values[one.scene, :, one.step], room.log)
    place = jax.vmap(to_frame, (0, 0, None))(now.x, now.y, one.state)
    return (jnp.abs(place) < room.camera.view_m).all(axis=1) & (jnp.arange(now.x.shape[0]) > 0)
