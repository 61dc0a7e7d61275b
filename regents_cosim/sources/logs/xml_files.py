"""XML of logs: one root."""

import xml.etree.ElementTree as ET
from pathlib import Path

from regents_cosim.errors import LogError
from regents_cosim.sources.xml_input import read_tree


def read_xml(path: Path, root: str) -> ET.Element:
    """The root of a file. Raises LogError where it is broken or another one than `root`."""
    element = read_tree(path, f"<{root}>", LogError)
    if element.tag != root:
        raise LogError(f"{path}: the root element is <{element.tag[:60]}>, expected <{root}>")
    return element
