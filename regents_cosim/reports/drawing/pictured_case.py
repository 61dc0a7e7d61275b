"""Draws one instant of a Scenario into a view: the road and everything that moves on it."""

import functools
from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.attack_record import Collision
from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.judgement import Manoeuvre
from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.palette import (
    ADVERSARY,
    BURST,
    EGO,
    EVASION,
    INK,
    LAND,
    OTHER,
    PANEL,
    ROAD,
    Colour,
    mix,
)
from regents_cosim.reports.drawing.road import draw_road, draw_signals
from regents_cosim.reports.drawing.vehicles import (
    Pose,
    draw_ghost,
    draw_planned_way,
    draw_tail,
    draw_trail,
    draw_vehicle,
)
from regents_cosim.scenario import Agent, Scenario, Tracks

_AFTER_COLLISION_S = 1.0  # motion after a crash is not simulated
_EVASION_S = 1.0  # between two outlines of an evading ego
_PULSE_S = 0.5  # duration of the growing ring around a contact
_TAIL_S = 1.0  # length of the tails of other road users
_BURST_PX, _RING_PX = 7.0, 15.0
_SPIKES = np.arange(16) * np.pi / 8
_STAR = np.stack([np.cos(_SPIKES), np.sin(_SPIKES)], axis=-1) * np.where(np.arange(16) % 2, 0.48, 1.0)[:, None]


@dataclass(frozen=True, eq=False)
class PicturedCase:
    """A Scenario, and the agents that its pictures are about."""

    scenario: Scenario
    adversary: str | None  # id of the agent drawn as the adversary

    @classmethod
    def of(cls, scenario: Scenario) -> "PicturedCase":
        """The pictured case of a scenario, with the agent in the role of the adversary."""
        return cls(scenario, next((a.id for a in scenario.agents if a.role == "adversary"), None))

    @property
    def collision(self) -> Collision | None:
        """The collision that the attack found."""
        return self.scenario.attack.collision if self.scenario.attack else None

    @property
    def gentlest(self) -> Manoeuvre | None:
        """The gentlest manoeuvre that avoids the collision, where one is known."""
        judged = self.scenario.judgement
        return judged.avoidability.gentlest if judged and judged.avoidability else None

    @property
    def last_step(self) -> int:
        """The step at which an animation stops: shortly after the collision, or at the end."""
        last = self.scenario.tracks.steps - 1
        if self.collision is None:
            return last
        return min(self.collision.step + round(_AFTER_COLLISION_S / self.scenario.dt), last)

    @property
    def shown_step(self) -> int:
        """The step of a still picture."""
        return self.scenario.tracks.steps - 1 if self.collision is None else self.collision.step

    @functools.cached_property
    def main(self) -> dict[int, Colour]:
        """Indices and colours of the agents that the picture is about: the adversary, if any, then the ego."""
        ids = [agent.id for agent in self.scenario.agents]
        found = {ids.index(self.adversary): ADVERSARY} if self.adversary in ids else {}
        return found | {0: EGO}

    def main_points(self) -> Float[np.ndarray, "time agent 2"]:
        """The positions of the main agents up to `last_step` [m], NaN where absent."""
        tracks, main = self.scenario.tracks, list(self.main)
        if self.collision and self.collision.agent != self.adversary:
            main.append(self._index(self.collision.agent))
        points = np.where(tracks.valid[main][..., None], _positions(tracks)[main], np.nan)
        return points[:, : self.last_step + 1].transpose(1, 0, 2)

    @functools.cached_property
    def contact_point(self) -> Float[np.ndarray, " 2"] | None:
        """The middle of the intersection of both boxes at the collision [m]."""
        if self.collision is None:
            return None
        return contact_point(
            self.scenario.agents, self.scenario.tracks, self._index(self.collision.agent), self.shown_step
        )

    def _index(self, name: str) -> int:
        return [agent.id for agent in self.scenario.agents].index(name)


def draw_ground(scene: PicturedCase, view: View, zoom: int) -> Canvas:
    """Draw everything static: the road, and the paths of ego and adversary before the attack."""
    canvas = Canvas.blank((view.width, view.height), zoom, LAND)
    draw_road(canvas, view, scene.scenario.road)
    log = scene.scenario.log
    if log is not None:
        points = _positions(log)
        for index, colour in scene.main.items():
            end = slice(scene.last_step + 1)
            draw_planned_way(canvas, view, points[index, end], log.valid[index, end], mix(ROAD, colour, 0.7))
    _draw_evasion(scene, canvas, view)
    return canvas


