"""XML of logs, plain or gzip: one root, no entities (a few lines of which can fill the memory)."""

import xml.etree.ElementTree as ET
from pathlib import Path

from regents_cosim.errors import LogError
from regents_cosim.sources.logs.formats import unpacked


def read_xml(path: Path, root: str) -> ET.Element:
    """The root of a file. Raises LogError where it is broken or another one than `root`."""
    content = unpacked(path)
    if b"<!ENTITY" in content or b"<!DOCTYPE" in content:
        raise LogError(f"{path}: XML with entities or a document type, expected none in <{root}>")
    try:
        element = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:  # also an unknown encoding
        raise LogError(f"{path}: broken or truncated XML ({error}); expected <{root}>") from error
    if element.tag != root:
        raise LogError(f"{path}: the root element is <{element.tag[:60]}>, expected <{root}>")
    return element
