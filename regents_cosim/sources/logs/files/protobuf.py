"""Decodes protocol buffers: the few kinds of fields that Waymo's files use.

No descriptors are registered, so nothing clashes with Waymo's own package in the same process. Malformed bytes raise
ValueError.
"""

import struct
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

Message = memoryview
_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5


def fields(message: Message) -> Iterator[tuple[int, int, int | Message]]:
    """Number, wire type and value of every field: an int for varints, otherwise its bytes."""
    at, end = 0, len(message)
    while at < end:
        key, at = _varint(message, at)
        number, wire = key >> 3, key & 7
        if number == 0:
            raise ValueError("a field has number 0")
        if wire == _VARINT:
            value, at = _varint(message, at)
            yield number, wire, value
            continue
        if wire == _LENGTH:
            size, at = _varint(message, at)
        elif wire in (_FIXED64, _FIXED32):
            size = 8 if wire == _FIXED64 else 4
        else:
            raise ValueError(f"field {number} has wire type {wire}")
        if at + size > end:
            raise ValueError(f"field {number} is truncated")
        yield number, wire, message[at : at + size]
        at += size


def grouped(message: Message) -> dict[int, list[int | Message]]:
    """Values of every field of a message, by number."""
    found: dict[int, list[int | Message]] = defaultdict(list)
    for number, _, value in fields(message):
        found[number].append(value)
    return found


def messages(values: Sequence[int | Message]) -> list[Message]:
    """Values as nested messages or strings. Raises ValueError for others."""
    if any(isinstance(value, int) for value in values):
        raise ValueError("a number where a message is expected")
    return [value for value in values if not isinstance(value, int)]


def text(values: Sequence[int | Message]) -> str:
    """A string field; empty where absent."""
    found = messages(values)
    return str(found[-1], "utf-8") if found else ""


def number(values: Sequence[int | Message], default: int = 0) -> int:
    """An integer field (int32, int64, enum, bool)."""
    if not values:
        return default
    if not isinstance(values[-1], int):
        raise ValueError("bytes where a number is expected")
    return _signed(values[-1])


def numbers(values: Sequence[int | Message]) -> list[int]:
    """A repeated integer field, packed or not."""
    found: list[int] = []
    for value in values:
        if isinstance(value, int):
            found.append(_signed(value))
            continue
        at = 0
        while at < len(value):
            one, at = _varint(value, at)
            found.append(_signed(one))
    return found


def float_values(values: Sequence[int | Message], kind: str = "<f8") -> Float[np.ndarray, " value"]:
    """Floating-point values of a repeated double (or with `<f4` float) field, packed or not."""
    return np.frombuffer(b"".join(messages(values)), kind).astype(float)


def columns(rows: Sequence[Message], wanted: Sequence[int]) -> Float[np.ndarray, "row column"]:
    """Numeric fields of many small messages; 0 where absent.

    Messages of equal length mostly have the same layout, and are then decoded all at once.
    """
    found = np.zeros((len(rows), len(wanted)))
    by_length: dict[int, list[int]] = defaultdict(list)
    for index, row in enumerate(rows):
        by_length[len(row)].append(index)
    for length, members in by_length.items():
        if length:
            _fill_alike(found, rows, np.array(members), wanted)
    return found


def _fill_alike(found: np.ndarray, rows: Sequence[Message], members: np.ndarray, wanted: Sequence[int]) -> None:
    layout = _layout(rows[members[0]])
    block = np.frombuffer(b"".join(rows[i] for i in members), np.uint8).reshape(len(members), -1)
    alike = np.zeros(len(members), bool)
    if layout is not None:
        alike[:] = True
        for tag, _, wire, at, _ in layout:
            alike &= block[:, at - 1] == tag
            if wire == _VARINT:
                alike &= block[:, at] < 0x80
        for _, field_number, wire, at, size in layout:
            if field_number in wanted:
                values = np.ascontiguousarray(block[:, at : at + size])
                kind = {_FIXED64: "<f8", _FIXED32: "<f4", _VARINT: "u1"}[wire]
                found[members, wanted.index(field_number)] = np.where(alike, values.view(kind)[:, 0], 0)
    for index in members[~alike]:
        for field_number, wire, value in fields(rows[index]):
            if field_number in wanted and wire != _LENGTH:
                found[index, wanted.index(field_number)] = _real(value)


def _layout(row: Message) -> list[tuple[int, int, int, int, int]] | None:
    """Tag, number, wire type, offset and size of every field; None where the offsets may vary."""
    found, at = [], 0
    while at < len(row):
        tag = row[at]
        wire, size = tag & 7, {_FIXED64: 8, _FIXED32: 4, _VARINT: 1}.get(tag & 7, 0)
        if tag >= 0x80 or tag >> 3 == 0 or not size or at + 1 + size > len(row):
            return None
        if wire == _VARINT and row[at + 1] >= 0x80:
            return None
        found.append((tag, tag >> 3, wire, at + 1, size))
        at += 1 + size
    return found


def _real(value: int | Message) -> float:
    if isinstance(value, int):
        return float(_signed(value))
    return struct.unpack("<d" if len(value) == 8 else "<f", value)[0]


def _varint(message: Message, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("a number is truncated")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & 0xFFFFFFFFFFFFFFFF, at
    raise ValueError("a number is longer than 10 bytes")


def _signed(value: int) -> int:
    return value - (1 << 64) if value >= 1 << 63 else value
