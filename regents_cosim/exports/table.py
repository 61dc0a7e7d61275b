"""Writes a table of tracks, one row per agent and step, and the mapping of its columns beside it.

Box centres in the map's frame, SI units, yaw counter-clockwise from +x. Controls hold from their row to the next one,
and are empty where only the motion is known; the lane is empty where none runs along.
"""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

from regents_cosim.exports.lights import without_place
from regents_cosim.exports.stays import Presence, lanes_along, poses, stays
from regents_cosim.scenario.scenario import Scenario

COLUMNS = (
    "time_s", "id", "kind", "role", "x_m", "y_m", "yaw_rad", "speed_m_s", "accel_m_s2", "curvature_1_m",
    "length_m", "width_m", "lane", "z_m",
)  # fmt: skip
_READ_BACK = {
    "id": "id", "time": "time_s", "x": "x_m", "y": "y_m", "heading": "yaw_rad", "speed": "speed_m_s",
    "length": "length_m", "width": "width_m", "kind": "kind",
}  # fmt: skip


def write_table(scenario: Scenario, folder: Path) -> list[str]:
    """Write `tracks.csv`, and `tracks.toml` for reading it back (`record --log`); returns what is left out, as
    messages.
    """
    with (folder / "tracks.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for stay in stays(scenario):
            writer.writerows(_rows(scenario, stay))
    columns = [f"{ours} = {json.dumps(theirs)}" for ours, theirs in _READ_BACK.items()]
    ego = f"ego = {json.dumps(scenario.ego.id, ensure_ascii=False)}"
    left_out = without_place(scenario, ())
    said = [f"# {line}" for line in left_out]
    (folder / "tracks.toml").write_text("\n".join([*said, ego, "", "[columns]", *columns, ""]), encoding="utf-8")
    return left_out


def track_rows(scenario: Scenario) -> list[dict[str, object]]:
    """The rows of `tracks.csv` by column name; None for empty fields."""
    cells = (row for stay in stays(scenario) for row in _rows(scenario, stay))
    return [{name: None if cell == "" else cell for name, cell in zip(COLUMNS, row, strict=True)} for row in cells]


def _rows(scenario: Scenario, stay: Presence) -> Iterator[tuple[object, ...]]:
    agent, motion = stay.agent, poses(scenario, stay)
    z = scenario.tracks.z[stay.index, stay.steps]
    lanes = lanes_along(scenario, motion[:, :2], z)
    for k, (x, y, yaw, speed) in enumerate(motion.tolist()):
        step = stay.first + k
        yield (
            round(step * scenario.dt, 9), agent.id, agent.kind, agent.role, x, y, yaw, speed,
            *_controls(scenario, stay, step), agent.length, agent.width, lanes[k], float(z[k]),
        )  # fmt: skip


def _controls(scenario: Scenario, stay: Presence, step: int) -> tuple[float | str, float | str]:
    """Acceleration [m/s^2] and curvature [1/m] until the next step; empty where unknown."""
    tracks = scenario.tracks
    if tracks.accel is None or tracks.curvature is None or step == stay.last:
        return "", ""
    return float(tracks.accel[stay.index, step]), float(tracks.curvature[stay.index, step])
