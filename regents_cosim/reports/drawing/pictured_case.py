"""Draws one instant of a Scenario into a view: the road and everything that moves on it."""

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.norms.grades import GROSS_OFFENCES, OffenceName
from regents_cosim.planners.interface import Debug, DebugSteps
from regents_cosim.reports.crash_moments import enters_lane, give_way_line
from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas
from regents_cosim.reports.drawing.marks import (
    draw_bar,
    draw_burst,
    draw_debug,
    draw_give_way,
    draw_rule_broken,
    draw_second,
    draw_seen,
)
from regents_cosim.reports.drawing.palette import ADVERSARY, EGO, EVASION, INK, LAND, OTHER, PANEL, ROAD, Colour, mix
from regents_cosim.reports.drawing.road import draw_road, draw_signals
from regents_cosim.reports.drawing.vehicles import (
    Pose,
    draw_ghost,
    draw_planned_way,
    draw_tail,
    draw_trail,
    draw_vehicle,
)
from regents_cosim.scenario.attack_record import Collision
from regents_cosim.scenario.judgement import ReferenceDrive
from regents_cosim.scenario.scenario import Agent, Scenario, Tracks

_AFTER_COLLISION_S = 1.0  # motion after a crash is not simulated
_MOST_RULES = 2  # most broken rules that are marked, for each of the two
_PULSE_S = 0.5  # duration of the growing ring around a contact
_TAIL_S = 1.0  # length of the tails of other road users
_BACK_M = 1.2  # how far before a traffic light the line stands at which to give way
_LEAST_S = 0.3  # between the mark of a whole second and the end of a path
_BURST_PX, _RING_PX = 7.0, 15.0
_ON_FOOT_PX = 3.0  # how much larger the star is behind a person


class RoadMark(NamedTuple):
    """What is marked on the road from a step on.

    That is where one gives way or breaks a rule, where the adversary is when a careful driver sees the danger and when
    it enters the ego's path, and where that driver begins to brake.
    """

    kind: Literal["gives_way", "breaks_rule", "is_seen", "enters_lane", "evades"]
    step: int
    pose: Pose
    width: float  # [m] of the line across the way
    agent: int  # index of the road user
    rule: OffenceName | None = None

    @property
    def of_evasion(self) -> bool:
        """Whether it tells of the careful driver, not of what happened."""
        return self.kind in ("is_seen", "evades")


