"""What SUMO takes a configuration for: SUMO reads it and says so, and so nothing here can read it otherwise.

Where an option stands does not matter to SUMO, nor whether as an attribute or as text, by its long name or another.
Names of files it keeps as they were given: in a configuration percent-encoded, relative to its folder, everywhere with
variables of the environment. Call this in a worker process.
"""

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from regents_cosim.simulators.sumo_process import written_by_sumo
from regents_cosim.sources.sumo_words import FILES_READ, NOWHERE
from regents_cosim.system.scratch import scratch_folder

_FILE = "FILE"
_NO_FILES = {"stdout", "stderr", "-", NOWHERE, NOWHERE.lower()}


class NamedOptions(NamedTuple):
    """Options that are set, by their long names."""

    values: dict[str, str]  # as they were given
    files: dict[str, tuple[Path, ...]]  # absolute


def options_of_config(config: Path) -> NamedOptions:
    """Those of a configuration. Raises SumoError with SUMO's own words where it cannot read it."""
    folder = config.absolute().parent
    before = f"{folder}{os.sep}"

    def located(name: str) -> list[Path]:
        given = _with_variables(name.removeprefix(before).strip())
        return [folder / unquote(one.strip()) for one in given.split(",")]

    return _options(["-c", str(config.absolute())], located)


def typed_options(words: Sequence[str]) -> NamedOptions:
    """Those of the command line, relative to the working directory. Raises SumoError where SUMO cannot read them."""
    with scratch_folder() as folder:
        empty = folder / "empty.sumocfg"  # so that they cannot name another one
        empty.write_text("<configuration/>")
        return _options(["-c", str(empty), *words], lambda name: [Path.cwd() / _with_variables(name.strip())])


def path_of(value: str) -> Path:
    """The file that a running simulation says it was given; percent-encoded where no file has that very name."""
    plain = Path(_with_variables(value))
    return plain if plain.exists() else Path(unquote(str(plain)))


def as_value(paths: Sequence[Path]) -> str:
    """Files as a configuration names them."""
    return ",".join(re.sub(r"[%$~,;\s]", lambda found: f"%{ord(found[0]):02x}", str(path)) for path in paths)


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
    """The kind of value that each option has."""
    template = ET.fromstring(written_by_sumo(["--save-template", "stdout"]))
    return {option.tag: option.get("type", "") for section in template for option in section}


def _with_variables(name: str) -> str:
    """With the values of the environment in the place of `${NAME}`, as SUMO has them: nothing for those that are not.

    SUMO's own folder is in the environment where SUMO is loaded.
    """
    name = re.sub("^~", "${HOME}", name)
    return re.sub(r"\$\{(.+?)\}", lambda found: os.environ.get(found[1], ""), name)
