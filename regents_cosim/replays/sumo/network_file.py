"""A network where SUMO can read it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from regents_cosim.system.scratch import scratch_folder


@contextmanager
def network_file(net: bytes) -> Iterator[Path]:
    """A network (gzip) where SUMO can read it."""
    with scratch_folder() as folder:
        path = folder / "replay.net.xml.gz"
        path.write_bytes(net)
        yield path
