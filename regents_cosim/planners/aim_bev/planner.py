"""AIM-BEV as a planner of the mirror, with observer, network and controller in one step."""

import functools
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from regents_cosim.geometry.boxes import same_level
from regents_cosim.geometry.frames import ahead_and_left
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.levels import HeightMap
from regents_cosim.mirror.programs.on_device import on_device
from regents_cosim.mirror.rollout import Traffic
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.aim_bev.architecture import WAYPOINTS
from regents_cosim.planners.aim_bev.camera import Camera
from regents_cosim.planners.aim_bev.controller import steer
from regents_cosim.planners.aim_bev.ground import Ground, draw_cells, stop_bars, to_ground
from regents_cosim.planners.aim_bev.network import NetworkWeights, to_network
from regents_cosim.planners.aim_bev.network_inputs import AS_IN_THE_PAPERS, NetworkInputs
from regents_cosim.planners.aim_bev.observe import MARK_S, Surroundings, observe
from regents_cosim.planners.aim_bev.route_ahead import RouteAhead
from regents_cosim.planners.aim_bev.weights_file import HARDENED, SHIPPED, load_weights
from regents_cosim.planners.jax_planner import CompiledScene, JaxPlanner

# Remember the last drive through a scene, so that a plan is not computed again where nothing in view is new.
#
# An attack moves few agents, and those mostly out of sight at first, so most of its drives begin like the one before.
# The plan is the same to the last bit, because everything that it depends on is the same.
_VALUES = 6  # values that describe an agent's look


class LastDrive(eqx.Module):
    """Everything in view at every step, and the plan; NaN where nothing was seen yet."""

    seen: Float[Array, "*time value"]
    waypoints: Float[Array, "*time waypoint 2"]  # [m]

    @classmethod
    def of_nothing(cls, steps: int, others: int) -> "LastDrive":
        """The record before the first drive among `others` other agents."""
        shapes = (steps, 4 + _VALUES * others), (steps, WAYPOINTS, 2)
        return cls(*(on_device(np.full(shape, np.nan), np.float32) for shape in shapes))

    def at(self, step: Int[Array, ""]) -> "LastDrive":
        """The record of one step."""
        return jax.tree.map(lambda values: values[step], self)

    def put(self, step: Int[Array, ""], instant: "LastDrive") -> "LastDrive":
        """The record with `instant` at a step."""
        return jax.tree.map(lambda values, value: values.at[step].set(value), self, instant)


def in_view(view: Surroundings, ego: Motion, camera: Camera) -> Float[Array, " value"]:
    """Everything on which the picture by `camera` depends at one step: the ego, and agents near enough to be drawn."""
    box = view.boxes
    length = box.half_length + MARK_S * jnp.abs(view.speed)
    near = jnp.hypot(box.x - ego.x, box.y - ego.y) < camera.reach_m + jnp.hypot(length, box.half_width) + 1.0
    looks = jnp.stack([box.x, box.y, box.cos, box.sin, view.speed, view.valid.astype(jnp.float32)])
    own = jnp.stack([ego.x, ego.y, ego.yaw, ego.speed])
    return jnp.concatenate([own, jnp.where(near, looks, jnp.inf).ravel()])


_BEYOND_M = 30.0  # how far the ego may leave its route to the target and still see the road


class AimBevMemory(eqx.Module):
    """The constants of a scene (map, target), and its state (time, last drive)."""

    ground: Ground
    bars: Box
    lights: UInt8[Array, "time bar"]
    target: Float[Array, " 2"]  # [m] the last logged position
    way: RouteAhead | None  # for weights that follow the route: gives targets and closed lights
    now: Int[Array, ""]
    last_drive: LastDrive
    heights: HeightMap | None  # in scenes with roads above each other


class AimBevSight(eqx.Module):
    """The other road users as boxes for all steps at once."""

    boxes: Box  # [time agent]
    speed: Float[Array, "*time agent"]  # [m/s]
    valid: Array


