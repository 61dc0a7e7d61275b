"""The most memory that this process has had.

`ru_maxrss` of a process that another one started begins at the peak of that other one: the kernel hands it through
fork and exec. What `/proc` calls the high water mark belongs to the program alone.
"""

import re
import resource
import sys
from pathlib import Path

_STATUS = Path("/proc/self/status")
_FORGET = Path("/proc/self/clear_refs")


def peak_bytes() -> int:
    """The peak memory of this program since its start; without /proc the value of `getrusage`."""
    if _STATUS.exists():
        return 1024 * int(re.search(r"VmHWM:\s+(\d+) kB", _STATUS.read_text())[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def forget_peak() -> None:
    """Let the peak begin at what is held now, where the system can do that."""
    if _FORGET.exists():
        _FORGET.write_text("5")
