"""Which road users a careful driver in the ego's place expects to meet, by the rules of the reference planner.

The others go on as they did for 0.3 s, and the ego as IDM brakes for what is in its way. Those count alone that are in
view. It does not wait to evaluate a danger: a network that sees one picture cannot know for how long it has been one.
So that it does not brake at nothing, it brakes when braking has to begin: when they would meet though it braked a
little later. And it brakes for those alone that come in the recording as well: most of those that are expected to meet
it give way.
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
from regents_cosim.planners.aim_bev.lessons import Classroom, Lesson
from regents_cosim.planners.idm import IdmMemory, place_on_route, route_poses
from regents_cosim.planners.reference.foresight import EGO_TIMES_S, ExpectedMotion, is_risk, may_meet
from regents_cosim.scenario import Scenario

_MOST = 16  # others that are looked at: the nearest
_LATER_S, _BRAKING_M_S2 = 0.8, 5.0  # firm braking a little later: where that is enough, nothing needs to be done yet


class Dangers(eqx.Module):
    """What it needs beside the traffic."""

    lanes: LaneCentres  # [scene]

    @classmethod
    def of(cls, scenarios: Sequence[Scenario], camera: Camera) -> "Dangers":
        """Around the egos of `scenarios`, in the coordinates of their maps."""
        around = [lane_centres(scenario, np.zeros(2), around_ego_m=camera.view_m) for scenario in scenarios]
        points = max(lanes.x.shape[0] for lanes in around)
        return cls(jax.tree.map(lambda *values: jnp.stack([_padded(v, points) for v in values]), *around))

    def there(
        self, room: Classroom, route: IdmMemory, one: Lesson, near: Bool[Array, " agent"], accel: Float[Array, ""]
    ) -> Bool[Array, ""]:
        """Whether the taught has to brake now. It is about to accelerate so [m/s^2]; only who is `near` counts."""
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
            route.half_width,
        )
        lanes = jax.tree.map(lambda values: values[one.scene], self.lanes)
        wanders = lanes.away(courses.x, courses.y, courses.yaw) > CAREFUL.wandering_m
        then, there = _as_recorded(log, valid, one.step, room, (courses.half_length, courses.half_width))

        def meets(way_m: Float[Array, " time"]) -> Bool[Array, ""]:
            x, y, cos, sin = route_poses(route, mine + way_m)
            ego = Box(x - aside * sin, y + aside * cos, cos, sin, route.half_length, route.half_width)
            comes = (may_meet(ego, then) & there).any(axis=-1)
            return (is_risk(ego, courses, place, wanders) & comes & near & valid[:, one.step]).any()

        goes_on = further(jnp, one.state.speed, jnp.maximum(-accel, 0.0), EGO_TIMES_S)
        late = one.state.speed * np.minimum(EGO_TIMES_S, _LATER_S)
        late += further(jnp, one.state.speed, jnp.float32(_BRAKING_M_S2), np.maximum(EGO_TIMES_S - _LATER_S, 0.0))
        return meets(goes_on) & meets(late)


def _courses(
    log: Motion, valid: Bool[Array, "agent time"], step: Array, room: Classroom, sizes: tuple[Array, Array]
) -> ExpectedMotion:
    """How the others go on, from how they went of late."""
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
    """Where the others will be, at the times of `FORESIGHT` from a step on, and whether they will be there at all.

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
    """With points that are far from everything."""
    return jnp.pad(values, (0, points - values.shape[0]), constant_values=1e6)
