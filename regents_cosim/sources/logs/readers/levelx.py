"""inD, rounD, exiD, uniD: three CSV files per recording (25 Hz), and a lanelet2 map if one lies nearby.

`NN_tracks.csv` has centres and headings in degrees, `NN_tracksMeta.csv` the classes, `NN_recordingMeta.csv` the rate
and the UTM origin that the map is relative to. Pedestrians have no size. There is no ego. Without a map the road is
where vehicles drove.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from regents_cosim.errors import LogError
from regents_cosim.scenario.scenario import Kind
from regents_cosim.sources.logs.files.csv_columns import Columns, header_of, read_columns, refuse_other_poses
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.roads.lanelet2 import UtmOrigin, read_lanelet2
from regents_cosim.sources.logs.rows import FrameSteps, Rows, late_notes, require_steps, steps_of_frames, tracks_of
from regents_cosim.sources.logs.scene import LoggedMap, LoggedScene

_NUMBERS = ("trackId", "frame", "xCenter", "yCenter", "heading", "width", "length")
_LIKE_OTHERS = {"latLaneCenterOffset", "rearId", "leftRearId", "rightRearId"}  # exiD: neither place nor heading


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the recording of one `NN_tracks.csv`."""
    table = read_columns(path, _NUMBERS)
    refuse_other_poses(path, table, {*_NUMBERS, *_LIKE_OTHERS}, "inD, rounD, exiD or uniD")
    numbers = table.numbers
    about = read_columns(companion(path, "recordingMeta"), _ABOUT, (), _ABOUT[1:])
    meta = companion(path, "tracksMeta")
    kinds = kinds_by_number(meta, read_columns(meta, ("trackId",), ("class",)), "trackId")
    rate = frame_rate(path, about)
    who = require_steps(numbers["trackId"], path)
    x, y, length, width = (numbers[name] for name in ("xCenter", "yCenter", "length", "width"))
    kind = np.array([kinds.get(number, "other") for number in who.tolist()], object)
    at = steps_of_frames(numbers["frame"], who, path)
    rows = Rows(who, at.step, x, y, np.deg2rad(numbers["heading"]), kind, length, width, late=at.late)
    road = _map(path, beside, {name: float(values[0]) for name, values in about.numbers.items()})
    yield scene_of(path, rate, rows, at, road)


def scene_of(path: Path, rate: float, rows: Rows, at: FrameSteps, road: LoggedMap) -> LoggedScene:
    """The scene of a recording of `rate` frames in a second."""
    name, dt = path.name.partition("_tracks")[0], at.stride / rate
    tracks, notes = tuple(tracks_of(rows, road)), tuple(late_notes(at.late, dt))
    return LoggedScene(name, dt, tracks, road, begin_s=at.first / rate, notes=notes)


_ABOUT = ("frameRate", "locationId", "latLocation", "lonLocation", "xUtmOrigin", "yUtmOrigin")


def companion(path: Path, what: str) -> Path:
    """The path of `NN_tracksMeta.csv` or `NN_recordingMeta.csv`, given `NN_tracks.csv`."""
    file = path.with_name(path.name.replace("_tracks.csv", f"_{what}.csv"))
    if file == path or not file.is_file():
        raise LogError(
            f"{path}: no {file.name if file != path else what} beside it (expected the recording's three files)"
        )
    return file


def frame_rate(path: Path, about: Columns) -> float:
    """The frame rate [Hz] of a recording. Raises LogError for an absurd one."""
    rate = float(about.numbers["frameRate"][0])
    if not 1.0 <= rate <= 1000.0:
        raise LogError(f"{path}: a frame rate of {rate:g} Hz, expected 1 to 1000")
    return rate


def kinds_by_number(path: Path, table: Columns, number: str) -> dict[int, Kind]:
    """The kinds of road users by their numbers in that column."""
    return dict(zip(require_steps(table.numbers[number], path).tolist(), table.kinds("class"), strict=True))


def _map(path: Path, beside: CompanionFiles, about: dict[str, float]) -> LoggedMap:
    file = beside.road or _map_file(path, about.get("locationId"))
    if file is None:
        return LoggedMap()
    lon, x, y = about.get("lonLocation", 6.0), about.get("xUtmOrigin", 0.0), about.get("yUtmOrigin", 0.0)
    if not (abs(lon) <= 180.0 and np.isfinite([x, y]).all()):
        raise LogError(f"{path}: longitude {lon:g}, UTM origin ({x:g}, {y:g}) in its recordingMeta place no map")
    return read_lanelet2(file, UtmOrigin(int((lon + 180.0) // 6.0) + 1, x, y))


def _map_file(path: Path, location: float | None) -> Path | None:
    """The map of a location, as the data sets lay it out: `maps/lanelets/N_name/*.osm` beside the data; else None."""
    for above in path.absolute().parents[:3]:
        found = [*above.glob("*.osm"), *above.glob("maps/*.osm"), *above.glob("maps/lanelet*/**/*.osm")]
        if len(found) == 1:
            return found[0]
        if location is not None:
            for file in sorted(found):
                number = f"{location:.0f}"
                if file.parent.name.split("_")[0] == number or file.stem.endswith(f"location{number}"):
                    return file
    return None


_NEEDED = {"trackId", "frame", "xCenter", "yCenter", "heading"}
FORMAT = LogFormat("levelx", "inD / rounD / exiD / uniD CSV", lambda _, head: set(header_of(head)) >= _NEEDED, read)