@dataclass(frozen=True, eq=False)
class PicturedCase:
    """A Scenario, and the agents that its pictures are about."""

    scenario: Scenario
    adversary: str | None  # id of the agent drawn as the adversary
    debug: Mapping[int, Debug] = field(default_factory=dict)  # what the planner thought, by step

    @classmethod
    def of(cls, scenario: Scenario, debug: DebugSteps = ()) -> "PicturedCase":
        """The pictured case of a scenario, with the agent in the role of the adversary."""
        return cls(scenario, next((a.id for a in scenario.agents if a.role == "adversary"), None), dict(debug))

    @property
    def collision(self) -> Collision | None:
        """The collision that the attack found."""
        return self.scenario.collision

    @property
    def careful(self) -> ReferenceDrive | None:
        """The careful driver whose evasion is shown; None where there is none."""
        judged = self.scenario.judgement
        return judged.careful if judged and self.scenario.evasion is not None else None

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

    def colour(self, index: int) -> Colour:
        """The colour of an agent."""
        return self.main.get(index, OTHER)

    def ghosts(self, step: int) -> Iterator[tuple[int, Pose, Colour]]:
        """Index, pose and colour of the outlines: of the adversary in its log, and of the careful driver."""
        log, evasion, onset = self.scenario.log, self.scenario.evasion, self.scenario.evades_from
        if log is not None and step < log.steps:
            yield from ((i, pose_at(log, i, step), self.main[i]) for i in self.main if i > 0 and log.valid[i, step])
        if evasion is not None and onset is not None and onset < step < evasion.steps:
            yield 0, pose_at(evasion, 0, step), EVASION

    def main_points(self) -> Float[np.ndarray, "time agent 2"]:
        """The positions of the main agents up to `last_step` [m], NaN where absent."""
        tracks, main = self.scenario.tracks, list(self.main)
        if self.collision and self.collision.agent != self.adversary:
            main.append(self.scenario.index(self.collision.agent))
        points = np.where(tracks.valid[main][..., None], _positions(tracks)[main], np.nan)
        return points[:, : self.last_step + 1].transpose(1, 0, 2)

    @functools.cached_property
    def marks(self) -> tuple[RoadMark, ...]:
        """What is marked on the road: where the careful driver brakes, then what the two in the collision do."""
        found, onset, evasion, dt = [], self.scenario.evades_from, self.scenario.evasion, self.scenario.dt
        if onset is not None and evasion is not None:
            found.append(RoadMark("evades", onset, pose_at(evasion, 0, onset), self.scenario.ego.width, 0))
        if self.collision is None:
            return tuple(found)
        last, other = self.collision.step, self.scenario.index(self.collision.agent)
        law = self.scenario.judgement.law if self.scenario.judgement else None
        line = give_way_line(self.scenario, other, last)
        if line is not None:
            back = _BACK_M * bool(self.scenario.signals)
            x, y = (line.middle - back * np.array([np.cos(line.heading), np.sin(line.heading)])).tolist()
            found.append(RoadMark("gives_way", 0, (x, y, line.heading), line.width, line.agent))
        for agent, offences in ((other, law.adversary), (0, law.ego)) if law else ():
            marked = [one for one in offences if one.name != "gives_no_way" or line is None]
            marked.sort(key=lambda one: (one.name not in GROSS_OFFENCES, one.time_s))
            for one in marked[:_MOST_RULES]:
                step = min(round(one.time_s / dt), last)
                pose = pose_at(self.scenario.tracks, agent, step)
                found.append(RoadMark("breaks_rule", step, pose, 0.0, agent, one.name))
        if (step := self.enters_lane) is not None:
            pose = pose_at(self.scenario.tracks, other, step)
            found.append(RoadMark("enters_lane", step, pose, self.scenario.agents[other].width, other))
        return (*self._seen(other), *found)

    @functools.cached_property
    def enters_lane(self) -> int | None:
        """The step at which the road user that the ego hits enters its lane; None where it does not."""
        return enters_lane(self.scenario)

    def _seen(self, other: int) -> Iterator[RoadMark]:
        """Where the adversary is when the careful driver, if shown, sees the danger."""
        drive = self.careful
        if drive is not None and drive.perceives_s is not None:
            step = round(drive.perceives_s / self.scenario.dt)
            yield RoadMark("is_seen", step, pose_at(self.scenario.tracks, other, step), 0.0, other)

    def mark_colour(self, mark: RoadMark) -> Colour:
        """The colour of a mark: that of the road user, or of the careful driver."""
        return EVASION if mark.of_evasion else self.colour(mark.agent)

    def seconds(self, until: int) -> Iterator[int]:
        """The steps of whole seconds before step `until`, with room before it."""
        dt = self.scenario.dt
        yield from (round(second / dt) for second in range(1, int((until * dt - _LEAST_S) // 1) + 1))

    @functools.cached_property
    def contact_point(self) -> Float[np.ndarray, " 2"] | None:
        """The middle of the intersection of both boxes at the collision [m]."""
        if self.collision is None:
            return None
        return contact_point(
            self.scenario.agents, self.scenario.tracks, self.scenario.index(self.collision.agent), self.shown_step
        )


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
    if (evasion := scene.scenario.evasion) is not None:
        way = _positions(evasion)[0, scene.scenario.evades_from :]
        draw_planned_way(canvas, view, way, np.ones(len(way), bool), EVASION)
    return canvas


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
    if step in scene.debug:
        draw_debug(canvas, view, scene.debug[step])
    for index in others:
        _draw_road_user(scene, canvas, view, step, index)
    _draw_marks(scene, canvas, view, step)
    for index, pose, colour in scene.ghosts(step):
        draw_ghost(canvas, view, scenario.agents[index], pose, colour)
    for index in scene.main:
        _draw_road_user(scene, canvas, view, step, index)
    if scene.collision is not None and step >= scene.collision.step:
        _draw_contact(scene, canvas, view, (step - scene.collision.step) * scenario.dt)
        for index in scene.main:
            if scenario.agents[index].kind == "pedestrian":  # which the star would hide
                _draw_road_user(scene, canvas, view, step, index)


def _draw_road_user(scene: PicturedCase, canvas: Canvas, view: View, step: int, index: int) -> None:
    tracks = scene.scenario.tracks
    if tracks.valid[index, step]:
        colour, main = scene.colour(index), index in scene.main
        draw_vehicle(canvas, view, scene.scenario.agents[index], pose_at(tracks, index, step), colour, main)


def _draw_marks(scene: PicturedCase, canvas: Canvas, view: View, step: int) -> None:
    """Draw whole seconds, and what else is marked on the road so far."""
    tracks = scene.scenario.tracks
    for index, colour in scene.main.items():
        for second in scene.seconds(min(step, scene.shown_step)):
            if tracks.valid[index, second]:
                draw_second(canvas, view.pixels(np.array(pose_at(tracks, index, second)[:2])), colour)
    for mark in scene.marks:
        if step >= mark.step:
            _draw_mark(scene, canvas, view, mark)


def _draw_mark(scene: PicturedCase, canvas: Canvas, view: View, mark: RoadMark) -> None:
    at, heading, colour = np.array(mark.pose[:2]), mark.pose[2], scene.mark_colour(mark)
    if mark.kind == "breaks_rule":
        draw_rule_broken(canvas, view.pixels(at), colour)
    elif mark.kind == "is_seen":
        draw_seen(canvas, view.pixels(at), colour)
    elif mark.kind in ("evades", "enters_lane"):
        draw_bar(canvas, view, at, heading, mark.width, colour)
    else:
        draw_give_way(canvas, view, at, heading, mark.width, colour)


def _draw_contact(scene: PicturedCase, canvas: Canvas, view: View, since_s: float) -> None:
    place = scene.contact_point
    if place is None:
        return
    at = view.pixels(place)
    on_foot = any(scene.scenario.agents[index].kind == "pedestrian" for index in scene.main)
    draw_burst(canvas, at, _BURST_PX + _ON_FOOT_PX * on_foot)
    radius = (_RING_PX + _ON_FOOT_PX * on_foot) * (0.65 + 0.35 * min(since_s / _PULSE_S, 1.0))
    canvas.ring(at, radius + 1.2, PANEL, 4.4)
    canvas.ring(at, radius, INK, 2.0)


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
