"""World: a Scenario on the device, and the only border between NumPy and JAX.

It is padded to a few shapes with masks, has no strings, is in float32, and its coordinates are relative to the middle
of the ego's track (8 km from the origin a float32 step is 1 mm; near it, a thousandth of that).
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from regents_cosim.geometry import boxes
from regents_cosim.geometry.jumps import leaps
from regents_cosim.maps.levels import contains, has_levels
from regents_cosim.mirror import bicycle
from regents_cosim.mirror.actions import OF_RECORDINGS, fill_gaps, fit_controls
from regents_cosim.mirror.bicycle import ControlArrays, Motion
from regents_cosim.mirror.dynamics import Mobility
from regents_cosim.mirror.lane_centres import LaneCentres
from regents_cosim.mirror.levels import HeightMap, to_height_map
from regents_cosim.mirror.logged_way import LoggedWay, logged_way
from regents_cosim.mirror.programs.on_device import on_device, seen_from
from regents_cosim.mirror.road_field import RoadField, all_road, blur
from regents_cosim.mirror.separation import Box
from regents_cosim.norms.limits import MOST_SPEED_M_S
from regents_cosim.scenario.attack_record import Dynamics
from regents_cosim.scenario.scenario import VEHICLE_KINDS, Kind, Scenario, Tracks

# Numbers of agents that worlds are padded to. Smaller ones would take another program, which takes longer to trace than
# dozens of small windows take to search.
AGENT_BUCKETS = (32, 64, 128)


class DriveBounds(eqx.Module):
    """The limits [agent] within which an attack may move agents, unless their log exceeds them."""

    accel: Float[Array, " agent"]  # [m/s^2]
    braking: Float[Array, " agent"]  # [m/s^2]
    lateral_accel: Float[Array, " agent"]  # [m/s^2] to either side
    jerk: Float[Array, " agent"]  # [m/s^3] longitudinal


class World(eqx.Module):
    """One scenario on the device: agent 0 is the ego, and padding agents are never valid.

    Invalid entries of `log` hold the nearest valid state, so that no absurd or non-finite value reaches a gradient;
    they count nowhere.
    """

    log: Motion  # [agent time] as recorded
    valid: Bool[Array, "agent time"]
    controls: ControlArrays  # [agent step] that reproduce the log
    start: Motion  # [agent] state at the first valid step
    moving: Bool[Array, "agent step"]  # from the first valid step on
    half_length: Float[Array, " agent"]  # [m]
    half_width: Float[Array, " agent"]  # [m]
    vehicle: Bool[Array, " agent"]  # a motor vehicle, not a pedestrian or cyclist
    apart: Bool[Array, "agent agent"]  # whether boxes do not overlap when both agents are first present
    on_road: Bool[Array, "4 agent"]  # corners that begin on the road and have to stay there; none of pedestrians
    road: RoadField
    top_speed: Float[Array, " agent"]  # [m/s] limit for an attack; vehicles have one only under the law
    dt: Float[Array, ""]  # [s]
    heights: HeightMap | None = None  # in scenes with roads above each other
    own_road: RoadField | None = None  # road for the one agent that an attack under the law moves; None: `road`
    bounds: DriveBounds | None = None  # limits of the attack, if it has any
    lanes: LaneCentres | None = None  # for attacks that ask what a careful driver would see
    logged_way: LoggedWay | None = None  # where agents react: without it they only brake
    walks: Bool[Array, " agent"] | None = None  # marks pedestrians, which move as point masses; None: there are none
    cycles: Bool[Array, " agent"] | None = None  # marks cyclists; None: there are none
    # agents that move as logged, since no controls reproduce it; None: none
    scripted: Bool[Array, " agent"] | None = None
    dynamics: Dynamics = eqx.field(static=True, default="bicycle")  # the model that the controls belong to

    def without_road(self) -> "World":
        """The world without its road, for programs that do not use it; so they need not be compiled for its size."""
        return dataclasses.replace(self, road=all_road(), own_road=None, bounds=None, lanes=None)

    def for_reactions(self, scenario: Scenario) -> "World":
        """The world with the ways of the log of its scenario, on which agents give way and drive around others."""
        return dataclasses.replace(self, logged_way=logged_way(scenario, len(self.vehicle)))

    @property
    def mobility(self) -> Mobility:
        """The models of motion of its agents."""
        return Mobility(self.half_length, self.walks, self.dynamics)

    @property
    def allowed(self) -> RoadField:
        """The area in which the agents that an attack moves may drive."""
        return self.road if self.own_road is None else self.own_road

    def boxes(self, motion: Motion) -> Box:
        """The boxes [agent time] of all agents along `motion`."""
        half = (self.half_length[:, None], self.half_width[:, None])
        return Box(motion.x, motion.y, jnp.cos(motion.yaw), jnp.sin(motion.yaw), *half, self.height(motion))

    def height(self, motion: Motion) -> Float[Array, "agent *time"] | None:
        """The height [m] of the road under all agents along `motion`; None where no road lies above another."""
        return None if self.heights is None else self.heights(motion.x, motion.y)


def scene_origin(scenario: Scenario) -> Float[np.ndarray, " 2"]:
    """The origin [m, map frame] of the device's coordinates."""
    track = np.stack([scenario.tracks.x[0], scenario.tracks.y[0]])
    return 0.5 * (track.min(axis=1) + track.max(axis=1))


