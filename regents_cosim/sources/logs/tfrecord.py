"""Reads TFRecord files record by record and verifies every checksum; needs no TensorFlow."""

import struct
from collections.abc import Iterator
from pathlib import Path

from regents_cosim.errors import LogError
from regents_cosim.sources.logs.crc32c import crc32c, masked

_HEAD = 12


def is_tfrecord(head: bytes) -> bool:
    """Whether a file begins with the length of a record and the checksum of that length."""
    return len(head) >= _HEAD and masked(crc32c(head[:8])) == int.from_bytes(head[8:12], "little")


def records(path: Path) -> Iterator[bytes]:
    """The payloads of the records in a file. Raises LogError where one is truncated or damaged."""
    left = path.stat().st_size
    with path.open("rb") as file:
        number = 0
        while head := file.read(_HEAD):
            where = f"{path}: record {number}"
            if not is_tfrecord(head):
                raise LogError(f"{where} is truncated or damaged (the check of its length fails)")
            (length,) = struct.unpack("<Q", head[:8])
            left -= _HEAD + length + 4
            if left < 0:
                raise LogError(f"{where} is truncated: it should have {length} bytes, {-left} of them are missing")
            payload = file.read(length)
            if masked(crc32c(payload)) != int.from_bytes(file.read(4), "little"):
                raise LogError(f"{where} is damaged (its check fails)")
            yield payload
            number += 1
