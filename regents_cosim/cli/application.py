"""Runs a command: all commands together, the exit code of one, and an error as one line."""

import errno
import math
import os
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cyclopts import App, CycloptsError, Parameter, UnknownOptionError, UnusedCliTokensError

from regents_cosim.cases.shipped import ALL_NETWORKS
from regents_cosim.cli.commands.attack import attack, attack_by
from regents_cosim.cli.commands.bench import bench
from regents_cosim.cli.commands.config import config
from regents_cosim.cli.commands.evaluate import evaluate
from regents_cosim.cli.commands.export import export
from regents_cosim.cli.commands.inspect import inspect, status
from regents_cosim.cli.commands.live import live
from regents_cosim.cli.commands.record import record
from regents_cosim.cli.commands.replay import replay
from regents_cosim.cli.commands.report import report
from regents_cosim.cli.commands.suite import suites
from regents_cosim.cli.commands.train import training
from regents_cosim.cli.groups import ADVANCED
from regents_cosim.cli.run_log import end_run_log
from regents_cosim.cli.settings import OF_OWN_METHOD, Asked, in_terms_of, method_in, out_of_place, read_settings
from regents_cosim.errors import WRONG_USAGE, RegentsError
from regents_cosim.plain_text import listed
from regents_cosim.planners.names import is_built_in
from regents_cosim.simulators.sumo.process import untested_sumo
from regents_cosim.system.standard_streams import results

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions


_MOST_NAMED = 5  # options in a note
_SHOWN = 20  # characters around one that cannot be written


def shown_default(value: object) -> str | None:
    """The text of a default in `--help`, or None for a trivial one; tuples appear as they are typed."""
    if value is None or value is False or value in ("", ()):
        return None
    return " ".join(map(str, value)) if isinstance(value, tuple) else "on" if value is True else str(value)


def _require_plain_numbers(_: object, value: object) -> None:
    """Reject infinite and NaN numbers, and negative ones, which no option of ours accepts.

    Narrower ranges are checked elsewhere.
    """
    if is_dataclass(value):  # options that several commands share
        free = getattr(value, "may_be_negative", ())
        for one in fields(value):
            name = f"--{one.name.replace('_', '-')} is "
            _require_plain(getattr(value, one.name), name, negative=one.name in free)
    for one in value if isinstance(value, tuple) else (value,):
        _require_plain(one, "")


def _require_plain(value: object, name: str, negative: bool = False) -> None:
    if isinstance(value, int | float) and not (math.isfinite(value) and (negative or value >= 0)):
        raise ValueError(f"{name}{value}, expected a {'finite number' if negative else 'number of 0 or more'}")


class _Flowing:
    """Renders help with lines broken at the terminal's width instead of where the docstring breaks them.

    Options that are settings of a file are left out.
    """

    def __init__(self, settings: bool = False) -> None:
        self.settings = settings

    def __call__(self, console: "Console", options: "ConsoleOptions", panel: "HelpPanel") -> None:
        from cyclopts.help.formatters import DefaultFormatter
        from rich.text import Text

        if self.settings and panel.title == ADVANCED.name:
            return
        for entry in panel.entries:
            text = getattr(entry.description, "primary_renderable", None)
            if isinstance(text, Text):
                text.plain = " ".join(text.plain.split())
        DefaultFormatter()(console, options, panel)

    def render_usage(self, console: "Console", options: "ConsoleOptions", usage: Any) -> None:
        """Render the usage line."""
        from cyclopts.help.formatters import DefaultFormatter

        DefaultFormatter().render_usage(console, options, usage)


app = App(
    name="regents",
    help="Crash-test driving planners: ordinary traffic in, a verified crash out.",
    help_format="plaintext",
    help_formatter=_Flowing(),
    help_epilogue=(
        "Exit codes: 0 success; 1 a check failed (a replay did not show the crash, a planner got worse, a suite is "
        "damaged); 2 wrong usage or input; 3 an optional package or a system library is missing; 4 a planner failed in "
        "at least one case, the others are done; 70 a planner ended the command with C's exit; 130 interrupted; 143 "
        "terminated."
    ),
    version=lambda: version("regents_cosim"),
    default_parameter=Parameter(
        negative_bool=(), negative_iterable=(), show_default=shown_default, validator=_require_plain_numbers
    ),
)
for _command in (record, inspect, attack, replay, export, report, evaluate, live, status, config):
    app.command(_command)
for _family in (training, suites, bench):
    app.command(_family)
for _app in (app["record"], app["attack"], suites["build"], training["aim-bev"]):
    _app.help_formatter = _Flowing(settings=True)


app.config = (lambda _app, _command, arguments: read_settings(arguments),)

