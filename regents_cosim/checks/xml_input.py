"""Reads XML from others, plain or gzip: no document types, bounded in size, depth and number of elements.

A few lines of entities expand to gigabytes, and gzip can pack XML a thousand to one. Real networks pack six to thirteen
to one and need at least eight packed bytes for an element; route files pack up to 33 to one and need two. So the
allowed content grows with the file's size, and a small file cannot fill the memory.
"""

import io
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import cast
from xml.parsers import expat

from regents_cosim.checks.bounded import open_bounded
from regents_cosim.errors import RegentsError, require_file

_LARGEST = 1 << 30  # bytes of unpacked text
_FIRST_PIECE_BYTES, _PIECE_BYTES = 1 << 12, 1 << 20


def unpacked_limit(path: Path) -> int:
    """The most bytes that a text file may hold after unpacking."""
    size = path.stat().st_size
    return min(_LARGEST, size) if _is_plain(path) else most_unpacked(size, _LARGEST)


def open_xml(path: Path, what: str, error: type[RegentsError]) -> io.BufferedReader:
    """An unpacked stream of a file. Raises `error` for a document type before the first element."""
    require_file(path, what)
    with explained_xml(path, what, error):
        _refuse_document_type(path)
        return open_bounded(path, unpacked_limit(path))


def children(path: Path, what: str, error: type[RegentsError]) -> Iterator[tuple[str, ET.Element]]:
    """The name of the root, and each of its children with its content; children already yielded are freed."""
    for root, element, count in _elements(path, what, error):
        if count.depth == 1:
            yield root.tag, element
            root.clear()
            count.forget()


def read_tree(path: Path, what: str, error: type[RegentsError]) -> ET.Element:
    """The root of a file. Raises `error` where it is broken or too large."""
    ((root, _, _),) = deque(_elements(path, what, error), maxlen=1)  # an empty file is broken XML
    return root


def _elements(
    path: Path, what: str, error: type[RegentsError]
) -> Iterator[tuple[ET.Element, ET.Element, "ElementCount"]]:
    """The root, and each element at its end, with the count of elements so far."""
    root = None
    with explained_xml(path, what, error), open_xml(path, what, error) as stream:
        count = ElementCount(path.stat().st_size)
        for event, element in _events(stream):
            root = element if root is None else root
            if event == "start":
                count.open()
            else:
                count.close()
                yield root, element, count


def walk(
    path: Path,
    what: str,
    error: type[RegentsError],
    visit: Callable[[str, dict[str, str]], object],
    leave: Callable[[str], object] = lambda name: None,
    text: Callable[[str], object] | None = None,
    encoded: Callable[[str | None], object] = lambda encoding: None,
) -> None:
    """Read a file to its end and call `visit` for every element; nothing is kept. Raises `error` as `read_tree` does.

    `leave` is called at the end of an element, `text` with text between elements, `encoded` with the declared encoding.
    """
    with explained_xml(path, what, error), open_xml(path, what, error) as stream:
        count = ElementCount(path.stat().st_size)

        def begin(name: str, attributes: dict[str, str]) -> None:
            count.open()
            count.forget()
            visit(name, attributes)

        def end(name: str) -> None:
            count.close()
            leave(name)

        parser = expat.ParserCreate()
        parser.XmlDeclHandler = lambda version, encoding, standalone: encoded(encoding)
        parser.StartElementHandler = begin
        parser.EndElementHandler = end
        parser.CharacterDataHandler = text
        for piece in _pieces(stream):
            parser.Parse(piece)
        parser.Parse(b"", True)


@contextmanager
def explained_xml(path: Path, what: str, error: type[RegentsError]) -> Iterator[None]:
    """Turn any exception from reading XML into one clear error."""
    try:
        yield
    except (ET.ParseError, expat.ExpatError) as found:
        raise error(f"{path}: broken or truncated XML ({found}); expected {what}") from found
    except RegentsError as found:
        raise (found if isinstance(found, error) else error(f"{found}; expected {what}")) from found
    except (ValueError, LookupError) as found:  # including an unknown encoding and text that is not a number
        raise error(f"{path}: {found}; expected {what}") from found
    except OSError as found:
        raise error(f"{path}: cannot be read ({found.strerror or found}); expected {what}") from found


def _events(stream: io.BufferedReader) -> Iterator[tuple[str, ET.Element]]:
    """`start` and `end` of each element."""
    parser = ET.XMLPullParser(("start", "end"))
    for piece in _pieces(stream):
        parser.feed(piece)
        yield from cast(Iterator[tuple[str, ET.Element]], parser.read_events())
    parser.close()  # expat from 2.6 on may keep a long tag until here
    yield from cast(Iterator[tuple[str, ET.Element]], parser.read_events())


def _pieces(stream: io.BufferedReader) -> Iterator[bytes]:
    """A file in growing pieces: with each piece, expat scans an unfinished tag again."""
    size = _FIRST_PIECE_BYTES
    while piece := stream.read(size):
        yield piece
        size = min(2 * size, _PIECE_BYTES)


def _refuse_document_type(path: Path) -> None:
    """Refuse a document type, and with it all entities; both can only precede the first element."""
    begun: list[str] = []

    def refuse(*_: object) -> None:
        raise ValueError("XML with a document type, which is not read (its entities may fill the memory)")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = lambda name, _: begun.append(name)
    with open_bounded(path, unpacked_limit(path)) as stream:
        for piece in _pieces(stream):
            parser.Parse(piece)
            if begun:
                return


def _is_plain(path: Path) -> bool:
    if not path.is_file():  # a pipe would wait for a writer; opening it is refused later
        return True
    with path.open("rb") as file:
        return file.read(2) != b"\x1f\x8b"


_ALWAYS_BYTES = 16 << 20
_MOST_TIMES = 50  # further bytes per packed byte
_DEEPEST = 100
_FEW_ELEMENTS = 20_000
_BYTES_PER_ELEMENT = 4  # on disk, for elements that are kept; in plain text an element takes at least as many


def most_unpacked(packed_bytes: int, largest: int) -> int:
    """The most bytes that gzip data of `packed_bytes` may unpack to."""
    return min(largest, _ALWAYS_BYTES + _MOST_TIMES * packed_bytes)


class ElementCount:
    """Count the depth and the number of elements of an XML file; raises ValueError beyond sensible numbers."""

    def __init__(self, size: int) -> None:
        self.depth = self._kept = self._all = 0
        self._most_kept, self._most = _FEW_ELEMENTS + size // _BYTES_PER_ELEMENT, _FEW_ELEMENTS + size

    def open(self) -> None:
        """Note the begin of an element."""
        self.depth += 1
        self._kept += 1
        self._all += 1
        if self.depth > _DEEPEST:
            raise ValueError(f"elements nested more than {_DEEPEST} deep")
        if self._kept > self._most_kept or self._all > self._most:
            raise ValueError(f"more than {self._all - 1} elements in so small a file (unpack it if it is your own)")

    def close(self) -> None:
        """Note the end of an element."""
        self.depth -= 1

    def forget(self) -> None:
        """Note that the elements so far are no longer in memory."""
        self._kept = 0
