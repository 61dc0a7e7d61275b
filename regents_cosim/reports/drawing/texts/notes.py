"""Texts in a picture: times and speeds, where a rule is broken, and where the careful driver brakes."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from regents_cosim.geometry.boxes import Boxes, corners
from regents_cosim.reports.drawing.camera import View
from regents_cosim.reports.drawing.canvas import Canvas, shorten
from regents_cosim.reports.drawing.palette import PANEL, SECOND, Colour, shade
from regents_cosim.reports.drawing.pictured_case import PicturedCase, Pose, RoadMark, pose_at
from regents_cosim.reports.drawing.texts.caption import EDGE_PX, called, plain
from regents_cosim.reports.drawing.texts.labels import LABEL_PX, Box, Label, PlacedLabel, place
from regents_cosim.scenario.scenario import boxes_of
from regents_cosim.verdicts.words import braking_words, kmh, offence_words

_MOST_SECONDS = 3  # most whole seconds of a path with a text
_BESIDE_PX = 50.0  # least distance of two of them
_NEAR_PX = 20.0  # greatest distance between one and its text
_MARK_PX = 6.0  # half the size of a mark
_CONTACT_PX = 18.0  # the same of that of a collision


class Note(NamedTuple):
    """A placed text that is shown from a step on."""

    step: int
    label: PlacedLabel


def film_notes(scene: PicturedCase, views: Sequence[View]) -> list[Note]:
    """The texts of a film, placed in its first view: they stay at their places on the map."""
    view, still = views[0], len(set(views)) == 1
    points = scene.main_points().reshape(-1, 2)
    free = [_around(_px(view, scene.contact_point), _CONTACT_PX)] if scene.contact_point is not None else []
    found = []
    for mark in scene.marks:
        placed = place(
            [_named(scene, view, mark)], (view.width, view.height) if still else None, free, view.pixels(points)
        )
        found += [Note(mark.step, one) for one in placed]
        free += [one.box for one in placed]
    return found


def draw_thought(canvas: Canvas, scene: PicturedCase, step: int) -> None:
    """Write what the planner says of its decision at `step` into the lower left corner."""
    if step in scene.debug and scene.debug[step].text:
        width, height = canvas.size
        words = shorten(plain(f"planner: {' '.join(scene.debug[step].text.split())}"), LABEL_PX, width - 2 * EDGE_PX)
        canvas.text((EDGE_PX, height - EDGE_PX), words, LABEL_PX, shade(SECOND), halo=PANEL)


def _named(scene: PicturedCase, view: View, mark: RoadMark) -> Label:
    return Label(_px(view, mark.pose), mark_words(scene, mark), shade(scene.mark_colour(mark)))


def mark_words(scene: PicturedCase, mark: RoadMark) -> str:
    """What a mark on the road means."""
    when = f"{mark.step * scene.scenario.dt:.1f} s"
    if mark.kind == "evades" and scene.careful is not None:
        return f"a careful driver {braking_words(scene.careful.shift_m)} from here, {scene.careful.acts_s:.1f} s"
    if mark.kind == "is_seen":
        return f"{when}: a careful driver sees it coming"
    if mark.kind == "enters_lane":
        return f"{when}: {called(mark.agent)} enters the ego's path"
    if mark.rule is not None:
        return f"{when}: {offence_words(mark.rule, f'the {called(not mark.agent)}')}"
    return f"{called(mark.agent)} has to give way here"


def still_notes(scene: PicturedCase, view: View, step: int, kept_free: Sequence[Box]) -> list[PlacedLabel]:
    """All texts of a still picture, placed off the boxes in `kept_free`."""
    scenario, tracks = scene.scenario, scene.scenario.tracks
    there = [index for index in scene.main if tracks.valid[index, step]]
    labels = [
        Label(_px(view, pose_at(tracks, i, step)), f"{called(i)} {kmh(tracks.speed[i, step])}", shade(scene.main[i]))
        for i in there
    ]
    labels += [_named(scene, view, mark) for mark in scene.marks]
    labels += [Label(_px(view, pose), words, shade(colour)) for pose, words, colour in _ghosts(scene, step)]
    labels += _seconds(scene, view, step)
    bodies = [pose_at(tracks, i, step) for i in there] + [pose for _, pose, _ in scene.ghosts(step)]
    sizes = [scenario.agents[i] for i in there] + [scenario.agents[i] for i, _, _ in scene.ghosts(step)]
    boxes = [_box(view, pose, one.length, one.width) for pose, one in zip(bodies, sizes, strict=True)]
    boxes += [_around(_px(view, mark.pose)) for mark in scene.marks]
    return place(labels, (view.width, view.height), [*kept_free, *boxes], _covered(scene, view, step))


def _ghosts(scene: PicturedCase, step: int) -> Iterator[tuple[Pose, str, Colour]]:
    when = f"{step * scene.scenario.dt:.1f} s"
    for index, pose, colour in scene.ghosts(step):
        if index:
            yield pose, f"{called(index)} without the attack, {when}", colour
        elif scene.scenario.evasion is not None:
            yield pose, f"careful driver at {when}: {kmh(scene.scenario.evasion.speed[0, step])}", colour


def _seconds(scene: PicturedCase, view: View, step: int) -> list[Label]:
    """Times and speeds on the paths, at the same times on both, not too close to each other."""
    tracks, found = scene.scenario.tracks, list[Label]()
    steps = list(scene.seconds(step))
    for index, colour in scene.main.items():
        last = np.array(_px(view, pose_at(tracks, index, step)))
        kept = 0
        for second in reversed(steps):
            at = np.array(_px(view, pose_at(tracks, index, second)))
            inside = 0 <= at[0] < view.width and 0 <= at[1] < view.height
            if kept < _MOST_SECONDS and inside and tracks.valid[index, second] and np.hypot(*(at - last)) >= _BESIDE_PX:
                words = f"{round(second * scene.scenario.dt)} s, {kmh(tracks.speed[index, second])}"
                found.append(Label((at[0], at[1]), words, shade(colour), _NEAR_PX))
                last, kept = at, kept + 1
    return found


def _covered(scene: PicturedCase, view: View, step: int) -> Float[np.ndarray, "point 2"]:
    """Points that texts rather leave free: the paths of the main road users, and all others [px]."""
    tracks = scene.scenario.tracks
    there = tracks.valid[:, step]
    points = [np.asarray(corners(boxes_of(scene.scenario.agents, tracks)))[there, step].reshape(-1, 2)]
    for index in scene.main:
        valid = tracks.valid[index, : step + 1]
        way = np.stack([tracks.x[index, : step + 1], tracks.y[index, : step + 1]], axis=-1)[valid]
        if len(np.unique(way, axis=0)) > 1:  # of one that stands the corners are enough
            line = shapely.segmentize(shapely.LineString(way), 10.0 / view.px_per_m)
            points.append(shapely.get_coordinates(line))
    return view.pixels(np.concatenate(points))


def _box(view: View, pose: Pose, length: float, width: float) -> Box:
    shape = view.pixels(np.asarray(corners(Boxes(*pose, length, width))))
    (left, top), (right, bottom) = shape.min(axis=0).tolist(), shape.max(axis=0).tolist()
    return left, top, right, bottom


def _around(at: tuple[float, float], reach: float = _MARK_PX) -> Box:
    return at[0] - reach, at[1] - reach, at[0] + reach, at[1] + reach


def _px(view: View, place_m: Pose | Float[np.ndarray, " 2"]) -> tuple[float, float]:
    x, y = view.pixels(np.array(place_m[:2])).tolist()
    return x, y
