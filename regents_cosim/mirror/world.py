"""World: a Scenario on the device, and the only border between NumPy and JAX.

Padded to a few shapes with masks, no strings, float32, coordinates relative to the middle of
the ego's track (8 km from the origin a float32 step is 1 mm; near it, a thousandth of that).
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
from regents_cosim.mirror.on_device import on_device, seen_from
from regents_cosim.mirror.road_field import RoadField, all_road, blur
from regents_cosim.mirror.separation import Box
from regents_cosim.norms.limits import MOST_SPEED_M_S
from regents_cosim.scenario import VEHICLE_KINDS, Dynamics, Kind, Scenario, Tracks

AGENT_BUCKETS = (16, 32, 64, 128)


class DriveBounds(eqx.Module):
    """How hard an attack may let agents drive, [agent] each, unless their log has more."""

    accel: Float[Array, " agent"]  # [m/s^2]
    braking: Float[Array, " agent"]  # [m/s^2]
    lateral_accel: Float[Array, " agent"]  # [m/s^2] to either side
    jerk: Float[Array, " agent"]  # [m/s^3] along


class World(eqx.Module):
    """One scenario: the ego is agent 0, entries beyond the real agents are never valid.

    Invalid entries of `log` hold the nearest valid state, so that nothing non-finite or absurd
    can reach a gradient; they count nowhere.
    """

    log: Motion  # [agent time] as recorded
    valid: Bool[Array, "agent time"]
    controls: ControlArrays  # [agent step] that reproduce the log
    start: Motion  # [agent] state at the first valid step
    moving: Bool[Array, "agent step"]  # from the first valid step on
    half_length: Float[Array, " agent"]  # [m]
    half_width: Float[Array, " agent"]  # [m]
    vehicle: Bool[Array, " agent"]  # a motor vehicle, not a pedestrian or cyclist
    apart: Bool[Array, "agent agent"]  # not overlapping when both are first there
    on_road: Bool[Array, "4 agent"]  # corners that begin on the drivable area and are to stay there: none of who walks
    road: RoadField
    top_speed: Float[Array, " agent"]  # [m/s] that an attack takes no agent beyond; of vehicles under the law alone
    dt: Float[Array, ""]  # [s]
    heights: HeightMap | None = None  # in scenes with roads above each other
    own_road: RoadField | None = None  # of the one agent that an attack under the law moves; None: `road`
    bounds: DriveBounds | None = None  # of an attack that has any
    lanes: LaneCentres | None = None  # where an attack asks what a careful driver would see
    walks: Bool[Array, " agent"] | None = None  # a pedestrian, which moves as a point mass; None: no agent is
    cycles: Bool[Array, " agent"] | None = None  # a cyclist; None: no agent is
    scripted: Bool[Array, " agent"] | None = None  # moves as logged, as no controls lead there; None: no agent does
    dynamics: Dynamics = eqx.field(static=True, default="bicycle")  # what the controls do

    def without_road(self) -> "World":
        """The same for programs that ask nothing of the road, so that its size needs none of its own."""
        return dataclasses.replace(self, road=all_road(), own_road=None, bounds=None, lanes=None)

    @property
    def mobility(self) -> Mobility:
        """How its agents move."""
        return Mobility(self.half_length, self.walks, self.dynamics)

    @property
    def slower_users(self) -> bool:
        """Whether there are any with a top speed of their own, besides the law's."""
        return self.walks is not None or self.cycles is not None

    @property
    def allowed(self) -> RoadField:
        """Where the agents that an attack moves may drive."""
        return self.road if self.own_road is None else self.own_road

    def boxes(self, motion: Motion) -> Box:
        """Boxes [agent time] of all agents along `motion`."""
        half = (self.half_length[:, None], self.half_width[:, None])
        return Box(motion.x, motion.y, jnp.cos(motion.yaw), jnp.sin(motion.yaw), *half, self.height(motion))

    def height(self, motion: Motion) -> Float[Array, "agent *time"] | None:
        """Heights [m] of the road under all agents along `motion`; None where no road is above another."""
        return None if self.heights is None else self.heights(motion.x, motion.y)