def padded_agents(agents: int) -> int:
    """The padded number of agents of a World with so many real agents."""
    return next((size for size in AGENT_BUCKETS if size >= agents), agents)


def to_roadless_world(scenario: Scenario, dynamics: Dynamics | None = None) -> World:
    """Like `to_world`, but everything counts as road: for drives, which do not use the road field."""
    return to_world(scenario, dynamics, road=all_road())


def to_world(
    scenario: Scenario,
    dynamics: Dynamics | None = None,
    room: int = 0,
    road: RoadField | None = None,
    passes: int = OF_RECORDINGS,
) -> World:
    """Move a Scenario to the device; its controls are the smooth fit of its tracks (`actions`) in `passes` passes.

    Agents move by `dynamics`, by default the model that the scenario's controls belong to. Pedestrians walk, except
    under highway-env's model, which has only vehicles. The world has room for at least `room` agents. `road` is the
    field of the map, in the mirror's coordinates, where it is known already.
    """
    dynamics = dynamics or scenario.dynamics
    tracks, origin = scenario.tracks, scene_origin(scenario)
    real = len(scenario.agents)
    padded = padded_agents(max(real, room))
    extra = padded - real
    valid = np.pad(tracks.valid, ((0, extra), (0, 0)))
    filled = fill_gaps(tracks)
    here = seen_from(np.stack([filled.x, filled.y], axis=-1), origin)
    log = [
        np.pad(values, ((0, extra), (0, 0)))
        for values in (here[..., 0], here[..., 1], np.unwrap(filled.yaw, axis=1), filled.speed)
    ]
    motion = Motion(*(on_device(values, np.float32) for values in log))
    first = np.argmax(valid, axis=1)
    moving = np.arange(tracks.steps - 1) >= first[:, None]
    dt = on_device(scenario.dt, np.float32)
    start = Motion(*(on_device(values[np.arange(padded), first], np.float32) for values in log))
    present = np.stack([filled.x, filled.y], axis=-1)[tracks.valid]
    sizes = np.array([(a.length, a.width) for a in scenario.agents] + [(1.0, 1.0)] * extra)
    half_length = on_device(0.5 * sizes[:, 0], np.float32)
    walks = _who_are("pedestrian", scenario, padded) if dynamics == "bicycle" else None
    heights, levels = None, None
    if scenario.heights.stacked:
        way = [np.pad(values, ((0, extra), (0, 0))) for values in (filled.x, filled.y, filled.z)]
        heights = to_height_map(scenario.heights, (way[0], way[1], way[2]), valid, origin)
        levels = scenario.heights.levels if has_levels(scenario.road) else None
    there, enters = on_device(valid, np.bool_), on_device(moving, np.bool_)
    return World(
        log=motion,
        valid=there,
        controls=fit_controls(motion, there, start, enters, dt, Mobility(half_length, walks, dynamics), passes),
        start=start,
        moving=enters,
        half_length=half_length,
        half_width=on_device(0.5 * sizes[:, 1], np.float32),
        vehicle=on_device([a.kind in VEHICLE_KINDS for a in scenario.agents] + [False] * extra, np.bool_),
        apart=on_device(np.pad(_apart_at_first(scenario), (0, extra)), np.bool_),
        on_road=on_device(np.pad(_corners_on_road(scenario), ((0, 0), (0, extra))), np.bool_),
        road=blur(scenario.road, present.min(axis=0), present.max(axis=0), origin, levels) if road is None else road,
        top_speed=_top_speeds(scenario, padded),
        dt=dt,
        heights=heights,
        walks=walks,
        cycles=_who_are("bicycle", scenario, padded),
        scripted=_masked(leaps(tracks.x, tracks.y, tracks.valid, scenario.dt), padded),
        dynamics=dynamics,
    )


