"""Argoverse 2 motion forecasting: `scenario_*.parquet` and the map beside it.

The files hold no sizes, so each kind gets its usual one (a car 4.7 m x 2.0 m), and parked cars may overlap. The ego is
the recorder's vehicle, `AV`.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from regents_cosim.errors import LogError
from regents_cosim.scenario import Kind
from regents_cosim.sources.logs.files.polars_files import read_polars
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.roads.argoverse2_map import read_map
from regents_cosim.sources.logs.rows import Rows, require_steps, tracks_of
from regents_cosim.sources.logs.scene import LoggedScene

_KINDS: dict[str, Kind] = {
    "vehicle": "car", "bus": "bus", "pedestrian": "pedestrian", "motorcyclist": "motorcycle", "cyclist": "bicycle",
    "riderless_bicycle": "bicycle",
}  # fmt: skip
_NUMBERS = ("timestep", "position_x", "position_y", "heading")


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the one scenario of a folder or file."""
    file = next(iter(sorted(path.glob("scenario_*.parquet"))), None) if path.is_dir() else path
    if file is None:
        raise LogError(f"{path}: no scenario_*.parquet in this folder")
    table = read_polars(file, _NUMBERS, ("track_id", "object_type"))
    step, x, y, yaw = (table.numbers[name] for name in _NUMBERS)
    names, kind = table.texts["track_id"], table.kinds("object_type", lambda word: _KINDS.get(word, "other"))
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


def _recognises(path: Path, head: bytes) -> bool:
    if path.is_dir():
        return any(path.glob("scenario_*.parquet"))
    return head[:4] == b"PAR1" and path.name.startswith("scenario_")


FORMAT = LogFormat("argoverse2_motion", "Argoverse 2 motion scenario (parquet)", _recognises, read)
