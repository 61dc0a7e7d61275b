"""Settings: the options of a command in a TOML file, which `--config` names, each by its name (`max_jerk = 3.0`).

An option on the command line comes before the file, and the file before the default. What tunes a command is not in its
`--help`, but in the file that `regents config` writes. A file never names code, nor where results go.
"""

import ast
import json
import re
import shlex
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, is_dataclass
from functools import cache
from itertools import chain, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

from cyclopts import Parameter, Token

from regents_cosim.attacks.methods.presets import METHODS
from regents_cosim.cases.shipped import as_named
from regents_cosim.checks.bounded import read_bounded
from regents_cosim.checks.names import did_you_mean, nearest
from regents_cosim.cli.groups import ADVANCED, OUTPUT, RUN
from regents_cosim.errors import InputError, RegentsError
from regents_cosim.plain_text import printable
from regents_cosim.planners.names import is_built_in
from regents_cosim.system.files.output_files import MARK, require_ours
from regents_cosim.system.user_code import names_beside

if TYPE_CHECKING:
    from collections.abc import Container
    from inspect import BoundArguments

    from cyclopts.argument import Argument

_T = TypeVar("_T")
OF_OWN_METHOD = "a setting of a method of your own needs --method with it, on the command line"
_CONFIG = "--config"
_LARGEST = 1 << 16  # bytes
_WIDTH = 110
_IN_BACKTICKS = re.compile(r"`([a-z_]+)`")
_NOTHING = (None, "", ())
_DRIVERS = ("idm", "mdp", "random")  # of an ego in highway-env, which come with it
_IS_NO_CODE: dict[str, Callable[[str], bool]] = {
    "planner": is_built_in,
    "method": METHODS.__contains__,
    "policy": _DRIVERS.__contains__,
}


def takes_file(arguments: "Iterable[Argument]") -> bool:
    """Whether a command reads settings."""
    return any(one.name == _CONFIG for one in arguments)


def settings_of(arguments: "Iterable[Argument]") -> "dict[str, Argument]":
    """What may stand in the file of a command, by name."""
    return {_key(one): one for one in arguments if one.show and _group(one) not in (OUTPUT.name, RUN.name)}


def in_help(arguments: "Iterable[Argument]") -> "list[Argument]":
    """What `--help` of a command shows: of one that reads settings no `Advanced` ones, which are in their file."""
    every = [one for one in arguments if one.show]
    return [one for one in every if _group(one) != ADVANCED.name] if takes_file(every) else every


def read_settings(arguments: "Iterable[Argument]") -> None:
    """Give arguments what the file says that `--config` names, unless the command line does. Raises RegentsError."""
    every = list(arguments)
    named = next((one.tokens for one in every if one.name == _CONFIG), ())
    if not named:
        return
    path, known = Path(named[-1].value), settings_of(every)
    for key, value in _content(path).items():
        if key not in known:
            raise RegentsError(f"{path}: {key} is no setting of it: {_instead(key, every, known)}")
        if not known[key].tokens:
            for token in _tokens(path, key, value, known[key]):
                known[key].append(token)


def method_in(path: Path) -> str:
    """The method of ours that a file names; else empty. Raises RegentsError."""
    method = _content(path).get("method")
    return method if isinstance(method, str) and method in METHODS else ""


def option(key: str) -> str:
    """How a setting is called on the command line."""
    return f"--{key.replace('_', '-')}"


def out_of_place(arguments: "Iterable[Argument]", words: Iterable[str]) -> dict[str, str]:
    """Options on the command line that belong into the file, as they were typed, with their names there."""
    every = list(arguments)
    advanced = [one for one in every if _group(one) == ADVANCED.name] if takes_file(every) else []
    keys = {name: _key(one) for one in advanced for name in one.names}
    typed = dict.fromkeys(word.partition("=")[0] for word in words)
    return {name: keys[name] for name in typed if name in keys}


