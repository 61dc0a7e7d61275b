"""Reads TFRecord files record by record and verifies every checksum; needs no TensorFlow.

The checksum is CRC-32C. Source: Castagnoli polynomial, RFC 3720, appendix B.4.
"""

import struct
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from regents_cosim.errors import LogError

_HEAD = 12
_POLYNOMIAL = 0x82F63B78  # reflected
_ONES = 0xFFFFFFFF


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


def crc32c(data: bytes) -> int:
    """CRC-32C of `data`."""
    state, table = _ONES, _table()
    for byte in data:
        state = table[(state ^ byte) & 0xFF] ^ (state >> 8)
    return state ^ _ONES


def masked(crc: int) -> int:
    """The form in which TFRecord stores a checksum: rotated and shifted, so that a checksum of a checksum works."""
    return (((crc >> 15) | (crc << 17)) + 0xA282EAD8) & _ONES


@cache
def _table() -> tuple[int, ...]:
    """The states after one byte."""
    found = []
    for state in range(256):
        for _ in range(8):
            state = (state >> 1) ^ _POLYNOMIAL if state & 1 else state >> 1
        found.append(state)
    return tuple(found)
