"""Tracks as .npz files."""

import io
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from regents_cosim.cases.array_files import load_arrays
from regents_cosim.errors import InputError, require
from regents_cosim.scenario import Tracks


def pack_tracks(tracks: Tracks) -> bytes:
    """The bytes of a .npz file with the given tracks."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: value for name, value in arrays(tracks).items() if value is not None})
    return buffer.getvalue()


def arrays(tracks: Tracks) -> dict[str, Any]:
    """The arrays of tracks by name, without heights where all are 0."""
    arrays = {f.name: getattr(tracks, f.name) for f in fields(tracks)}
    if tracks.flat:
        arrays.pop("z")
    return arrays


def load_tracks(path: Path) -> Tracks:
    """Read tracks from a .npz file. Raises InputError where an array is missing, and as `load_arrays` does."""
    found = load_arrays(path, {f.name for f in fields(Tracks)})
    missing = sorted({f.name for f in fields(Tracks) if f.default is MISSING} - set(found))
    require(not missing, f"{path}: arrays {missing} are missing", InputError)
    return Tracks(**found)
