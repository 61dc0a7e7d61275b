"""Draws a picture per exhibit: the scene before the attack and after each, the distances, the costs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from benchmarks.gallery.chart import Line, draw_chart
from benchmarks.gallery.exhibits import METHOD_NAMES, ExhibitRun
from regents_cosim.geometry.boxes import Boxes, overlap
from regents_cosim.reports.drawing.camera import View, centred
from regents_cosim.reports.drawing.canvas import Canvas, shorten
from regents_cosim.reports.drawing.palette import FAINT_INK, HAIRLINE, INK, OTHER, PANEL, ROAD, Colour, mix
from regents_cosim.reports.drawing.pictured_case import PicturedCase, draw_ground, draw_moving, pose_at
from regents_cosim.reports.drawing.texts.caption import ending
from regents_cosim.reports.drawing.vehicles import draw_vehicle
from regents_cosim.reports.picture import draw_footer, footer_height
from regents_cosim.scenario.scenario import Scenario, boxes_of

WIDTH_PX = 1200
METHOD_COLOURS: dict[str, Colour] = {"king": (178, 58, 128), "regents": (0, 138, 100), "focused": (52, 58, 150)}

_ZOOM = 3
_GAP_PX = 4
_HEADER_PX = 52
_STRIP_PX = 48
_CHART_PX = 250
_EDGE_PX = 16
_MARGIN_M = (7.0, 5.0)  # around the vehicles, along x and y
_CLOSEST_PX_PER_M = 11.0
_WIDE = 2.4  # scenes that are wider than that, compared with their height, lie below each other
_EVERY_S = 1.0  # between the earlier positions shown
_FAINT = 0.32  # share of their colour
_ROOF_M = 0.6  # behind the middle of a car
_NUMBER_M = 1.2  # room that a number takes
_STILL_M = 0.5  # none that moved less away from the log is taken for the adversary
_MEAN = "mean over time"
_SOFT = "soft minimum over time"


def draw_exhibit(run: ExhibitRun) -> Canvas:
    """The whole picture."""
    panels = _panels(run)
    columns, size, view = _arrangement(panels)
    rows = -(-len(panels) // columns)
    body_height = rows * (_STRIP_PX + size[1]) + (rows - 1) * _GAP_PX
    shown = next((panel.scene for panel in panels if panel.scene.collision), panels[-1].scene)
    footer = draw_footer(shown, view, WIDTH_PX, _ZOOM)
    height = _HEADER_PX + body_height + _GAP_PX + _CHART_PX + footer_height(shown, WIDTH_PX)
    canvas = Canvas.blank((WIDTH_PX, height), _ZOOM, HAIRLINE)
    canvas.paste(_header(run), 0, 0)
    for place, panel in enumerate(panels):
        left = place % columns * (size[0] + _GAP_PX)
        top = _HEADER_PX + place // columns * (_STRIP_PX + size[1] + _GAP_PX)
        canvas.paste(panel.draw_title(size[0]), left, top)
        canvas.paste(panel.draw(view), left, top + _STRIP_PX)
    top = _HEADER_PX + body_height + _GAP_PX
    half = (WIDTH_PX - _GAP_PX) // 2
    canvas.paste(_distance_chart(run, (half, _CHART_PX)), 0, top)
    canvas.paste(_cost_chart(run, (half, _CHART_PX)), half + _GAP_PX, top)
    canvas.paste(footer, 0, top + _CHART_PX)
    return canvas


# --- the scene, once per method ---------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _ScenePanel:
    """A scene with its title, which shows the motion from step `first` to step `last`."""

    title: str
    note: str
    colour: Colour
    scene: PicturedCase
    first: int
    last: int

    def points(self) -> Float[np.ndarray, "point 2"]:
        """The positions of the agents that the picture is about [m]."""
        tracks, main = self.scene.scenario.tracks, list(self.scene.main)
        shown = slice(self.first, self.last + 1)
        return np.stack([tracks.x[main, shown], tracks.y[main, shown]], axis=-1).reshape(-1, 2)

    def draw_title(self, width: int) -> Canvas:
        """How it ended, and what to look for."""
        canvas = Canvas.blank((width, _STRIP_PX), _ZOOM, PANEL)
        canvas.text((_EDGE_PX, 20), shorten(self.title, 14, width - 2 * _EDGE_PX), 14, self.colour, bold=True)
        canvas.text((_EDGE_PX, 38), shorten(self.note, 13, width - 2 * _EDGE_PX), 13, FAINT_INK)
        return canvas

    def draw(self, view: View) -> Canvas:
        """The road, all agents at every second, and at the last instant."""
        canvas = draw_ground(self.scene, view, _ZOOM)
        stride = round(_EVERY_S / self.scene.scenario.dt)
        for step in range(0, self.last, stride):
            self._draw_earlier(canvas, view, step)
        draw_moving(self.scene, canvas, view, self.last)
        self._draw_seconds(canvas, view, stride)
        return canvas

    def _draw_earlier(self, canvas: Canvas, view: View, step: int) -> None:
        scenario = self.scene.scenario
        for index in self._present(step):
            colour = mix(ROAD, self.scene.main.get(index, OTHER), _FAINT)
            draw_vehicle(canvas, view, scenario.agents[index], pose_at(scenario.tracks, index, step), colour, False)

    def _draw_seconds(self, canvas: Canvas, view: View, stride: int) -> None:
        """The time on every earlier roof, unless one at the last instant or another number is there."""
        tracks, agents = self.scene.scenario.tracks, self.scene.scenario.agents
        boxes = [np.broadcast_to(v, tracks.x.shape)[:, self.last] for v in boxes_of(agents, tracks)]
        taken: list[Boxes] = []
        for step in range(0, self.last, stride):
            for index in self._present(step):
                x, y, yaw = pose_at(tracks, index, step)
                roof = Boxes(x - _ROOF_M * np.cos(yaw), y - _ROOF_M * np.sin(yaw), 0.0, _NUMBER_M, _NUMBER_M)
                if np.any(overlap(roof, Boxes(*boxes))) or any(overlap(roof, other) for other in taken):
                    continue
                taken.append(roof)
                across, down = view.pixels(np.array([roof.x, roof.y])).tolist()
                canvas.text((across, down + 4), f"{step // stride * _EVERY_S:g}", 11, INK, "ms")

    def _present(self, step: int) -> list[int]:
        return np.flatnonzero(self.scene.scenario.tracks.valid[:, step]).tolist()


def _panels(run: ExhibitRun) -> list[_ScenePanel]:
    log, notes = run.exhibit.scenario, run.exhibit.notes
    first, last = (round(second / log.dt) for second in run.exhibit.seconds)
    panels = [_ScenePanel("before the attack", notes["log"], INK, PicturedCase(log, run.exhibit.watched), first, last)]
    for method, attacked in run.attacked.items():
        scene = PicturedCase(attacked, _adversary(run, method))
        end = min(last, scene.collision.step if scene.collision else last)
        panels.append(_ScenePanel(_title(method, attacked), notes[method], METHOD_COLOURS[method], scene, first, end))
    return panels


def _title(method: str, attacked: Scenario) -> str:
    record = attacked.attack
    words = ending(record.outcome, record.collision) if record else []
    iterations = f"{record.iterations} iterations" if record else ""
    return f"{METHOD_NAMES[method]}: {' · '.join([*words, iterations])}"


def _adversary(run: ExhibitRun, method: str) -> str | None:
    """The agent that the ego hits, otherwise the one that the attack moved most."""
    agents = run.attacked[method].agents
    hit = next((agent.id for agent in agents if agent.role == "adversary"), None)
    most = max((agent.id for agent in agents[1:]), key=lambda agent: run.moved(method, agent))
    return hit or (most if run.moved(method, most) > _STILL_M else None)


def _arrangement(panels: list[_ScenePanel]) -> tuple[int, tuple[int, int], View]:
    """Columns, the size of each scene [px], and the view that all of them share."""
    points = np.concatenate([panel.points() for panel in panels])
    low, high = points.min(axis=0) - _MARGIN_M, points.max(axis=0) + _MARGIN_M
    wide, tall = high - low
    columns = 1 if wide / tall > _WIDE else 2
    width = (WIDTH_PX - (columns - 1) * _GAP_PX) // columns
    scale = min(width / wide, _CLOSEST_PX_PER_M)
    size = (width, round(tall * scale))
    return columns, size, centred(0.5 * (low + high), scale, size)


# --- words and charts -------------------------------------------------------------------------


def _header(run: ExhibitRun) -> Canvas:
    canvas = Canvas.blank((WIDTH_PX, _HEADER_PX), _ZOOM, PANEL)
    used = canvas.text((_EDGE_PX, 33), run.exhibit.title, 20, INK, bold=True)
    words = "the ego replays its log · numbers: seconds · shown up to the collision, or to "
    words += f"{run.exhibit.seconds[1]:g} s"
    canvas.text((WIDTH_PX - _EDGE_PX, 33), shorten(words, 13, WIDTH_PX - used - 3 * _EDGE_PX), 13, FAINT_INK, "rs")
    return canvas


def _distance_chart(run: ExhibitRun, size: tuple[int, int]) -> Canvas:
    dt = run.exhibit.scenario.dt
    lines = [Line("before the attack", run.gap(), dt, FAINT_INK, 1.5, dashed=True)]
    for method, attacked in run.attacked.items():
        hit = attacked.collision
        with_watched = hit is not None and hit.agent == run.exhibit.watched
        gap = run.gap(method)[: hit.step + 1] if hit else run.gap(method)
        lines.append(_line(method, METHOD_NAMES[method], gap, dt, with_watched))
    return draw_chart(f"distance of {run.exhibit.watched_name} to the ego [m]", "time [s]", lines, size, _ZOOM)


def _cost_chart(run: ExhibitRun, size: tuple[int, int]) -> Canvas:
    lines = []
    for method, attacked in run.attacked.items():
        record = attacked.attack
        if record is not None and record.iterations:
            pooled = _SOFT if record.settings["softmin_m"] else _MEAN
            costs = np.array(record.cost_history["ego"])
            label = f"{METHOD_NAMES[method]} ({pooled})"
            lines.append(_line(method, label, costs, 1.0, record.outcome == "collision"))
    return draw_chart("cost that pulls to the ego, C_ego_col [m]", "iteration", lines, size, _ZOOM)


def _line(method: str, label: str, values: Float[np.ndarray, " point"], step: float, hit: bool) -> Line:
    """KING's is broad, so that one that lies on it can be seen as well."""
    colour = METHOD_COLOURS[method]
    if method == "king":
        return Line(label, values, step, mix(PANEL, colour, 0.55), 5.0, ends_in_contact=hit)
    return Line(label, values, step, colour, 2.0, ends_in_contact=hit)