_FOR_SUMO = (["record"], ["attack"], ["live"])
_WITH_SUMO = ("record", "attack", "replay", "evaluate", "live", "bench")


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The arguments before `--`, which are ours, and those after it, which are SUMO's."""
    words = list(arguments)
    at = words.index("--") if "--" in words else len(words)
    return words[:at], words[at + 1 :]


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    mine, for_sumo = _split(arguments)
    if for_sumo and mine[:1] not in _FOR_SUMO:
        return _complain(
            "what follows -- goes to the SUMO that `record`, `attack` and `live` start: leave it out", WRONG_USAGE
        )
    if mine[:1] and mine[0] in _WITH_SUMO and (note := untested_sumo()):
        _note(note)
    try:
        code = _call([*mine, *(f"--sumo-option={word}" for word in for_sumo)])
        results().flush()
    except CycloptsError as error:
        return _complain(f"{_said(error, mine)} ({_where_to_look(error, mine)})", WRONG_USAGE)
    except RegentsError as error:
        known = app.parse_commands(mine)[1][-1].assemble_argument_collection()
        return _complain(in_terms_of("".join(mine[:1]), str(error), known), error.exit_code)
    except UnicodeEncodeError as error:  # Python shows bytes that are not UTF-8 as surrogates
        found = error.object[max(error.start - _SHOWN, 0) : error.end + _SHOWN]
        return _complain(f"a file or folder has a name that is not UTF-8, …{found}…: rename it", WRONG_USAGE)
    except OSError as error:  # for example a name that the file system rejects, wherever it is first used
        if error.errno == errno.ENOSPC:
            os.dup2(os.open(os.devnull, os.O_WRONLY), results().fileno())  # for what is still to be printed
            return _complain(f"{error.filename or 'the output'}: {error.strerror} (make room for it)", WRONG_USAGE)
        if error.filename is None:
            raise
        return _complain(f"{error.filename}: {error.strerror} (choose another file or folder)", WRONG_USAGE)
    code = code if isinstance(code, int) else 0
    end_run_log(code)
    return code


def _call(words: list[str]) -> Any:
    """Parse and do it; a command that wants to know what it was asked for as a whole is told."""
    _meet_method(words)
    command, bound, unparsed = app.parse_args(words, exit_on_error=False, print_error=False)
    names, apps, _ = app.parse_commands(words)
    if command is not apps[-1].default_command:  # help, or the version
        with redirect_stdout(results()):
            return command(*bound.args, **bound.kwargs)
    arguments = apps[-1].assemble_argument_collection()
    if "asked" in unparsed:
        bound.apply_defaults()
        bound.arguments["asked"] = Asked.of(" ".join(names), arguments, bound)
    code = command(*bound.args, **bound.kwargs)
    if left := out_of_place(arguments, words):
        _note(
            f"{listed(list(left), _MOST_NAMED)} will leave the command line in the next release: expected "
            f"{listed(list(left.values()), _MOST_NAMED)} in a file that --config names (`regents config` writes one)"
        )
    return code


def _meet_method(words: Sequence[str]) -> None:
    """Let `attack` take the fields of the method that the words name, or their file. Raises RegentsError."""
    method = _value_of("--method", words) if words[:1] in (["attack"], ["config"]) else ""
    if words[:1] == ["attack"] and not method and (file := _value_of("--config", words)):
        method = method_in(Path(file))
    app["attack"].default_command = attack_by(method) if method else attack
    names = [one.name for one in app["attack"].assemble_argument_collection() if one.show] if method else []
    if twice := [name for name in set(names) if names.count(name) > 1]:
        raise RegentsError(f"method {method!r} has a field that is called like {twice[0]}: expected another name")


def _value_of(option: str, words: Sequence[str]) -> str:
    both = [word.partition("=") for word in words]
    values = [value if equals else after for (name, equals, value), after in zip(both, [*words[1:], ""], strict=True)
              if name == option]  # fmt: skip
    return values[-1] if values else ""


def _said(error: CycloptsError, mine: Sequence[str]) -> str:
    """What is wrong with the words of a command; a network or planner without its option is named with it."""
    if not (isinstance(error, UnusedCliTokensError) and error.unused_tokens):
        return str(error)
    word = error.unused_tokens[0]
    option = f"-c shipped:{word}" if word in ALL_NETWORKS else f"--planner {word}" if is_built_in(word) else ""
    known = {name for one in app.parse_commands(mine)[1][-1].assemble_argument_collection() for name in one.names}
    return f"{word}: " + (f"did you mean {option}?" if option.partition(" ")[0] in known else "expected an option")


def _where_to_look(error: CycloptsError, mine: Sequence[str]) -> str:
    place = f"see `{' '.join(['regents', *app.parse_commands(mine)[0]])} --help`"
    if not isinstance(error, UnknownOptionError) or mine[:1] not in _FOR_SUMO:
        return place
    own = "" if mine[:1] != ["attack"] or _value_of("--method", mine) else f"; {OF_OWN_METHOD}"
    return f"{place}{own}; SUMO's own options go behind --, at the end"


def _note(message: str) -> None:
    _say(f"note: {message}")


def _complain(message: str, code: int) -> int:
    _say(message)
    end_run_log(code, message)
    return code


def _say(message: str) -> None:
    from regents_cosim.cli.terminal import complain

    complain(message)