def in_terms_of(command: str, message: str, arguments: "Iterable[Argument]") -> str:
    """A message for the user of a command: what it names in backticks is an option, or a setting of a file."""
    every = list(arguments)
    shown = {_key(one) for one in in_help(every)}
    hidden = {_key(one) for one in every} - shown
    named = set(_IN_BACKTICKS.findall(message))
    message = _IN_BACKTICKS.sub(lambda one: option(one[1]) if one[1] in shown else one[0], message)
    if not named & hidden:
        return message
    return f"{message}; settings stand in a file that --config names (`regents config {command}` writes one)"


def template(command: str, arguments: "Iterable[Argument]", defaults: Mapping[str, Any]) -> str:
    """A file with every setting of a command, its meaning and its default, which is written but does not count."""
    every = list(arguments)
    about = {id(part): _group(whole) for whole in every for part in whole.children}  # what the options are about
    parts: dict[str, list[str]] = {}
    for key, one in settings_of(every).items():
        value = defaults.get(key, None if one.required else one.field_info.default)
        part = parts.setdefault(about.get(id(one), _group(one)), [])
        part += ["", *_meaning(one), f"#{key} ={'' if value is None else f' {_toml(value)}'}"]
    lines = [
        f"# The settings of `regents {command} {_CONFIG} FILE`. A setting counts once the # before its name is gone.",
        "# What the command line says comes before the file, and the file before the default.",
    ]
    for name, part in parts.items():
        lines += ["", f"## {name}", *part]
    return "\n".join((*lines, ""))


@dataclass(frozen=True)
class Asked:
    """What a command was asked to do, as a file that asks for the same."""

    command: str = ""
    values: dict[str, Any] = field(default_factory=dict)
    sumo: tuple[str, ...] = ()

    @classmethod
    def of(cls, command: str, arguments: "Iterable[Argument]", bound: "BoundArguments") -> "Asked":
        """The values of all that may stand in a file."""
        every, found = list(arguments), dict[str, Any]()
        known = settings_of(every).values()
        for one in every:
            whole = bound.arguments.get(one.field_info.name)
            for part in one.children:
                if part in known:
                    found[_key(part)] = getattr(whole, part.keys[-1])
            if one in known and not one.keys:
                found[_key(one)] = whole
        return cls(command, found, tuple(bound.arguments.get("sumo", ())))

    def text(self, decided: Mapping[str, Any], grown: bool = False) -> str:
        """The file; `decided` are values in place of those that were left to a preset."""
        values = {key: value if key in _IS_NO_CODE else decided.get(key, value) for key, value in self.values.items()}
        code = {key: _foreign(key, value) for key, value in values.items()}
        again = [word for key, names in code.items() for name in names for word in (option(key), name)]
        for_sumo = ("--", *self.sumo) if self.sumo else ()
        where = "--into" if grown else "-o"
        words = shlex.join((*f"regents {self.command} {_CONFIG} THIS_FILE {where} FOLDER".split(), *again, *for_sumo))
        lines = [f"# {MARK}; the same run again: {printable(words, None)}"]
        lines += [f"{key} = {_toml(value)}" for key, value in values.items() if value not in _NOTHING and not code[key]]
        return "\n".join((*lines, ""))

    def keep(self, suite: Path, decided: Mapping[str, Any] = MappingProxyType({}), grown: bool = False) -> None:
        """Write the file into the suite that was made, in place of those of other commands. Raises RegentsError.

        In a suite that has only `grown` those of other commands stay.
        """
        from regents_cosim.cases.manifest import SETTINGS_FILES
        from regents_cosim.system.files.atomic import explain_write, write_atomic

        mine = f"{self.command.partition(' ')[0]}.toml"
        with explain_write(suite):
            for path in (suite / name for name in ([mine] if grown else SETTINGS_FILES)):
                with suppress(RegentsError):  # a file of the user's stays
                    require_ours(path)
                    if path.name == mine:
                        write_atomic(path, self.text(decided, grown).encode(errors="replace"))
                    else:
                        path.unlink(missing_ok=True)


def asks_for(
    config: type, only: "Container[str] | None" = None, shown: "Container[str]" = ()
) -> Callable[[type[_T]], type[_T]]:
    """Make a class an options class with every field of a configuration, none of which has to be given.

    `only` leaves out all others. Those that the class does not name itself are settings, but for those that `--help`
    has `shown`. Their types and words are those of the configuration.
    """

    def complete(options: type[_T]) -> type[_T]:
        for name, (type_, said) in _settings_of(config).items():
            if not hasattr(options, name) and (only is None or name in only):
                told = Parameter(help=said) if name in shown else Parameter(help=said, group=ADVANCED)
                options.__annotations__[name] = Annotated[type_ | None, told]
                setattr(options, name, None)
        return dataclass(frozen=True)(options)

    return complete