def _draw_evasion(scene: PicturedCase, canvas: Canvas, view: View) -> None:
    """Draw how the ego could have avoided the collision: its path from the onset on, and its outline once a second.

    One outline is at the time of the collision.
    """
    evasion, manoeuvre = scene.scenario.evasion, scene.gentlest
    if evasion is None or manoeuvre is None:
        return
    points = _positions(evasion)[0, manoeuvre.onset_step :]
    draw_planned_way(canvas, view, points, np.ones(len(points), bool), EVASION)
    every = max(round(_EVASION_S / scene.scenario.dt), 1)
    first = manoeuvre.onset_step + (scene.shown_step - manoeuvre.onset_step) % every
    for step in range(first, evasion.steps, every):
        draw_ghost(canvas, view, scene.scenario.ego, pose_at(evasion, 0, step), EVASION)


def draw_moving(scene: PicturedCase, canvas: Canvas, view: View, step: int) -> None:
    """Draw everything that changes, at `step`."""
    scenario = scene.scenario
    tracks = scenario.tracks
    points = _positions(tracks)
    draw_signals(canvas, view, scenario.road, scenario.signals, step)
    others = [index for index in np.flatnonzero(tracks.valid[:, step]).tolist() if index not in scene.main]
    first = max(step - round(_TAIL_S / scenario.dt), 0)
    for index in others:
        tail = points[index, first : step + 1][tracks.valid[index, first : step + 1]]
        draw_tail(canvas, view, tail, OTHER)
    for index, colour in scene.main.items():
        draw_trail(canvas, view, points[index], tracks.valid[index], colour, step)
    _draw_ghosts(scene, canvas, view, step)
    for index in [*others, *scene.main]:
        if tracks.valid[index, step]:
            pose = pose_at(tracks, index, step)
            colour = scene.main.get(index, OTHER)
            draw_vehicle(canvas, view, scenario.agents[index], pose, colour, index in scene.main)
    if scene.collision is not None and step >= scene.collision.step:
        _draw_contact(scene, canvas, view, (step - scene.collision.step) * scenario.dt)


def _draw_ghosts(scene: PicturedCase, canvas: Canvas, view: View, step: int) -> None:
    log = scene.scenario.log
    if log is None or step >= log.steps:
        return
    for index, colour in scene.main.items():
        if index > 0 and log.valid[index, step]:
            pose = pose_at(log, index, step)
            draw_ghost(canvas, view, scene.scenario.agents[index], pose, colour)


def _draw_contact(scene: PicturedCase, canvas: Canvas, view: View, since_s: float) -> None:
    """Draw a star, and a ring that grows around it."""
    place = scene.contact_point
    if place is None:
        return
    at = view.pixels(place)
    draw_burst(canvas, at, _BURST_PX)
    radius = _RING_PX * (0.65 + 0.35 * min(since_s / _PULSE_S, 1.0))
    canvas.ring(at, radius + 1.2, PANEL, 4.4)
    canvas.ring(at, radius, INK, 2.0)


def draw_burst(canvas: Canvas, at: Float[np.ndarray, " 2"], radius: float) -> None:
    """Draw the star that marks a collision."""
    canvas.polygon(at + (radius + 1.3) * _STAR, INK)
    canvas.polygon(at + radius * _STAR, BURST)


def contact_point(agents: tuple[Agent, ...], tracks: Tracks, hit: int, step: int) -> Float[np.ndarray, " 2"]:
    """The middle of the intersection of the boxes of the ego and of agent `hit` [m], or of the gap between them."""
    ego, other = (
        shapely.Polygon(corners(Boxes(*pose_at(tracks, index, step), agents[index].length, agents[index].width)))
        for index in (0, hit)
    )
    shared = shapely.intersection(ego, other)
    place = shapely.shortest_line(ego, other) if shared.is_empty else shared
    return shapely.get_coordinates(place.centroid)[0]


def pose_at(tracks: Tracks, index: int, step: int) -> Pose:
    """The pose of an agent at `step`."""
    return float(tracks.x[index, step]), float(tracks.y[index, step]), float(tracks.yaw[index, step])


def _positions(tracks: Tracks) -> Float[np.ndarray, "agent time 2"]:
    return np.stack([tracks.x, tracks.y], axis=-1)
