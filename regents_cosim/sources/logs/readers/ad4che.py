"""AD4CHE: Chinese motorways from above (30 Hz), in highD's three files, but x and y are the centre of a box.

`orientation` is the angle from the x-axis of the image to the box, towards the y-axis, which points down. The driving
direction tells which end of the box is the front.
"""

from collections.abc import Iterator
from pathlib import Path

from regents_cosim.sources.logs.files.csv_columns import header_of
from regents_cosim.sources.logs.formats import CompanionFiles, LogFormat
from regents_cosim.sources.logs.readers.highd import is_of_highd, read_recording
from regents_cosim.sources.logs.scene import LoggedScene

_OWN = {"orientation", "yaw_rate", "ego_offset"}


def read(path: Path, beside: CompanionFiles) -> Iterator[LoggedScene]:
    """The recording of one `NN_tracks.csv`."""
    yield read_recording(path, "AD4CHE", _OWN, orientation="orientation")


FORMAT = LogFormat(
    "ad4che", "AD4CHE CSV", lambda path, head: is_of_highd(path, head) and "orientation" in header_of(head), read
)
