"""Lets SUMO itself read a configuration and print its options, so that both read it alike.

To SUMO it does not matter where an option stands in the file, whether it is an attribute or text, or which of its names
is used. Names of files stay as given: percent-encoded and relative to the folder in a configuration, and everywhere
with environment variables. Call this in a worker process.
"""

import contextlib
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from regents_cosim.errors import SumoError, require
from regents_cosim.simulators.sumo.process import written_by_sumo
from regents_cosim.simulators.sumo.words import FILES_READ, NOWHERE
from regents_cosim.system.files.atomic import scratch_folder

_FILE = "FILE"
_FALSE = {"false", "0", "no", "off", "-", "f", ""}  # SUMO's words for false, and an option that is not given
_NO_FILES = {"stdout", "stderr", "-", NOWHERE, NOWHERE.lower()}


MESOSCOPIC = (
    "a mesoscopic simulation (mesosim), whose vehicles stand in queues and have no place or heading of their own; "
    "expected a microscopic one"
)


class NamedOptions(NamedTuple):
    """Options that are set, by their long names."""

    values: dict[str, str]  # as given
    files: dict[str, tuple[Path, ...]]  # absolute


def options_of_config(config: Path) -> NamedOptions:
    """The options of a configuration. Raises SumoError with SUMO's own words where it cannot read the file."""
    folder = config.absolute().parent

    def located(name: str) -> list[Path]:
        return [folder / unquote(one.strip()) for one in _with_variables(name.strip()).split(",")]

    with contextlib.chdir(folder):  # of the folder's name SUMO would take commas and variables apart
        return _options(["-c", config.name], located)


def typed_options(words: Sequence[str]) -> NamedOptions:
    """The options of the command line, relative to the working directory. Raises SumoError where SUMO rejects them."""
    with scratch_folder() as folder:
        empty = folder / "empty.sumocfg"  # an empty one, so that the options cannot name another
        empty.write_text("<configuration/>")
        return _options(["-c", str(empty), *words], lambda name: [Path.cwd() / _with_variables(name.strip())])


def is_on(value: str) -> bool:
    """Whether a value, as given, turns a boolean option on."""
    return value.strip().lower() not in _FALSE


def path_of(value: str) -> Path:
    """The path for a file name that a running simulation reports; percent-decoded unless a file has that very name."""
    plain = Path(_with_variables(value))
    return plain if plain.exists() else Path(unquote(str(plain)))


def as_value(paths: Sequence[Path]) -> str:
    """Paths in the form in which a configuration names files. Raises SumoError for one with a comma."""
    for path in paths:
        require("," not in str(path), f"{path}: SUMO takes names of files apart at commas; expected none", SumoError)
    return ",".join(re.sub(r"[%$~;\s]", lambda found: f"%{ord(found[0]):02x}", str(path)) for path in paths)


def _options(words: list[str], located: Callable[[str], list[Path]]) -> NamedOptions:
    values, files = {}, {}
    for section in ET.fromstring(written_by_sumo([*words, "--save-configuration", "stdout"])):
        for option in section:
            name, value = option.tag, option.get("value", "")
            parts = [part for part in value.split(",") if part.strip()]
            is_place = name in FILES_READ or not any(part in _NO_FILES or ":" in part for part in parts)
            if is_place and _kinds().get(name) == _FILE:
                files[name] = tuple(path for part in parts for path in located(part))
            else:
                values[name] = value
    return NamedOptions(values, files)


@cache
def _kinds() -> dict[str, str]:
    """The type of each option's value, by the option's name."""
    template = ET.fromstring(written_by_sumo(["--save-template", "stdout"]))
    return {option.tag: option.get("type", "") for section in template for option in section}


def _with_variables(name: str) -> str:
    """Replace `${NAME}` by the environment variable as SUMO does: by nothing where it is not set.

    The environment contains SUMO's own folder where SUMO is loaded.
    """
    name = re.sub("^~", "${HOME}", name)
    return re.sub(r"\$\{(.+?)\}", lambda found: os.environ.get(found[1], ""), name)