def _settings_of(config: type) -> dict[str, tuple[Any, str]]:
    """The types and the words of the fields of a configuration, and of those of its parts."""
    found, words = dict[str, tuple[Any, str]](), _words_of(config)
    for name, type_ in get_type_hints(config, names_beside(config)).items():
        if is_dataclass(type_):
            found |= _settings_of(type_) if isinstance(type_, type) else {}
        elif name in words:
            found[name] = type_, words[name]
    return found


@cache
def _words_of(config: type) -> dict[str, str]:
    """The docstrings of the fields of a dataclass, and of the dataclasses that it is made of."""
    found = dict[str, str]()
    for base in [one for one in reversed(config.__mro__) if is_dataclass(one)]:
        classes = [one for one in _tree(base).body if isinstance(one, ast.ClassDef) and one.name == base.__name__]
        for one, after in pairwise(chain.from_iterable(one.body for one in classes)):
            if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name) and isinstance(after, ast.Expr):
                found[one.target.id] = " ".join(str(ast.literal_eval(after.value)).split())
    return found


@cache
def _tree(config: type) -> ast.Module:
    return ast.parse(Path(names_beside(config)["__file__"]).read_bytes())


def _content(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_bounded(path, _LARGEST).decode())
    except (InputError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        said = str(error)[:200]
        where = "" if said.startswith(str(path)) else f"{path}: "
        raise RegentsError(f"{where}{said} (expected a file as `regents config` writes it)") from None


def _tokens(path: Path, key: str, value: Any, argument: "Argument") -> Iterator[Token]:
    values = value if isinstance(value, list) else [value]
    if not all(isinstance(one, str | int | float) for one in values):
        raise RegentsError(f"{path}: {key} is {value}, expected a number, a text, true or false, or a list of texts")
    words = [one if isinstance(one, str) else _toml(one) for one in values]
    if code := _foreign(key, words):
        raise RegentsError(
            f"{path}: {key} names {code[0]}, which does not come with regents_cosim, and a file names no code that is "
            f"run: expected {option(key)} {code[0]} on the command line"
        )
    if isinstance(value, list) and not argument.token_count()[1]:
        words = [",".join(words)]
    for index, word in enumerate(words):
        yield Token(keyword=key, value=word, source=str(path), index=index)


def _foreign(key: str, value: Any) -> list[str]:
    """Of the names that a setting holds those of code that does not come with us or the simulators."""
    if key not in _IS_NO_CODE:
        return []
    return [name for name in ([value] if isinstance(value, str) else value) if not _IS_NO_CODE[key](name)]


def _instead(key: str, every: "list[Argument]", known: "Mapping[str, Argument]") -> str:
    typed = next((one.name for one in every if _key(one) == key and one.show), None)
    if typed:
        return f"expected {typed} on the command line"
    near = did_you_mean(key, known) if nearest(key, known) else "expected one that `regents config` writes"
    method = known.get("method")
    of_own = method is not None and not method.tokens and not method.get_choices()  # so it may be one of the user's
    return f"{near} ({OF_OWN_METHOD})" if of_own else near


def _meaning(argument: "Argument") -> list[str]:
    chosen = ", ".join(argument.get_choices() or ())
    words = f"{argument.parameter.help or ''}{f' [choices: {chosen}]' if chosen else ''}"
    return [f"# {line}" for line in textwrap.wrap(" ".join(words.split()), _WIDTH, break_long_words=False)]


def _key(argument: "Argument") -> str:
    return argument.name.removeprefix("--").replace("-", "_")


def _group(argument: "Argument") -> str:
    groups: Any = argument.parameter.group or ()
    return next((one.name for one in groups if not isinstance(one, str)), "")


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(_toml, value))}]"
    value = as_named(value) if isinstance(value, Path) else str(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
