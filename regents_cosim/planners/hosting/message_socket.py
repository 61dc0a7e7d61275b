"""Messages of bounded length between two processes, one of which runs unknown code.

A message is a mark, its length and its content. Anything else, or an incomplete message, ends the connection: reading
never blocks past a deadline, and nothing that arrives is executed. POSIX only.
"""

import select
import socket
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

LIMIT_BYTES = 1 << 20  # limit of an answer; a batch of 1,000 scenes takes 30 KB
_HEADER = struct.Struct(">4sI")
_MARK = b"\xa7rc1"  # no text or pickle begins like this
_PIECE_BYTES = 1 << 18


class MessageError(Exception):
    """The data that arrived is not a message."""


class MessageSocket:
    """One end of a socket pair, for one thread at a time; deadlines are by `time.monotonic`, None waits for ever."""

    def __init__(self, connection: socket.socket, limit_bytes: int | None = LIMIT_BYTES) -> None:
        """`limit_bytes` bounds received messages."""
        self._connection, self._limit = connection, limit_bytes
        connection.setblocking(False)
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(connection, select.POLLIN)
        self._writable.register(connection, select.POLLOUT)
        self._arrived = b""  # after the last message

    def send(self, content: bytes, deadline: float | None = None) -> None:
        """Send a message. Raises TimeoutError, and OSError where the other end is closed."""
        rest = memoryview(_HEADER.pack(_MARK, len(content)) + content)
        while rest:
            try:
                rest = rest[self._connection.send(rest) :]
            except BlockingIOError:
                _wait(self._writable.poll, deadline)

    def receive(self, deadline: float | None = None) -> bytes:
        """Receive a message. Raises EOFError, TimeoutError, and MessageError for data that is no message."""
        head = self._read(_HEADER.size, deadline)
        mark, length = _HEADER.unpack(head)
        if mark != _MARK:
            raise MessageError(f"{head!r} where a message begins")
        if self._limit is not None and length > self._limit:
            raise MessageError(f"a message of {length} bytes, more than {self._limit}")
        return self._read(length, deadline)

    def unasked(self) -> bytes:
        """The data that arrived without a question; empty if there is none."""
        with suppress(BlockingIOError):
            self._arrived += self._connection.recv(64)
        return self._arrived[:64]

    def hang_up(self) -> None:
        """Make both ends read EOF, even in a thread that is waiting now."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close this end, so that the other end reads EOF."""
        self._connection.close()

    def _read(self, size: int, deadline: float | None) -> bytes:
        while len(self._arrived) < size:
            _wait(self._readable.poll, deadline)
            try:
                piece = self._connection.recv(_PIECE_BYTES)
            except BlockingIOError:  # another holder of the same socket was faster
                continue
            if not piece:
                raise EOFError
            self._arrived += piece
        found, self._arrived = self._arrived[:size], self._arrived[size:]
        return found


def _wait(poll: Callable[[float | None], list[Any]], deadline: float | None) -> None:
    left_ms = None if deadline is None else max(1e3 * (deadline - time.monotonic()), 0.0)
    if not poll(left_ms):
        raise TimeoutError
