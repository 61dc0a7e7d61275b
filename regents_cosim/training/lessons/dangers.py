"""Find the road users that a careful driver in the ego's place expects to meet, by the rules of the reference driver.

The others are expected to continue as in the last 0.3 s, the ego to brake as IDM does. Only agents in view count. A
danger needs no evaluation time, since a network that sees one picture cannot know how long it has lasted. To avoid
braking at nothing, the driver brakes only when it has to begin: when they would meet even if it braked a little later.
And it brakes only for agents that come in the recording too, since most of those that are expected to meet it give way.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.mirror.bicycle import Motion
from regents_cosim.mirror.camera import Camera
from regents_cosim.mirror.lane_centres import LaneCentres, lane_centres
from regents_cosim.mirror.separation import Box
from regents_cosim.norms.careful import CAREFUL, FORESIGHT
from regents_cosim.norms.foresight import curvature_of, further, place_of
from regents_cosim.planners.idm import IdmMemory, place_on_route, route_poses
from regents_cosim.planners.reference.foresight import EGO_TIMES_S, ExpectedMotion, is_risk, may_meet
from regents_cosim.scenario import Scenario
from regents_cosim.training.lessons.classroom import Classroom, Lesson

_MOST = 16  # agents that are considered: the nearest
_LATER_S, _BRAKING_M_S2 = 0.8, 5.0  # firm braking a little later: where that is enough, there is no danger yet


class DangerInputs(eqx.Module):
    """The data besides the traffic that dangers depend on."""

    lanes: LaneCentres  # [scene]

    @classmethod
    def of(cls, scenarios: Sequence[Scenario], camera: Camera) -> "DangerInputs":
        """The lanes around the egos of `scenarios`, in the coordinates of their maps."""
        around = [lane_centres(scenario, np.zeros(2), around_ego_m=camera.view_m) for scenario in scenarios]
        points = max(lanes.x.shape[0] for lanes in around)
        return cls(jax.tree.map(lambda *values: jnp.stack([_padded(v, points) for v in values]), *around))

    def there(
        self, room: Classroom, route: IdmMemory, one: Lesson, near: Bool[Array, " agent"], accel: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether the taught ego, about to apply `accel` [m/s^2], must brake now; only agents in `near` count."""
        log = jax.tree.map(lambda values: values[one.scene], room.log)
        valid = room.valid[one.scene]
        away = jnp.hypot(log.x[:, one.step] - one.state.x, log.y[:, one.step] - one.state.y)
        _, those = jax.lax.top_k(jnp.where(near & valid[:, one.step], -away, -jnp.inf), min(_MOST, len(near)))
        log, valid, near = jax.tree.map(lambda values: values[those], (log, valid, near))
        courses = _courses(
            log, valid, one.step, room, (room.half_length[one.scene][those], room.half_width[one.scene][those])
        )
        along, across, yaw = place_on_route(route, courses.x, courses.y)
        mine, aside, _ = place_on_route(route, one.state.x, one.state.y)
        place = place_of(
            jnp,
            along - mine,
            across - aside,
            courses.yaw - yaw,
            courses.half_length,
            courses.half_width,
            (route.half_length, route.half_width),
        )
        lanes = jax.tree.map(lambda values: values[one.scene], self.lanes)
        wanders = lanes.away(courses.x, courses.y, courses.yaw) > CAREFUL.wandering_m
        line_m = lanes.to_yield_line(courses.x, courses.y, courses.yaw)
        then, there = _as_recorded(log, valid, one.step, room, (courses.half_length, courses.half_width))

        def meets(way_m: Float[Array, " time"]) -> Bool[Array, ""]:
            x, y, cos, sin = route_poses(route, mine + way_m)
            ego = Box(x - aside * sin, y + aside * cos, cos, sin, route.half_length, route.half_width)
            comes = (may_meet(ego, then) & there).any(axis=-1)
            return (
                is_risk(ego, courses, place, wanders, line_m, jnp.asarray(False)) & comes & near & valid[:, one.step]
            ).any()

        goes_on = further(jnp, one.state.speed, jnp.maximum(-accel, 0.0), EGO_TIMES_S)
        late = one.state.speed * np.minimum(EGO_TIMES_S, _LATER_S)
        late += further(jnp, one.state.speed, jnp.float32(_BRAKING_M_S2), np.maximum(EGO_TIMES_S - _LATER_S, 0.0))
        return meets(goes_on) & meets(late)


def _courses(
    log: Motion, valid: Bool[Array, "agent time"], step: Array, room: Classroom, sizes: tuple[Array, Array]
) -> ExpectedMotion:
    """The expected motion of the others, from their recent motion."""
    now = jax.tree.map(lambda values: values[:, step], log)
    before = jnp.maximum(step - max(round(FORESIGHT.over_s / room.dt), 1), 0)
    passed_s = jnp.maximum((step - before) * room.dt, room.dt)
    known = valid[:, before] & (before < step)
    turned = jnp.where(known, now.yaw - log.yaw[:, before], 0.0)
    braking = jnp.where(known, jnp.maximum(log.speed[:, before] - now.speed, 0.0) / passed_s, 0.0)
    return ExpectedMotion(
        now.x, now.y, now.yaw, now.speed, curvature_of(jnp, turned, now.speed, passed_s), braking, *sizes
    )


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


def _padded(values: Float[Array, " point"], points: int) -> Float[Array, " more"]:
    """Values padded with points that are far from everything."""
    return jnp.pad(values, (0, points - values.shape[0]), constant_values=1e6)