class AimBev(JaxPlanner):
    """AIM-BEV looks from above and drives to its last logged position, or along its route.

    Source: ReGentS section 4 and KING, whose agent gets the last logged position and sees 19 m to each side. Weights
    may have been taught with other inputs (`given`).
    """

    network: NetworkWeights
    given: NetworkInputs = eqx.field(static=True, default=AS_IN_THE_PAPERS)

    def init(self, scene: CompiledScene) -> AimBevMemory:
        """Draw the map around the route up to the target."""
        scenario, route = scene.scenario, scene.route
        track = route.points[: int(route.target_m) + 1]
        camera = self.given.camera
        around_m = camera.reach_m + _BEYOND_M
        low = track.min(axis=0) - around_m
        cells = draw_cells(scenario.road, low, track.max(axis=0) + around_m, camera)
        way = RouteAhead.of(scenario, scene.origin) if self.given.follows_route else None
        if way is None:
            bars, lights = stop_bars(scenario.road, scenario.signals, scenario.tracks.steps, scene.origin)
        else:
            bars, lights = way.bars, way.lights
        return AimBevMemory(
            ground=to_ground(cells, low, scene.origin),
            bars=bars,
            lights=lights,
            target=scene.on_device(np.array([scenario.target]))[0],
            way=way,
            now=on_device(0, np.int32),
            last_drive=LastDrive.of_nothing(lights.shape[0], scene.world.valid.shape[0] - 1),
            heights=scene.world.heights,
        )

    def look(self, memory: AimBevMemory, traffic: Traffic) -> AimBevSight:
        """The boxes of the others; the view itself depends on the ego's position."""
        motion = traffic.motion
        sizes = (jnp.broadcast_to(half[:, None], motion.x.shape) for half in (traffic.half_length, traffic.half_width))
        boxes = Box(motion.x, motion.y, jnp.cos(motion.yaw), jnp.sin(motion.yaw), *sizes, z=traffic.z)
        return jax.tree.map(lambda values: values.T, AimBevSight(boxes, motion.speed, traffic.valid))

    def step(self, memory: AimBevMemory, sight: AimBevSight, ego: Motion) -> tuple[ControlArrays, AimBevMemory]:
        """Render the view, plan waypoints, and steer along them."""
        view = Surroundings(sight.boxes, sight.speed, self.on_level(memory, sight, ego), memory.lights[memory.now])
        seen, before = in_view(view, ego, self.given.camera), memory.last_drive.at(memory.now)
        known = (seen == before.seen).all()
        waypoints = jax.lax.cond(known, lambda: before.waypoints, lambda: self.plan(memory, view, ego))
        last_drive = memory.last_drive.put(memory.now, LastDrive(seen, waypoints))
        memory = eqx.tree_at(lambda m: (m.now, m.last_drive), memory, (memory.now + 1, last_drive))
        return steer(waypoints, ego.speed), memory

    def on_level(self, memory: AimBevMemory, sight: AimBevSight, ego: Motion) -> Array:
        """Which agents are on the ego's level: agents on a bridge neither hide those below nor are seen from there."""
        if memory.heights is None:
            return sight.valid
        return sight.valid & same_level(sight.boxes.z, memory.heights.of_ego(ego.x, ego.y))

    def keep(self, last: AimBevMemory) -> LastDrive:
        """Keep what was seen, and planned."""
        return last.last_drive

    def recall(self, memory: AimBevMemory, kept: LastDrive) -> AimBevMemory:
        """The memory of the first step, with what was kept."""
        return eqx.tree_at(lambda m: m.last_drive, memory, kept)

    def plan(self, memory: AimBevMemory, view: Surroundings, ego: Motion) -> Float[Array, "waypoint 2"]:
        """Waypoints [m] in the ego's frame."""
        picture, target, light = self.shown(memory, view, ego)
        return self.network(picture, ego.speed, target, light)

    def shown(
        self, memory: AimBevMemory, view: Surroundings, ego: Motion
    ) -> tuple[UInt8[Array, "192 192 3"], Float[Array, " 2"], Float[Array, ""]]:
        """The network's inputs: picture, target [m, ego's frame], and nearness of a closed light."""
        place = memory.target if memory.way is None else memory.way.target(ego)
        target = jnp.stack(ahead_and_left(jnp, place[0] - ego.x, place[1] - ego.y, ego.yaw))
        light = jnp.float32(0.0) if memory.way is None else memory.way.light(ego, memory.now)
        return observe(memory.ground, memory.bars, view, ego, self.given.camera), target, light


def with_weights(path: Path) -> AimBev:
    """AIM-BEV with the weights of a file. Raises RegentsError where it holds none."""
    weights = load_weights(path)
    return AimBev(to_network(weights), NetworkInputs.to(weights))


def aim_bev(weights: str = "") -> AimBev:
    """AIM-BEV: `aim-bev` with the weights of the package, `aim-bev:WEIGHTS` with those of a file."""
    return with_weights(Path(weights)) if weights else _of_package(SHIPPED)


def aim_bev_hardened() -> AimBev:
    """AIM-BEV trained further on crashes and on lights, named `aim-bev-hardened`."""
    return _of_package(HARDENED)


@functools.cache
def _of_package(weights: Path) -> AimBev:
    return with_weights(weights)