def _who_are(kind: Kind, scenario: Scenario, padded: int) -> Bool[Array, " agent"] | None:
    """Which agents other than the ego are of a kind; None where none is."""
    return _masked(np.array([agent.kind == kind for agent in scenario.agents]), padded)


def _masked(agents: Bool[np.ndarray, " real"], padded: int) -> Bool[Array, " agent"] | None:
    """Which agents other than the ego are marked; None where none is, so that such traffic shares one program."""
    others = np.pad(agents, (0, padded - len(agents)))
    others[0] = False
    return on_device(others, np.bool_) if others.any() else None


def _top_speeds(scenario: Scenario, padded: int) -> Float[Array, " agent"]:
    """The top speeds [m/s] of agents under attack: the limit of their kind, or that of their log if higher."""
    most = np.full(padded, np.inf, np.float32)
    for index, agent in enumerate(scenario.agents):
        if agent.kind in MOST_SPEED_M_S:
            most[index] = max(MOST_SPEED_M_S[agent.kind], float(scenario.tracks.speed[index].max()))
    return on_device(most, np.float32)


def to_tracks(motion: Motion, controls: ControlArrays, scenario: Scenario) -> Tracks:
    """Tracks of the scenario's agents along `motion`, in the map frame; invalid where the scenario's are.

    On the host a curvature is that of the path, for pedestrians too.
    """
    real, valid = len(scenario.agents), scenario.tracks.valid
    origin = scene_origin(scenario)
    x, y, yaw, speed = (
        np.asarray(v, np.float64)[:real] for v in (motion.x, motion.y, motion.yaw, motion.speed)
    )  # fmt: skip
    held = valid[:, :-1] & valid[:, 1:]
    accel, curvature = (
        np.where(held, np.asarray(v, np.float64)[:real], 0.0) for v in (controls.accel, controls.curvature)
    )
    walking = np.array([agent.kind == "pedestrian" for agent in scenario.agents])[:, None]
    if walking.any():
        of_way = np.asarray(bicycle.controls_between(motion, scenario.dt).curvature, np.float64)[:real]
        curvature = np.where(walking & held, of_way, curvature)
    tracks = Tracks(x + origin[0], y + origin[1], yaw, np.maximum(speed, 0.0), valid, accel, curvature)
    absent = {name: np.where(valid, getattr(tracks, name), 0.0) for name in ("x", "y", "yaw", "speed")}
    return scenario.with_heights(dataclasses.replace(tracks, **absent))


def _apart_at_first(scenario: Scenario) -> Bool[np.ndarray, "agent agent"]:
    """Pairs of agents whose boxes do not overlap at the first step at which both are present."""
    tracks = scenario.tracks
    both = tracks.valid[:, None] & tracks.valid[None]
    step = np.argmax(both, axis=2)
    index = np.arange(len(scenario.agents))
    mine = boxes.Boxes(*(v[index[:, None], step] for v in np.broadcast_arrays(*scenario.boxes)))
    theirs = boxes.Boxes(*(v[index[None, :], step] for v in np.broadcast_arrays(*scenario.boxes)))
    return np.logical_not(boxes.overlap(mine, theirs))


def _corners_on_road(scenario: Scenario) -> Bool[np.ndarray, "4 agent"]:
    """Corners that are on the road at the first valid step; none of pedestrians, who may be anywhere."""
    on_wheels = np.array([agent.kind != "pedestrian" for agent in scenario.agents])
    first = np.argmax(scenario.tracks.valid, axis=1)
    index = np.arange(len(scenario.agents))
    at_first = boxes.Boxes(*(v[index, first] for v in np.broadcast_arrays(*scenario.boxes)))
    return contains(scenario.road, boxes.corners(at_first), np.asarray(at_first.z)[:, None]).T & on_wheels
