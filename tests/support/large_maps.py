"""Honest maps of any size, as lanelet2 and Argoverse 2 write them: streets beside each other, of two lanes each.

A street is cut into pieces of 100 m, each of which leads into the next one.
"""

import json
from collections.abc import Iterator

import numpy as np

_PIECE_M, _LANE_M, _APART_M, _PIECES, _POINTS = 100.0, 3.5, 40.0, 100, 11
_LANES = 2  # of a street, which both run east


def _bounds(lanes: int) -> Iterator[tuple[int, int, list[np.ndarray]]]:
    """Street and number of every piece, and the lines that bound its lanes, from left to right."""
    for piece in range(lanes // _LANES):
        street, number = divmod(piece, _PIECES)
        x = _PIECE_M * (number + np.linspace(0.0, 1.0, _POINTS))
        bend = 5.0 * np.sin(0.01 * x)
        yield (
            street,
            number,
            [np.column_stack([x, _APART_M * street + bend - _LANE_M * line]) for line in range(_LANES + 1)],
        )


def lanelet2(lanes: int) -> bytes:
    """A map in metres. Lanelets share nodes with those before and behind, and ways with those beside."""
    nodes: dict[tuple[int, int, int], int] = {}
    text: list[str] = []
    ways, relations = [], []
    for street, number, lines in _bounds(lanes):
        for line, points in enumerate(lines):
            refs = []
            for point, (x, y) in enumerate(points.tolist()):
                key = (street, (_POINTS - 1) * number + point, line)
                if key not in nodes:
                    nodes[key] = len(nodes)
                    text.append(f"<node id='{nodes[key]}' x='{x:.3f}' y='{y:.3f}'/>")
                refs.append(f"<nd ref='{nodes[key]}'/>")
            ways.append(f"<way id='w{street}-{number}-{line}'>{''.join(refs)}</way>")
        for lane in range(_LANES):
            members = "".join(
                f"<member type='way' role='{side}' ref='w{street}-{number}-{lane + right}'/>"
                for right, side in enumerate(("left", "right"))
            )
            name = f"{street}-{number}-{lane}"
            relations.append(f"<relation id='{name}'>{members}<tag k='type' v='lanelet'/></relation>")
    return f"<osm>{''.join([*text, *ways, *relations])}</osm>".encode()


def argoverse2(lanes: int) -> bytes:
    """A `log_map_archive_*.json` of the same streets, each a drivable area."""
    segments, areas = {}, {}
    for street, number, lines in _bounds(lanes):
        first = _LANES * (_PIECES * street + number)
        sides = [[{"x": x, "y": y, "z": 0.0} for x, y in line.round(3).tolist()] for line in lines]
        areas[str(first)] = {"area_boundary": sides[0] + sides[-1][::-1]}
        for lane in range(_LANES):
            segments[str(first + lane)] = {
                "id": first + lane, "lane_type": "VEHICLE", "left_lane_boundary": sides[lane],
                "right_lane_boundary": sides[lane + 1],
                "successors": [first + lane + _LANES] if number + 1 < _PIECES else [],
                "left_neighbor_id": first if lane else None, "right_neighbor_id": None if lane else first + 1,
            }  # fmt: skip
    return json.dumps({"lane_segments": segments, "drivable_areas": areas}).encode()
