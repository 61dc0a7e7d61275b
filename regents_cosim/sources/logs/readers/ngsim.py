"""NGSIM trajectories: feet, positions of front bumpers along and across the road, no headings, no map.

The text files as first published have no header: 18 columns of a motorway, 24 of a street, separated by white space.

All lanes of its motorways run along Local_Y; its streets, whose rows have a Direction, run in all directions.

The merged file reuses vehicle numbers at every location and in every period, at one location even at once: equal
numbers are the same vehicle only at one location, with an equal number of frames, and without a gap of more than 5 s.
Every location is a scene.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from regents_cosim.errors import LogError
from regents_cosim.geometry.frames import FOOT_M
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.files.csv_columns import header_of, read_columns
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat, head_of
from regents_cosim.sources.logs.roads.lanelet2 import read_lanelet2
from regents_cosim.sources.logs.rows import Rows, late_notes, rows_by, steps_of, tracks_of
from regents_cosim.sources.logs.scene import LoggedMap, LoggedScene, of_centre

_KINDS: dict[int, Kind] = {1: "motorcycle", 2: "car", 3: "truck"}
_NUMBERS = ("vehicle_id", "global_time", "local_x", "local_y", "v_length", "v_width", "v_class")
_MORE = ("total_frames", "direction")
_LINE = (
    "vehicle_id", "frame_id", "total_frames", "global_time", "local_x", "local_y", "global_x", "global_y", "v_length",
    "v_width", "v_class", "v_vel", "v_acc", "lane_id",
)  # fmt: skip
_OF_STREETS = ("o_zone", "d_zone", "int_id", "section_id", "direction", "movement")
_BETWEEN = ("preceding", "following", "space_headway", "time_headway")
_WITHOUT_HEADER = {len(names): names for names in ((*_LINE, *_BETWEEN), (*_LINE, *_OF_STREETS, *_BETWEEN))}
_EARLIEST_MS = 1e8  # times are counted since 1970, and some lack their first digits
_GONE_S = 5.0
_ALONG_RAD = 0.5 * np.pi  # the direction of Local_Y


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """One scene per location."""
    head = head_of(path)
    header = _header_lacking(head)
    names = {name.lower(): name for name in header or header_of(head)}
    wanted = [names.get(name, name) for name in (*_NUMBERS, *_MORE)]
    table = read_columns(path, wanted, [names.get("location", "location")], ["location", *wanted[-2:]], header)
    numbers = {key.lower(): values for key, values in table.numbers.items()}
    place = next(iter(table.codes.values()), np.zeros(len(table), int))
    road = LoggedMap() if beside.road is None else read_lanelet2(beside.road)
    locations = next(iter(table.texts.values()), [])
    for number, mine in rows_by(place).items():
        location = f"-{locations[number]}" if len(locations) > 1 else ""
        yield _scene(f"{path.stem}{location}", {key: values[mine] for key, values in numbers.items()}, road)


def _scene(name: str, numbers: dict[str, np.ndarray], road: LoggedMap) -> LoggedScene:
    if not all(np.isfinite(numbers[key]).all() for key in _NUMBERS):
        raise LogError(f"{name}: a field is empty or no number")
    step, late, dt, begin_s = steps_of(1e-3 * numbers["global_time"])
    vehicle = numbers["vehicle_id"]
    who, names = _persons(vehicle, np.nan_to_num(numbers.get("total_frames", np.zeros(len(vehicle)))), step, dt)
    x, y = FOOT_M * numbers["local_x"], FOOT_M * numbers["local_y"]
    length, width = FOOT_M * numbers["v_length"], FOOT_M * numbers["v_width"]
    kind = np.array([_KINDS.get(int(number), "car") for number in numbers["v_class"].tolist()], object)
    is_street = np.nan_to_num(numbers.get("direction", np.zeros(1))).any()
    rows = Rows(who, step, x, y, np.full(len(x), np.nan), kind, length, width, names, late)
    tracks = tuple(map(of_centre, tracks_of(rows, road, None if is_street else _ALONG_RAD)))
    notes = ("headings follow from the motion", *late_notes(late, dt))
    return LoggedScene(name=name, dt=dt, tracks=tracks, road=road, begin_s=begin_s, notes=notes)


def _persons(vehicle: np.ndarray, total: np.ndarray, step: np.ndarray, dt: float) -> tuple[np.ndarray, list[str]]:
    """The number of the road user in each row, and its name: that of its vehicle, the later ones of which are counted.

    `vehicle` is its number in the file, and `total` in how many frames it is seen.
    """
    order = np.lexsort((step, total, vehicle))
    other = (np.diff(vehicle[order], prepend=np.nan) != 0) | (np.diff(total[order], prepend=np.nan) != 0)
    later = np.diff(step[order], prepend=step[order[0]]) * dt > _GONE_S
    who = np.empty(len(order), int)
    who[order] = np.cumsum(other | later) - 1
    first = order[np.flatnonzero(other | later)]
    seen: dict[float, int] = {}
    names = [""] * len(first)
    for one in np.lexsort((step[first], vehicle[first])).tolist():
        number = float(vehicle[first[one]])
        seen[number] = seen.get(number, 0) + 1
        names[one] = f"{number:.0f}" if seen[number] == 1 else f"{number:.0f}-{seen[number]}"
    return who, names


def _header_lacking(head: bytes) -> tuple[str, ...]:
    """The columns of a file that begins with a sample; empty where it does not."""
    fields = header_of(head)
    names = _WITHOUT_HEADER.get(len(fields), ())
    try:
        first = dict(zip(names, map(float, fields), strict=True))
    except ValueError:
        return ()
    return names if names and first["global_time"] > _EARLIEST_MS and first["v_class"] in _KINDS else ()


def _recognises(path: Path, head: bytes) -> bool:
    found = {name.lower() for name in header_of(head)}
    return {"vehicle_id", "frame_id", "local_x", "local_y", "v_length"} <= found or bool(_header_lacking(head))


FORMAT = LogFormat("ngsim", "NGSIM (csv, txt)", _recognises, read)
