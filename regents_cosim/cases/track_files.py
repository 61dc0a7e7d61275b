"""Tracks as .npz files: every size is checked before data is unpacked, and nothing is ever unpickled."""

import io
import math
import warnings
import zipfile
from collections.abc import Collection
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from regents_cosim.checks.bounded import MIB, read_bounded
from regents_cosim.checks.work import Work
from regents_cosim.errors import InputError, require
from regents_cosim.scenario.scenario import Tracks


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


PACKED_BYTES = 64 * MIB
UNPACKED_BYTES = 256 * MIB  # 1,000 road users for 40 minutes at 10 Hz need 170
# zipfile unpacks other compressions in one piece, whatever size they announce
_WAYS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENDING = ".npy"
_KINDS = "fiub"  # NumPy kinds: numbers and booleans


def load_arrays(path: Path, names: Collection[str]) -> dict[str, np.ndarray]:
    """The arrays of a file by name. Raises InputError for a name outside `names` and for damage."""
    data = read_bounded(path, PACKED_BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            members = packed.infolist()
            _check_members(members, names, path)
            work = Work(len(data))
            return {one.filename.removesuffix(_ENDING): _array(packed.read(one), one.filename, work) for one in members}
    except InputError:
        raise
    except Exception as error:  # zipfile and NumPy raise a dozen kinds of errors on damage
        raise InputError(f"{path}: damaged or truncated ({type(error).__name__}: {str(error)[:100]})") from error


def _check_members(members: list[zipfile.ZipInfo], names: Collection[str], path: Path) -> None:
    found = [one.filename.removesuffix(_ENDING) for one in members]
    unknown = sorted(set(found) - set(names))
    require(not unknown, f"{path}: unknown arrays {unknown[:5]}, expected {sorted(names)}", InputError)
    require(len(set(found)) == len(found), f"{path}: an array occurs twice, expected each once", InputError)
    require(all(one.compress_type in _WAYS for one in members), f"{path}: expected deflated arrays", InputError)
    total = sum(one.file_size for one in members)
    require(
        total <= UNPACKED_BYTES,
        f"{path} holds {total / MIB:.0f} MiB unpacked, the most that is read is {UNPACKED_BYTES / MIB:g} MiB",
        InputError,
    )


def _array(data: bytes, name: str, work: Work) -> np.ndarray:
    """Decode one array that `np.save` wrote. Raises InputError unless the data has the size that its shape says."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    with warnings.catch_warnings():
        # the header is parsed as Python, which warns of text such as `1or 2`
        warnings.simplefilter("ignore", SyntaxWarning)
        begin = file.tell()
        try:
            shape, by_column, kind = read_header(file)
        except SystemError:  # Python 3.11 counts the depth of what threads parse at the same time together
            file.seek(begin)
            shape, by_column, kind = read_header(file)
    size = math.prod(shape) * kind.itemsize
    require(kind.kind in _KINDS, f"{name} holds {kind}, expected numbers", InputError)
    require(
        size == len(data) - file.tell(),
        f"{name}: shape {list(shape)} is not that of {len(data) - file.tell()} bytes",
        InputError,
    )
    work.spend(f"{name}: numbers of its axes", *shape)
    return np.frombuffer(data, kind, offset=file.tell()).reshape(shape, order="F" if by_column else "C")
