"""The elements that a SUMO network of a case may hold: roads, junctions and lights.

SUMO also reads detectors, types with devices and other elements from a network file, and a detector writes to any path
that the file names, whenever the case is replayed. A network of a case may come from a stranger.
"""

from xml.parsers import expat

from regents_cosim.checks.xml_input import ElementCount
from regents_cosim.errors import InputError

_ELEMENTS = frozenset(
    {
        "net", "location", "type", "restriction", "edge", "lane", "neigh", "stopOffset", "junction", "request",
        "connection", "prohibition", "roundabout", "tlLogic", "phase", "condition", "assignment", "function", "param",
    }
)  # fmt: skip


def require_network_alone(content: bytes, packed_bytes: int) -> None:
    """Raise InputError where an unpacked network holds other elements, lights that write files, or far too much."""
    parser, count = network_parser(), ElementCount(packed_bytes)

    def begin(name: str, attributes: dict[str, str]) -> None:
        count.open()
        _require_known(name, attributes)

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: count.close()
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"SUMO network: {error}") from error


def network_parser() -> expat.XMLParserType:
    """A parser of networks, which raises InputError at a document type."""
    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = _refuse_document_type
    return parser


def names_a_file(key: str) -> bool:
    """Whether a parameter of this name (of a light, vehicle, type or route) may tell SUMO where to write."""
    return any(word in key.lower() for word in ("file", "output"))


def _refuse_document_type(*_: object) -> None:
    raise InputError("SUMO network with a document type, which is not read (its entities may fill the memory)")


def _require_known(name: str, attributes: dict[str, str]) -> None:
    key = attributes.get("key", "") if name == "param" else ""
    if name not in _ELEMENTS or names_a_file(key):
        what = f"a parameter {key!r}" if key else f"<{name}>"
        raise InputError(f"SUMO network holds {what}, with which SUMO may write files: expected roads and lights alone")
