"""Writes a network to a file for SUMO."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from regents_cosim.system.files.scratch import scratch_folder


@contextmanager
def network_file(net: bytes) -> Iterator[Path]:
    """A temporary file with the unpacked network `net` (gzip)."""
    with scratch_folder() as folder:
        path = folder / "replay.net.xml.gz"
        path.write_bytes(net)
        yield path
