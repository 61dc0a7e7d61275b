"""Helpers for logs in XML."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from regents_cosim.checks.xml_input import read_tree
from regents_cosim.errors import LogError


def read_xml(path: Path, *roots: str) -> ET.Element:
    """The root element of a file. Raises LogError where the file is damaged or its root is none of `roots`."""
    element = read_tree(path, f"<{roots[0]}>", LogError)
    if element.tag not in roots:
        raise LogError(f"{path}: the root element is <{element.tag[:60]}>, expected <{roots[0]}>")
    return element


def number_of(text: str | None) -> float:
    """Parse a finite number. Raises ValueError for anything else."""
    value = float(text or "nan")
    if not np.isfinite(value):
        raise ValueError(f"{text!r} is not a number")
    return value


def point_of(element: ET.Element) -> tuple[float, float]:
    """The x and y of an element. Raises ValueError where they are not numbers."""
    return number_of(element.findtext("x")), number_of(element.findtext("y"))
