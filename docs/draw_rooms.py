"""Draw which room of the package imports from which, for CONTRIBUTING.md: python docs/draw_rooms.py.

The rows are the layers of `pyproject.toml`, and the arrows the imports of the code. An arrow that follows from others
is left out.
"""

import ast
import tomllib
from collections import defaultdict
from pathlib import Path

import numpy as np

from regents_cosim.reports.drawing.canvas import Canvas, png_bytes
from regents_cosim.reports.drawing.palette import EGO, FAINT_INK, PANEL
from regents_cosim.system.files.output_files import write_output_file

_ROOT = Path(__file__).parents[1]
_PACKAGE = "regents_cosim"
_WIDTH, _ROW, _BOX, _TOP = 940, 56, 26, 20

Imports = dict[str, set[str]]


def layers() -> list[list[str]]:
    """Rooms by layer, the highest first: a room imports from the layers below its own."""
    contracts = tomllib.loads((_ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rows = next(one["layers"] for one in contracts if one["type"] == "layers" and "containers" not in one)
    return [[name.strip().removeprefix(f"{_PACKAGE}.") for name in row.split("|")] for row in rows]


def imports() -> Imports:
    """The rooms that each room imports from; a module beside the rooms counts as one."""
    found: Imports = defaultdict(set)
    folder = _ROOT / _PACKAGE
    for path in sorted(folder.rglob("*.py")):
        room = path.relative_to(folder).parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(f"{_PACKAGE}."):
                found[room].add(str(node.module).split(".")[1])
    return found


def without_detours(found: Imports, rows: list[list[str]]) -> Imports:
    """The imports that do not follow from others, of rooms that are in a layer; none upwards."""
    level = {room: number for number, row in enumerate(rows) for room in row}
    down = {room: {to for to in found[room] if to in level and level[to] > level[room]} for room in level}
    reached: Imports = {}
    for room in sorted(level, key=lambda one: -level[one]):
        reached[room] = down[room].union(*(reached[to] for to in down[room]))
    return {room: to - set().union(*(reached[one] for one in to)) for room, to in down.items()}


def draw() -> bytes:
    """The figure, as a PNG."""
    rows = layers()
    canvas = Canvas.blank((_WIDTH, _TOP + _ROW * len(rows)), 2, PANEL)
    wide = {room: 16.0 + 8.5 * len(room) for row in rows for room in row}
    places = {}
    for number, row in enumerate(rows):
        between = (_WIDTH - sum(wide[room] for room in row)) / (len(row) + 1)
        left = between
        for room in row:
            places[room] = (left + wide[room] / 2, _TOP + _ROW * number)
            left += wide[room] + between
    for room, below in without_detours(imports(), rows).items():
        for to in sorted(below):
            (x, y), (to_x, to_y) = places[room], places[to]
            canvas.line(np.array([[x, y + _BOX], [to_x, to_y]]), FAINT_INK, 1)
            canvas.disc(np.array([to_x, to_y]), 3, FAINT_INK)
    for room, (x, y) in places.items():
        canvas.box(x - wide[room] / 2, y, x + wide[room] / 2, y + _BOX, EGO)
        canvas.text((x, y + 18), room, 14, PANEL, "ms", bold=True)
    return png_bytes(canvas.image)


if __name__ == "__main__":
    write_output_file(Path(__file__).with_name("rooms.png"), draw())