def scene_origin(scenario: Scenario) -> Float[np.ndarray, " 2"]:
    """Origin [m, map frame] of the device's coordinates."""
    track = np.stack([scenario.tracks.x[0], scenario.tracks.y[0]])
    return 0.5 * (track.min(axis=1) + track.max(axis=1))


def padded_agents(agents: int) -> int:
    """How many agents a World has that holds so many real ones."""
    return next((size for size in AGENT_BUCKETS if size >= agents), agents)


def to_roadless_world(scenario: Scenario, dynamics: Dynamics | None = None) -> World:
    """As `to_world`, but that all of it is road: for drives, which ask nothing of the road's field."""
    return to_world(scenario, dynamics, road=all_road())


def to_world(
    scenario: Scenario,
    dynamics: Dynamics | None = None,
    room: int = 0,
    road: RoadField | None = None,
    passes: int = OF_RECORDINGS,
) -> World:
    """Move a Scenario to the device; controls are the smooth fit of its tracks (`actions`).

    Agents move by `dynamics`, by default by the model that the scenario's controls belong to. Pedestrians walk, but for
    highway-env's model, which is one of vehicles. There is `room` for so many agents at least. `road` is the field of
    its map where that is known already, in the mirror's coordinates. The fit makes so
    many `passes`.
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
    """Which others are of a kind."""
    return _masked(np.array([agent.kind == kind for agent in scenario.agents]), padded)


def _masked(agents: Bool[np.ndarray, " real"], padded: int) -> Bool[Array, " agent"] | None:
    """Which others are marked; None where none is, so that traffic without them has no other program."""
    others = np.pad(agents, (0, padded - len(agents)))
    others[0] = False
    return on_device(others, np.bool_) if others.any() else None


def _top_speeds(scenario: Scenario, padded: int) -> Float[Array, " agent"]:
    """How fast an attack lets agents get [m/s]: those with a limit of their own, or as fast as in their log."""
    most = np.full(padded, np.inf, np.float32)
    for index, agent in enumerate(scenario.agents):
        if agent.kind in MOST_SPEED_M_S:
            most[index] = max(MOST_SPEED_M_S[agent.kind], float(scenario.tracks.speed[index].max()))
    return on_device(most, np.float32)


def to_tracks(motion: Motion, controls: ControlArrays, scenario: Scenario) -> Tracks:
    """Tracks of `scenario`'s agents along `motion`, in the map frame; absent where it has them absent.

    On the host a curvature is that of the way, of pedestrians too.
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
    """Pairs whose boxes do not overlap at the first step where both are present."""
    tracks = scenario.tracks
    both = tracks.valid[:, None] & tracks.valid[None]
    step = np.argmax(both, axis=2)
    index = np.arange(len(scenario.agents))
    mine = boxes.Boxes(*(v[index[:, None], step] for v in np.broadcast_arrays(*scenario.boxes)))
    theirs = boxes.Boxes(*(v[index[None, :], step] for v in np.broadcast_arrays(*scenario.boxes)))
    return np.logical_not(boxes.overlap(mine, theirs))


def _corners_on_road(scenario: Scenario) -> Bool[np.ndarray, "4 agent"]:
    """At the first valid step; none of pedestrians, who may be anywhere."""
    on_wheels = np.array([agent.kind != "pedestrian" for agent in scenario.agents])
    first = np.argmax(scenario.tracks.valid, axis=1)
    index = np.arange(len(scenario.agents))
    at_first = boxes.Boxes(*(v[index, first] for v in np.broadcast_arrays(*scenario.boxes)))
    return contains(scenario.road, boxes.corners(at_first), np.asarray(at_first.z)[:, None]).T & on_wheels
