"""Messages between `host_process` and `host_server`: MessagePack with a fixed schema in both directions.

Every question has a number, which its answer repeats. Nothing that comes back is unpickled; only a planner that the
user has given as an object is sent pickled.
"""

from typing import Annotated, Any

import msgspec
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from regents_cosim.planners.hosting.debug_message import DebugMessage
from regents_cosim.planners.hosting.object_transport import Pickled
from regents_cosim.planners.interface import Control, Placement, Scene, Snapshot

TRACE_LIMIT = 8192  # characters of a traceback or a stack, from its head and its tail
SUMMARY_LIMIT = 1000  # characters of an exception's message


class Make(msgspec.Struct, tag=True):
    """Make the planner of that name or object; answered by PlannerMade."""

    number: int
    planner: str | Pickled


class Reset(msgspec.Struct, tag=True):
    """Begin a drive in each of `scenes`, None for those of the previous drive; answered by Done."""

    number: int
    scenes: list[Scene] | None


class Decide(msgspec.Struct, tag=True):
    """Decide in every scene of the drive; answered by Decided."""

    number: int
    step: int
    seen: list[bytes]  # `packed`
    debug: bool = False  # whether to answer with what the planner thought


class PlannerMade(msgspec.Struct, tag=True, forbid_unknown_fields=True):
    """The planner exists."""

    number: int
    batches: bool  # whether it drives many scenes at once


class Done(msgspec.Struct, tag=True, forbid_unknown_fields=True):
    """The drives may begin."""

    number: int


class Answer(msgspec.Struct, forbid_unknown_fields=True):
    """A decision, and how long it took [s]."""

    seconds: float
    control: tuple[float, float] | None = None  # accel [m/s^2], curvature [1/m]
    placement: tuple[float, float, float, float] | None = None  # x, y [m], yaw [rad], speed [m/s]
    debug: DebugMessage | None = None

    @property
    def decision(self) -> Control | Placement:
        """The control or the placement, whichever is set."""
        if self.placement is not None:
            return Placement(*self.placement)
        assert self.control is not None
        return Control(*self.control, None if self.debug is None else self.debug.debug)


class Decided(msgspec.Struct, tag=True, forbid_unknown_fields=True):
    """One decision per scene, in order."""

    number: int
    answers: list[Answer]


class Raised(msgspec.Struct, tag=True, forbid_unknown_fields=True):
    """The planner raised an exception, given as text, since its class may not exist elsewhere."""

    number: int
    summary: Annotated[str, msgspec.Meta(max_length=SUMMARY_LIMIT)]
    trace: Annotated[str, msgspec.Meta(max_length=TRACE_LIMIT)]


Question = Make | Reset | Decide
Reply = PlannerMade | Done | Decided | Raised


def packed(seen: Snapshot) -> bytes:
    """A snapshot as bytes."""
    return np.stack(np.broadcast_arrays(*seen)).astype(np.float64).tobytes()


def unpacked(seen: bytes) -> tuple[np.ndarray, ...]:
    """The values of a snapshot from bytes, as writable arrays [agent]."""
    x, y, yaw, speed, valid, z = np.frombuffer(seen).copy().reshape(len(Snapshot._fields), -1)
    return x, y, yaw, speed, valid > 0.0, z


def shortened(text: str, limit: int) -> str:
    """`text` in at most `limit` characters, cut in the middle."""
    if len(text) <= limit:
        return text
    gap = f"\n... {len(text) - limit} characters left out ...\n"
    kept = limit - len(gap)
    return text[: kept // 2] + gap + text[len(text) - (kept - kept // 2) :]


def _plain(value: Any) -> Any:
    """Arrays and geometries as bytes."""
    if isinstance(value, np.ndarray):
        return value.shape, np.ascontiguousarray(value, np.float64).tobytes()
    if isinstance(value, shapely.Geometry):
        return shapely.to_wkb(value)
    raise NotImplementedError(f"a {type(value).__name__} is no part of a scene")


def _made(kind: Any, value: Any) -> Any:
    """The array or the geometry in these bytes."""
    if kind is BaseGeometry:
        return shapely.from_wkb(value)
    shape, content = value
    return np.frombuffer(content).reshape(shape)


encoder = msgspec.msgpack.Encoder(enc_hook=_plain)
questions = msgspec.msgpack.Decoder(Question, dec_hook=_made)
replies = msgspec.msgpack.Decoder(Reply)
