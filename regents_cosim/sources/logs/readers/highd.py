"""highD and AD4CHE: motorways from above (25 and 30 Hz), three CSV files per recording.

x and y are the upper left corner of a box in the image, whose y-axis points down; `width` is the length and `height`
the width. Headings follow from the velocities, for standing vehicles from the driving direction. The lane markings of
the recording are its map: one carriageway to the left (direction 1), one to the right (direction 2). There is no ego.

In AD4CHE, of Chinese motorways, x and y are the centre of a box, and `orientation` is the angle from the x-axis of the
image to the box, towards the y-axis. The driving direction tells which end of the box is the front.
"""

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import shapely

from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import from_image_corner, wrap
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.files.csv_columns import header_of, read_columns
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat, head_of
from regents_cosim.sources.logs.readers.levelx import companion, frame_rate, kinds_by_number, scene_of
from regents_cosim.sources.logs.rows import Rows, require_steps, steps_of_frames
from regents_cosim.sources.logs.scene import LoggedLane, LoggedMap, LoggedScene

_NUMBERS = ("id", "frame", "x", "y", "width", "height", "xVelocity", "yVelocity")
_MORE = (
    "xAcceleration", "yAcceleration", "frontSightDistance", "backSightDistance", "dhw", "thw", "ttc",
    "precedingXVelocity", "precedingId", "followingId", "leftPrecedingId", "leftAlongsideId", "leftFollowingId",
    "rightPrecedingId", "rightAlongsideId", "rightFollowingId", "laneId",
)  # fmt: skip
_OF_AD4CHE = {"orientation", "yaw_rate", "ego_offset"}
_MOTORWAY_MPS = 36.1  # recommended speed on motorways without a limit
_CRAWL_MPS = 0.5  # below this speed, velocities do not tell the heading


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the recording of one `NN_tracks.csv`."""
    _require_known_columns(path, "highD", {*_NUMBERS, *_MORE})
    yield _recording(path, read_columns(path, _NUMBERS).numbers)


def read_ad4che(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the recording of one `NN_tracks.csv` of AD4CHE."""
    _require_known_columns(path, "AD4CHE", {*_NUMBERS, *_MORE, *_OF_AD4CHE})
    yield _recording(path, read_columns(path, [*_NUMBERS, "orientation"]).numbers)


def _recording(path: Path, numbers: dict[str, np.ndarray]) -> LoggedScene:
    """The scene of these columns. x and y are corners of upright boxes; with orientations they are centres."""
    about = read_columns(
        companion(path, "recordingMeta"), ("frameRate", "speedLimit"), ("upperLaneMarkings", "lowerLaneMarkings"),
        ("speedLimit",),
    )  # fmt: skip
    rate = frame_rate(path, about)
    who = require_steps(numbers["id"], path)
    at = steps_of_frames(numbers["frame"], who, path)
    length, width = numbers["width"], numbers["height"]
    kinds, to_the_left = _about_tracks(companion(path, "tracksMeta"))
    along = np.where(np.isin(who, list(to_the_left)), np.pi, 0.0)
    along = np.where(np.isin(who, list(kinds)), along, np.nan)
    speed = np.hypot(numbers["xVelocity"], numbers["yVelocity"])
    yaw = np.where(speed > _CRAWL_MPS, np.arctan2(-numbers["yVelocity"], numbers["xVelocity"]), along)
    if "orientation" not in numbers:
        x, y = from_image_corner(numbers["x"], numbers["y"], length, width)
    else:
        x, y = numbers["x"], -numbers["y"]
        yaw = _end_ahead(-numbers["orientation"], np.where(np.isnan(along), yaw, along))
    kind = np.array([kinds.get(number, "car") for number in who.tolist()], object)
    limit = float(about.numbers["speedLimit"][0]) if "speedLimit" in about.numbers else -1.0
    marks = [_marks(about.texts[f"{side}LaneMarkings"][0]) for side in ("upper", "lower")]
    road = _road(marks, float(np.min(x)), float(np.max(x)), limit if limit > 0 else _MOTORWAY_MPS)
    rows = Rows(who, at.step, np.asarray(x), np.asarray(y), yaw, kind, length, width, late=at.late)
    return scene_of(path, rate, rows, at, road)


def _end_ahead(axis: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """The direction along the `axis` of a box that is nearer to `ahead` [rad]."""
    off = wrap(axis - ahead)
    return np.asarray(wrap(np.where(np.abs(off) > 0.5 * np.pi, axis + np.pi, axis)))


def _require_known_columns(path: Path, name: str, known: set[str]) -> None:
    """Raise LogError for columns of another data set: only the columns tell whether x and y are corners or centres."""
    others = sorted(set(header_of(head_of(path))) - known)
    if others:
        raise LogError(
            f"{path}: {', '.join(others)[:100]} is not a column of {name}, so x and y may be another point of the box "
            "(describe the file with a mapping, and name that file by `columns`, with `format` table)"
        )


def _about_tracks(path: Path) -> tuple[dict[int, Kind], set[int]]:
    """Kinds by id, and the ids of vehicles that drive to the left."""
    table = read_columns(path, ("id", "drivingDirection"), ("class",))
    kinds = kinds_by_number(path, table, "id")
    ids = require_steps(table.numbers["id"], path)
    return kinds, set(ids[table.numbers["drivingDirection"] == 1].tolist())


def _marks(text: str) -> list[float]:
    """The y of the markings of a carriageway [m], positive upwards, from top to bottom."""
    found = sorted(-float(part) for part in text.split(";") if part.strip())[::-1]
    if not np.isfinite(found).all():
        raise ValueError("a lane marking is not a number")
    return found


def _road(marks: list[list[float]], west: float, east: float, limit: float) -> LoggedMap:
    lanes, areas = [], []
    for side, ys in zip(("upper", "lower"), marks, strict=True):
        pairs = [(top, bottom) for top, bottom in itertools.pairwise(ys) if top - bottom > 1.0]
        names = [f"{side}-{i}" for i in range(len(pairs))]
        for i, (top, bottom) in enumerate(pairs):
            middle = 0.5 * (top + bottom)
            ends = [(east, middle), (west, middle)] if side == "upper" else [(west, middle), (east, middle)]
            inner, outer = (i + 1, i - 1) if side == "upper" else (i - 1, i + 1)
            beside = [names[j] if 0 <= j < len(names) else None for j in (inner, outer)]
            lanes.append(LoggedLane(names[i], np.array(ends), top - bottom, limit, left=beside[0], right=beside[1]))
        if pairs:
            areas.append(shapely.box(west, ys[-1], east, ys[0]))
    if not lanes:
        raise LogError("no lane markings in the recording")
    return LoggedMap(tuple(lanes), (), tuple(areas))


def _recognises(*more: str) -> Callable[[Path, bytes], bool]:
    return lambda _, head: {"frame", "id", "x", "y", "width", "height", "xVelocity", *more} <= set(header_of(head))


FORMAT = LogFormat("highd", "highD CSV", _recognises(), read)
AD4CHE = LogFormat("ad4che", "AD4CHE CSV", _recognises("orientation"), read_ad4che)
