"""Reads small files that ask for much: `python -m benchmarks.endurance.read_products READER...`.

A line of JSON for each file. This process gets 1.5 GB more than it starts with, and half a minute of processor time.
"""

import json
import resource
import sys
import tempfile
from pathlib import Path

from benchmarks.endurance.fuzz import LONGEST_MESSAGE, MOST_BYTES, place, try_one
from benchmarks.endurance.products import products_of
from benchmarks.endurance.readers import Reader, readers
from regents_cosim.errors import RegentsError
from tests.support.peak_memory import forget_peak, peak_bytes

_BYTES, _SECONDS = 3 * MOST_BYTES, 30


def main(names: list[str]) -> None:
    """Read every product of those readers."""
    known = readers()
    files = [(name, index, data) for name in names for index, data in enumerate(products_of(name))]
    if sys.platform == "linux":
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + _BYTES, used + _BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    for name, index, data in files:
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps({"reader": name, "index": index} | _read(known[name], Path(folder), data)), flush=True)


def _read(reader: Reader, folder: Path, data: bytes) -> dict[str, object]:
    path, wrapped = place(reader, folder), reader.wrap(data)
    forget_peak()
    before = peak_bytes()
    verdict, how = try_one(reader, path, wrapped)
    grown = peak_bytes() - before
    said = ""
    if verdict == "refused":
        try:
            reader.read(path)
        except RegentsError as error:
            said = str(error)
    return {"verdict": verdict, "how": how, "grown": grown, "size": len(wrapped), "said": said[:LONGEST_MESSAGE]}


if __name__ == "__main__":
    main(sys.argv[1:])
