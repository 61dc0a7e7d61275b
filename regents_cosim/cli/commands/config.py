"""`regents config`: the settings of a command, to be edited and given back with `--config`."""

import shlex
from typing import TYPE_CHECKING, Any, Literal

from regents_cosim.attacks.methods.presets import preset
from regents_cosim.cli.options import OutputIfAny
from regents_cosim.cli.settings import template
from regents_cosim.system.standard_streams import results
from regents_cosim.training.lessons.train_config import TrainConfig

if TYPE_CHECKING:
    from cyclopts import App

COMMANDS = {"attack": "attack", "record": "record", "train": "train aim-bev", "suite": "suite build"}


def config(
    command: Literal["attack", "record", "train", "suite"], *, method: str = "focused", output: OutputIfAny = None
) -> int:
    """Write all settings of a command, each with its meaning and its default, as a file for `--config`.

    Parameters
    ----------
    command
        attack, record, train (aim-bev) or suite (build)
    method
        for attack: the method whose values are written as defaults
    output
        file to write (.toml); by default stdout
    """
    from regents_cosim.cli.application import app
    from regents_cosim.system.files.atomic import explain_write, write_atomic
    from regents_cosim.system.files.output_files import require_ours

    words = COMMANDS[command]
    arguments = named(app, words).assemble_argument_collection(parse_docstring=True)
    decided: dict[str, dict[str, Any]] = {"attack": preset(method).settings, "train": vars(TrainConfig())}
    of_method = f" --method {shlex.quote(method)}" if command == "attack" and method != "focused" else ""
    text = template(f"{words}{of_method}", arguments, decided.get(command, {}))
    if output is None:
        results().write(text)
        return 0
    require_ours(output)
    with explain_write(output.parent):
        write_atomic(output, text.encode())
    return 0


def named(family: "App", words: str) -> "App":
    """The command below `family` that is called so, `suite build` for one."""
    for word in words.split():
        family = family[word]
    return family
