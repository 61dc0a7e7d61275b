"""Packs numbers for the page of the report: integers, as differences, compressed."""

import base64
import gzip
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Bool, Float
from markupsafe import Markup

from regents_cosim.plain_text import printable
from regents_cosim.scenario.scenario import Tracks

CM, MM, MRAD = 0.01, 0.001, 0.001  # units [m], [m/s], [rad] of positions, speeds, headings

Spans = list[list[Any]]  # [first step, differences of each column ...] of every stretch without a gap


def packed(content: object) -> str:
    """JSON, compressed by gzip, as base64 text, which is safe in HTML."""
    return base64.b64encode(gzip.compress(msgspec.json.encode(content), 9, mtime=0)).decode()


def visible(content: Any) -> Any:
    """The `content` with invisible characters and those that change the writing direction as escapes."""
    if isinstance(content, Markup):
        return content
    if isinstance(content, str):
        return "\n".join(printable(line, None) for line in content.split("\n"))
    if isinstance(content, dict):
        return {visible(name): visible(value) for name, value in content.items()}
    if isinstance(content, (list, tuple)) and not all(isinstance(value, int) for value in content):
        return [visible(value) for value in content]
    return content


def differences(values: Float[np.ndarray, " point"], unit: float) -> list[int]:
    """The first value, then the differences, in whole units; rounding errors do not accumulate."""
    return np.diff(np.rint(np.asarray(values) / unit).astype(np.int64), prepend=0).tolist()


def line(points: Float[np.ndarray, "point 2"], origin: Float[np.ndarray, " 2"]) -> list[list[int]]:
    """Columns x, y [cm] relative to `origin`."""
    return [differences(column, CM) for column in (points - origin).T]


def motion(tracks: Tracks, agent: int, origin: Float[np.ndarray, " 2"]) -> Spans:
    """Columns x, y [cm], yaw [mrad], speed [mm/s] of one agent, where it is present."""
    x, y, yaw, speed = (values[agent] for values in (tracks.x, tracks.y, tracks.yaw, tracks.speed))
    return [
        [
            int(part[0]),
            *line(np.stack([x[part], y[part]], axis=-1), origin),
            differences(np.unwrap(yaw[part]), MRAD),
            differences(speed[part], MM),
        ]
        for part in stretches(tracks.valid[agent])
    ]


def gaps(metres: Float[np.ndarray, " time"], valid: Bool[np.ndarray, " time"]) -> Spans:
    """One column of distances [cm], where they are valid."""
    return [[int(part[0]), differences(metres[part], CM)] for part in stretches(valid)]


def stretches(valid: Bool[np.ndarray, " time"]) -> list[np.ndarray]:
    """The steps of each stretch of `valid` instants without a gap."""
    steps = np.flatnonzero(valid)
    return [part for part in np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if len(part)]
