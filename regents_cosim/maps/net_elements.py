"""The elements that a SUMO network of a case may hold: roads, junctions and lights.

SUMO also reads detectors, types with devices and other elements from a network file, and a detector writes to any path
that the file names, whenever the case is replayed. A network of a case may come from a stranger.
"""

from collections.abc import Callable
from xml.parsers import expat

from regents_cosim.checks.bounded import MIB, gunzip_bounded
from regents_cosim.checks.xml_input import ElementCount, most_unpacked
from regents_cosim.errors import InputError

_MOST_BYTES = 512 * MIB  # of an unpacked network: those of cities have 30 to 250 MiB
_ELEMENTS = frozenset(
    {
        "net", "location", "type", "laneType", "restriction", "edge", "lane", "neigh", "stopOffset", "junction",
        "request", "connection", "prohibition", "roundabout", "tlLogic", "phase", "condition", "assignment", "function",
        "param",
    }
)  # fmt: skip


def require_network_alone(content: bytes, packed_bytes: int) -> None:
    """Raise InputError where an unpacked network holds other elements, lights that write files, or far too much."""
    walk_network(content, packed_bytes, _require_known)


def unpacked_network(net: bytes) -> bytes:
    """The content of a network (gzip). Raises InputError where it is damaged or far too large."""
    return gunzip_bounded(net, most_unpacked(len(net), _MOST_BYTES))


def walk_network(
    content: bytes,
    packed_bytes: int,
    begin: Callable[[str, dict[str, str]], object],
    end: Callable[[str], object] = lambda name: None,
) -> None:
    """Call `begin` and `end` for every element of an unpacked network.

    Raises InputError where it is damaged, has a document type or far too much in it, and for ValueError and LookupError
    of the two functions.
    """
    count = ElementCount(packed_bytes)

    def opened(name: str, attributes: dict[str, str]) -> None:
        count.open()
        begin(name, attributes)

    def closed(name: str) -> None:
        count.close()
        end(name)

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = _refuse_document_type
    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"SUMO network: {error}; expected one as netconvert writes it") from error


def names_a_file(key: str) -> bool:
    """Whether a parameter of this name (of a light, vehicle, type or route) may tell SUMO where to write."""
    return any(word in key.lower().replace("profile", "") for word in ("file", "output"))


def _refuse_document_type(*_: object) -> None:
    raise InputError("SUMO network with a document type, which is not read (its entities may fill the memory)")


def _require_known(name: str, attributes: dict[str, str]) -> None:
    key = attributes.get("key", "") if name == "param" else ""
    if name not in _ELEMENTS or names_a_file(key):
        what = f"a parameter {key!r}" if key else f"<{name}>"
        raise InputError(
            f"SUMO network holds {what}, by which SUMO might write files: expected roads and lights alone (take it out)"
        )
