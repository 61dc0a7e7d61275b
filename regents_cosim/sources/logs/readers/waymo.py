"""Waymo Open Motion: `Scenario` protos in TFRecord, one scenario per record.

Sizes vary from step to step; the median is used. The ego is the recorder's vehicle (`sdc_track_index`). Kerbs have
heights. Files of `tf.Example` have the same framing; `waymo_example` reads their records.

Every checksum of a TFRecord is verified, without TensorFlow. It is CRC-32C. Source: Castagnoli polynomial, RFC 3720,
appendix B.4.
"""

import struct
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from regents_cosim.checks.bounded import open_bounded
from regents_cosim.checks.work import Work
from regents_cosim.checks.xml_input import unpacked_limit
from regents_cosim.errors import LogError
from regents_cosim.norms.limits import ASSUMED_LIMIT_M_S
from regents_cosim.sources.logs.files.protobuf import (
    Message,
    columns,
    float_values,
    grouped,
    messages,
    number,
    numbers,
    text,
)
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat, explained
from regents_cosim.sources.logs.readers.waymo_example import read_example
from regents_cosim.sources.logs.roads.road import crossings_of
from regents_cosim.sources.logs.rows import steady_step
from regents_cosim.sources.logs.scene import (
    LoggedLane,
    LoggedMap,
    LoggedScene,
    LoggedSignal,
    RoadEdge,
    Track,
    dense_track,
    with_openings,
)
from regents_cosim.sources.logs.waymo_codes import KINDS, LETTERS, MPH, UNKNOWN, lights, stopping

_HEAD = 12
_POLYNOMIAL = 0x82F63B78  # reflected
_ONES = 0xFFFFFFFF


def is_tfrecord(head: bytes) -> bool:
    """Whether a file begins with the length of a record and the checksum of that length."""
    return len(head) >= _HEAD and masked(crc32c(head[:8])) == int.from_bytes(head[8:12], "little")


def records(path: Path) -> Iterator[bytes]:
    """The payloads of the records in a file. Raises LogError where one is truncated or damaged."""
    left = max(path.stat().st_size, unpacked_limit(path))  # gzip holds more than its size
    with open_bounded(path, left) as file:
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


_BIKE_LANE = 3
_STATE = (2, 3, 4, 5, 6, 8, 11)  # centre x, y, z, length, width, heading, valid


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """Read the scenarios of a file, one at a time."""
    empty = True
    for index, payload in enumerate(records(path)):
        empty = False
        with explained(path, f"Waymo scenario in record {index}"):
            top = grouped(memoryview(payload))
            work = Work(len(payload))
            yield read_example(top, f"{path.stem}-{index}", work) if set(top) == {1} else _scene(top, work)
    if empty:
        raise LogError(f"{path}: no records")


def _scene(top: dict[int, list[int | Message]], work: Work) -> LoggedScene:
    times = float_values(top[1])
    dt = steady_step(times, decimals=2)  # they jitter by about a millisecond
    tracks = [_track(message, len(times)) for message in messages(top[2])]
    ego = number(top[6], -1)
    mine = tracks[ego] if 0 <= ego < len(tracks) else None
    road = _map(messages(top[8]), work)
    return LoggedScene(
        name=text(top[5]) or "scenario",
        dt=dt,
        tracks=tuple(track for track in tracks if track is not None),
        road=road,
        ego=mine.agent.id if mine else None,
        signals=_signals(messages(top[7]), road.lanes, len(times), work),
        begin_s=float(times[0]),
    )


def _track(message: Message, steps: int) -> Track | None:
    track = grouped(message)
    states = messages(track[3])
    if len(states) != steps:
        raise ValueError(f"a track of {len(states)} states, expected {steps}")
    x, y, z, length, width, heading, valid = columns(states, _STATE).T
    name, kind = str(number(track[1])), KINDS.get(number(track[2]), "other")
    return dense_track(name, kind, (length, width), valid > 0, x, y, heading, z)


# --- map --------------------------------------------------------------------------------------


def _map(features: Sequence[Message], work: Work) -> LoggedMap:
    lanes, edges, crossings, stops, places = [], [], [], set[str](), []
    for message in features:
        feature = grouped(message)
        for sign in messages(feature[7]):
            stops.update(str(name) for name in numbers(grouped(sign)[1]))
            places += [at[:2] for at in columns(messages(grouped(sign)[2]), (1, 2)) if np.isfinite(at).all()]
        for lane in messages(feature[3]):
            lanes.append(_lane(str(number(feature[1])), grouped(lane)))
        crossings += [columns(messages(grouped(one)[1]), (1, 2)) for one in messages(feature[8])]
        for edge in messages(feature[5]):
            points = columns(messages(grouped(edge)[2]), (1, 2, 3))
            if len(points) > 1:
                edges.append(RoadEdge(points[:, :2], points[:, 2]))
    held = stopping((lane for lane in lanes if lane is not None), stops, places, work)
    return LoggedMap(with_openings(held), tuple(edges), crossings=crossings_of(crossings))


def _lane(name: str, lane: dict[int, list[int | Message]]) -> LoggedLane | None:
    points = columns(messages(lane[8]), (1, 2, 3))
    if number(lane[2]) == _BIKE_LANE or len(points) < 2:
        return None
    limit = float_values(lane[1])
    left, right = (
        [str(name) for side in messages(lane[beside][:1]) for name in numbers(grouped(side)[1])] for beside in (11, 12)
    )
    return LoggedLane(
        id=name,
        centre=points[:, :2],
        z=points[:, 2],
        speed_limit=limit[0] * MPH if len(limit) and limit[0] > 0 else ASSUMED_LIMIT_M_S,
        exits=tuple(str(exit_) for exit_ in numbers(lane[10])),
        left=left[0] if left else None,
        right=right[0] if right else None,
    )


# --- signals ----------------------------------------------------------------------------------


def _signals(
    states: Sequence[Message], lanes: Sequence[LoggedLane], steps: int, work: Work
) -> tuple[LoggedSignal, ...]:
    letters: dict[str, list[str]] = {}
    stops: dict[str, np.ndarray] = {}
    for step, message in enumerate(states[:steps]):
        for one in messages(grouped(message)[1]):
            light = grouped(one)
            name = str(number(light[1]))
            if name not in letters:
                work.spend("instants of one more light", steps)
                letters[name] = [UNKNOWN] * steps
            letters[name][step] = LETTERS.get(number(light[2]), UNKNOWN)
            if light[3]:
                stops[name] = columns(messages(light[3][-1:]), (1, 2))[0]
    return lights(letters, stops, lanes)


FORMAT = LogFormat("waymo", "Waymo Open Motion TFRecord", lambda path, head: is_tfrecord(head), read)
