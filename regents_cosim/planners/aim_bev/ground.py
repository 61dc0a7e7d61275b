"""The static part of a bird's-eye view, drawn once per map: road surface, lane lines, edges, stop bars.

Cells of a fifth of a pixel (4 cm in the papers' view) hold exactly what is at their centre. A view samples the nearest
cell, so a line is never more than 3 cm off. (With a quarter of a pixel, 1.05 % of the pixels of a junction full of
lines differ from an exact raster.)
"""

import equinox as eqx
import numpy as np
import shapely
from jaxtyping import Array, Float, Int, UInt8
from shapely.geometry.base import BaseGeometry

from regents_cosim.geometry.rasters import MOST_CELLS, grid_shape, inside
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.mirror.programs.on_device import empty_for_device, handed_over, on_device, seen_from
from regents_cosim.mirror.separation import Box
from regents_cosim.planners.aim_bev.camera import PAPERS, Camera
from regents_cosim.scenario.scenario import Signal

LAND, SURFACE, LANE_LINE, EDGE_LINE = range(4)
DARK, RED, GREEN, AMBER = range(4)

_LIGHTS = {"r": RED, "s": RED, "y": AMBER, "Y": AMBER, "u": AMBER, "g": GREEN, "G": GREEN}
_BAR_M = 0.9  # thickness of a stop bar along the road
_BAR_SHARE = 0.84  # share of the lane's width
_SIZES = tuple(2**power for power in (22, 24, 25, 26))  # numbers of cells; few shapes need few compilations
_BARS = (8, 32, 128, 512)


class Ground(eqx.Module):
    """A map as cells, row 0 at the least y; several maps may share one array of cells."""

    cells: UInt8[Array, " cell"]  # LAND, SURFACE, LANE_LINE or EDGE_LINE
    first: Int[Array, "*axes"]  # index of the map's cell (0, 0)
    shape: Int[Array, "*axes 2"]  # rows, columns; the outermost rows and columns, and all beyond, are LAND
    corner: Float[Array, "*axes 2"]  # [m] position of cell (0, 0)


def draw_cells(
    road: RoadMap,
    low: Float[np.ndarray, " 2"],
    high: Float[np.ndarray, " 2"],
    camera: Camera = PAPERS,
    most: int = MOST_CELLS,
) -> UInt8[np.ndarray, "row column"]:
    """Draw `road` as cells for a `camera` between the corners `low` and `high` [m]; cell (0, 0) is centred at `low`.

    Drawing in strips saves memory. Raises ScenarioError for more than `most` cells.
    """
    shape = grid_shape(low, high, camera.cell_m, most)
    window = (*(low - 1.0), *(high + 1.0))
    edges = shapely.clip_by_rect(road.drivable.boundary, *window).buffer(0.5 * camera.edge_line_m)
    areas = ((SURFACE, road.drivable), (LANE_LINE, _lane_lines(road, window, camera.lane_line_m)), (EDGE_LINE, edges))
    cells = np.full(shape, LAND, np.uint8)
    rows = max(MOST_CELLS // shape[1], 1)  # per strip
    for first in range(0, shape[0], rows):
        strip, corner = cells[first : first + rows], low + np.array([0.0, first * camera.cell_m])
        for kind, area in areas:  # later areas cover earlier ones
            np.copyto(strip, np.uint8(kind), where=inside(area, corner, strip.shape, camera.cell_m))
    cells[[0, -1], :] = cells[:, [0, -1]] = LAND
    return cells


def to_ground(
    cells: UInt8[np.ndarray, "row column"], low: Float[np.ndarray, " 2"], origin: Float[np.ndarray, " 2"]
) -> Ground:
    """Put cells on the device; `low` [m, map frame] is the centre of cell (0, 0), `origin` that of the coordinates."""
    size = next((size for size in _SIZES if size >= cells.size), cells.size)
    padded = empty_for_device((size,), np.uint8)  # no cell beyond the map's own is ever read
    padded[: cells.size] = cells.ravel()
    return Ground(
        handed_over(padded),
        on_device(0, np.int32),
        on_device(cells.shape, np.int32),
        on_device(seen_from(low, origin), np.float32),
    )


def stop_bars(
    road: RoadMap, signals: tuple[Signal, ...], steps: int, origin: Float[np.ndarray, " 2"]
) -> tuple[Box, UInt8[Array, "time bar"]]:
    """Stop bars across signalled lanes, one part per connection, in coordinates less `origin` [m], and their lights."""
    shown = {signal.id: [signal.letters(k) for k in range(steps)] for signal in signals}
    parts, lights = [], []
    for lane in road.lanes:
        links = sorted({(link.signal, link.link) for link in road.exits[lane.id] if link.signal in shown})
        for (signal, link), part in zip(links, _parts(lane, len(links)), strict=True):
            parts.append(part)
            lights.append([_LIGHTS.get(letters[link], DARK) for letters in shown[signal]])
    size = next((size for size in _BARS if size >= len(parts)), len(parts))
    box = np.zeros((size, 6), np.float32)
    light = np.zeros((steps, size), np.uint8)
    if parts:
        box[: len(parts)] = np.array(parts)
        box[: len(parts), :2] = seen_from(np.array(parts)[:, :2], origin)
        light[:, : len(parts)] = np.array(lights, np.uint8).T
    return Box(*(on_device(values, np.float32) for values in box.T)), on_device(light, np.uint8)


def _parts(lane: Lane, count: int) -> list[tuple[float, ...]]:
    """`count` boxes side by side at the end of a lane, from the right, with the fields of Box."""
    ahead = lane.centre[-1] - lane.centre[-2]
    cos, sin = (ahead / np.hypot(*ahead)).tolist()
    middle = lane.centre[-1] - 0.5 * _BAR_M * np.array([cos, sin])
    half = 0.5 * _BAR_SHARE * lane.width / max(count, 1)
    places = [middle + (2 * index + 1 - count) * half * np.array([-sin, cos]) for index in range(count)]
    return [(*place.tolist(), cos, sin, 0.5 * _BAR_M, half) for place in places]


def _lane_lines(road: RoadMap, window: tuple[float, ...], width_m: float) -> BaseGeometry:
    """The area of all lane lines that may reach into `window`."""
    low_x, low_y, high_x, high_y = window
    near = road.centre_lines.query(shapely.box(low_x, low_y, high_x, high_y).buffer(5.0))
    lines = []
    for lane in (road.lanes[index] for index in near):
        centre = lane.line
        sides = (0.0,) if lane.junction else (-0.5 * lane.width, 0.5 * lane.width)
        lines += [centre if side == 0.0 else centre.offset_curve(side, join_style="mitre") for side in sides]
    return shapely.union_all([line.buffer(0.5 * width_m, cap_style="flat") for line in lines])
