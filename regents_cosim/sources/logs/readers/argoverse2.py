"""Argoverse 2: motion forecasting and sensor logs, with a map beside the tracks; the recorder's vehicle is the ego.

`scenario_*.parquet` of motion forecasting hold no sizes, so each kind gets its usual one (a car 4.7 m x 2.0 m), and
parked cars may overlap.

A sensor log is a folder with annotated boxes, the recorder's poses and a map. Boxes are given in the frame of the
recorder's vehicle at their time, and are moved to the city's frame. Without a size in the file that vehicle gets that
of a Ford Fusion (4.87 m x 1.85 m). Its poses are those of its rear axle, 1.4 m behind the middle of the car.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from regents_cosim.errors import LogError
from regents_cosim.scenario.scenario import Agent
from regents_cosim.sources.logs.files.csv_columns import Columns
from regents_cosim.sources.logs.files.polars_files import read_polars
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.roads.argoverse2_map import read_map
from regents_cosim.sources.logs.rows import Rows, require_steps, tracks_of
from regents_cosim.sources.logs.scene import LoggedScene, Track

_NUMBERS = ("timestep", "position_x", "position_y", "heading")


def _file_of(path: Path, pattern: str) -> Path:
    """The file itself, or the first one in a folder with such a name."""
    found = sorted(path.glob(pattern)) if path.is_dir() else [path]
    if not found:
        raise LogError(f"{path}: no {pattern} in this folder")
    return found[0]


def read_motion(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one scenario of a folder or file."""
    file = _file_of(path, "scenario_*.parquet")
    table = read_polars(file, _NUMBERS, ("track_id", "object_type"))
    step, x, y, yaw = (table.numbers[name] for name in _NUMBERS)
    names, kind = table.texts["track_id"], table.kinds("object_type")
    unknown = np.full(len(table), np.nan)
    rows = Rows(table.codes["track_id"], require_steps(step, file), x, y, yaw, kind, unknown, unknown, names)
    yield LoggedScene(
        name=file.stem.removeprefix("scenario_"),
        dt=0.1,
        tracks=tuple(tracks_of(rows)),
        road=read_map(file.parent),
        ego="AV" if "AV" in names else None,
        notes=("the log holds no sizes: those usual for the kind are assumed", "the map is cropped round the scene"),
    )


def _recognises_motion(path: Path, head: bytes) -> bool:
    if path.is_dir():
        return any(path.glob("scenario_*.parquet"))
    return head[:4] == b"PAR1" and path.name.startswith("scenario_")


# --- sensor logs ------------------------------------------------------------------------------

_EGO_CATEGORY = "EGO_VEHICLE"
_EGO, _EGO_SIZE, _AXLE_TO_MIDDLE_M = "ego", (4.87, 1.85), 1.4
_ROTATION, _PLACE = ("qw", "qx", "qy", "qz"), ("tx_m", "ty_m", "tz_m")
_POSE = (*_ROTATION, *_PLACE)


def read_sensor(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one recording of a folder."""
    boxes = _file_of(path, "annotations*.feather")
    table = read_polars(boxes, ("timestamp_ns", "length_m", "width_m", *_POSE), ("track_uuid", "category"))
    poses = read_polars(boxes.parent / "city_SE3_egovehicle.feather", ("timestamp_ns", *_POSE))
    times = np.unique(table.numbers["timestamp_ns"])
    if len(times) < 2:
        raise LogError(f"{boxes}: {len(times)} instants, expected at least 2")
    dt = round(float(np.median(np.diff(times))) * 1e-9, 2)
    begin = times[0]
    mine = _at(poses, times, boxes)
    step = np.round((times - begin) * 1e-9 / dt).astype(int)
    size = _ego_size(table)
    yield LoggedScene(
        name=boxes.parent.name,
        dt=dt,
        tracks=(_ego(mine, step, size or _EGO_SIZE), *_others(table, times, mine, step)),
        road=read_map(boxes.parent),
        ego=_EGO,
        notes=() if size else (f"the ego's size is not in the log: {_EGO_SIZE[0]} m x {_EGO_SIZE[1]} m is assumed",),
    )


def _at(poses: Columns, times: Float[np.ndarray, " time"], path: Path) -> Float[np.ndarray, "time 7"]:
    """The recorder's pose at the times of the boxes: the pose with the nearest time stamp."""
    known = poses.numbers["timestamp_ns"]
    order = np.argsort(known)
    after = np.clip(np.searchsorted(known[order], times), 1, len(known) - 1)
    near = np.where(times - known[order][after - 1] < known[order][after] - times, after - 1, after)
    if np.abs(known[order][near] - times).max() > 5e7:
        raise LogError(f"{path}: boxes without a pose of the recorder within 50 ms")
    return np.stack([poses.numbers[name][order][near] for name in _POSE], axis=-1)


def _matrices(q: Float[np.ndarray, "row 4"]) -> Float[np.ndarray, "row 3 3"]:
    """The rotation matrices of quaternions (w, x, y, z)."""
    from scipy.spatial.transform import Rotation  # slow to import, and few logs need it

    size = np.linalg.norm(q, axis=1)
    if not (np.isfinite(size) & (size > 0.5)).all():
        raise ValueError("a quaternion is not a rotation")
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def _ego_size(table: Columns) -> tuple[float, float] | None:
    """Length and width [m] of the recorder's vehicle, which some releases list; else None."""
    kinds = table.texts["category"]
    if _EGO_CATEGORY not in kinds:
        return None
    row = np.flatnonzero(table.codes["category"] == kinds.index(_EGO_CATEGORY))[0]
    return float(table.numbers["length_m"][row]), float(table.numbers["width_m"][row])


def _ego(poses: Float[np.ndarray, "time 7"], step: np.ndarray, size: tuple[float, float]) -> Track:
    turn = _matrices(poses[:, :4])
    middle = poses[:, 4:] + turn @ np.array([_AXLE_TO_MIDDLE_M, 0.0, 0.0])
    yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    return Track(Agent(_EGO, "car", *size), step, middle[:, 0], middle[:, 1], yaw)


def _others(table: Columns, times: np.ndarray, poses: Float[np.ndarray, "time 7"], step: np.ndarray) -> list[Track]:
    at = np.searchsorted(times, table.numbers["timestamp_ns"])
    base = _matrices(poses[:, :4])[at]
    place = np.stack([table.numbers[name] for name in _PLACE], axis=-1)
    turn = base @ _matrices(np.stack([table.numbers[name] for name in _ROTATION], axis=-1))
    place = poses[at, 4:] + np.einsum("rij,rj->ri", base, place)
    yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    kind = table.kinds("category")
    size = table.numbers["length_m"], table.numbers["width_m"]
    others = np.array([word != _EGO_CATEGORY for word in table.texts["category"]])[table.codes["category"]]
    values = table.codes["track_uuid"], step[at], place[:, 0], place[:, 1], yaw, kind, *size
    return tracks_of(Rows(*(of[others] for of in values), names=table.texts["track_uuid"]))


def _recognises_sensor(path: Path, head: bytes) -> bool:
    if path.is_dir():
        return any(path.glob("annotations*.feather")) and (path / "city_SE3_egovehicle.feather").exists()
    return head[:6] == b"ARROW1" and path.name.startswith("annotations")


MOTION = LogFormat("argoverse2_motion", "Argoverse 2 motion scenario (parquet)", _recognises_motion, read_motion)
SENSOR = LogFormat("argoverse2_sensor", "Argoverse 2 sensor log (feather)", _recognises_sensor, read_sensor)
