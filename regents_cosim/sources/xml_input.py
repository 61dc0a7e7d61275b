"""XML that others made, plain or gzip: no document types, bounded in size, depth and number of elements.

A few lines of entities unfold to gigabytes, and gzip packs XML a thousand to one. Real networks pack six to ten to
one and need nine packed bytes or more for an element; route files pack up to 33 to one. So what a file may hold
grows with the file: whoever sends a small one cannot fill the memory.
"""

import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.parsers import expat

from regents_cosim.bounded import MIB, open_bounded
from regents_cosim.errors import RegentsError, require_file

_LARGEST = 1 << 30  # bytes of unpacked text
_MOST_TIMES = 50  # what gzip makes of a file, besides the first 16 MiB
_DEEPEST = 100
_FEW_ELEMENTS = 20_000
_BYTES_PER_ELEMENT = 4  # on disk: of plain text an element takes no fewer


def unpacked_limit(path: Path) -> int:
    """The most bytes that a text file may hold after unpacking."""
    size = path.stat().st_size
    return min(_LARGEST, size if _is_plain(path) else 16 * MIB + _MOST_TIMES * size)


def open_xml(path: Path, what: str, error: type[RegentsError]) -> io.BufferedReader:
    """A stream of a file, gzip undone. Raises `error` for a document type before the first element."""
    require_file(path, what)
    with explained_xml(path, what, error):
        _refuse_document_type(path)
        return open_bounded(path, unpacked_limit(path))


def children(path: Path, what: str, error: type[RegentsError]) -> Iterator[tuple[str, ET.Element]]:
    """The name of the root, and each of its children as a whole; what was read is not kept."""
    root = None
    with explained_xml(path, what, error), open_xml(path, what, error) as stream:
        count = Count(path)
        for event, element in ET.iterparse(stream, events=("start", "end")):
            root = element if root is None else root
            if event == "start":
                count.open()
            elif count.close() == 1:
                yield root.tag, element
                root.clear()
                count.elements = 0


def read_tree(path: Path, what: str, error: type[RegentsError]) -> ET.Element:
    """The root of a file. Raises `error` where it is broken or too large."""
    root = None
    with explained_xml(path, what, error), open_xml(path, what, error) as stream:
        count = Count(path)
        for event, element in ET.iterparse(stream, events=("start", "end")):
            root = element if root is None else root
            if event == "start":
                count.open()
            else:
                count.close()
    assert root is not None  # an empty file is broken XML
    return root


class Count:
    """How deep one is in a file, and how many elements it had; raises ValueError past what is sensible."""

    def __init__(self, path: Path) -> None:
        self.depth = self.elements = 0
        self._most = _FEW_ELEMENTS + path.stat().st_size // _BYTES_PER_ELEMENT

    def open(self) -> None:
        """An element begins."""
        self.depth += 1
        self.elements += 1
        if self.depth > _DEEPEST:
            raise ValueError(f"elements nested more than {_DEEPEST} deep")
        if self.elements > self._most:
            raise ValueError(f"more than {self._most} elements in so small a file")

    def close(self) -> int:
        """An element ends; how deep one is behind it."""
        self.depth -= 1
        return self.depth


@contextmanager
def explained_xml(path: Path, what: str, error: type[RegentsError]) -> Iterator[None]:
    """Turn what goes wrong with XML into one clear error."""
    try:
        yield
    except (ET.ParseError, expat.ExpatError) as found:
        raise error(f"{path}: broken or truncated XML ({found}); expected {what}") from found
    except RegentsError as found:
        raise (found if isinstance(found, error) else error(f"{found}; expected {what}")) from found
    except (ValueError, LookupError) as found:  # also an unknown encoding, and numbers that are none
        raise error(f"{path}: {found}; expected {what}") from found
    except OSError as found:
        raise error(f"{path}: cannot be read ({found.strerror or found}); expected {what}") from found


def _refuse_document_type(path: Path) -> None:
    """A document type, and with it all entities, can only come before the first element."""
    begun: list[str] = []

    def refuse(*_: object) -> None:
        raise ValueError("XML with a document type, which is not read (its entities may fill the memory)")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda name, _: begun.append(name)
    with open_bounded(path, unpacked_limit(path)) as stream:
        while not begun and (piece := stream.read(1 << 12)):
            parser.Parse(piece)


def _is_plain(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(2) != b"\x1f\x8b"
