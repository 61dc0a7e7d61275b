"""The tables of the command line, made from the parser when the site is built: one table a command."""

from collections.abc import Iterator
from typing import Any

from cyclopts import App
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

from regents_cosim.cli.application import app, shown_default
from regents_cosim.cli.settings import in_help, settings_of, takes_file

MARKER = "<!-- a table for each command -->"
_SHARED = ("--quiet", "--json", "--wide", "--verbose", "--log-file")  # every command has them


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The page with the tables in place of the marker."""
    return markdown.replace(MARKER, "\n".join(_tables(app, ("regents",)))) if MARKER in markdown else markdown


def _tables(family: App, words: tuple[str, ...]) -> Iterator[str]:
    """A section for each command below `family`, its subcommands included."""
    for name in family:
        if name.startswith("-"):
            continue
        command, path = family[name], (*words, name)
        if command.default_command is None:
            yield from _tables(command, path)
        else:
            says = _cell(command.help.partition("Parameters\n")[0])
            yield from (f"### {' '.join(path)}", "", says, "", *_rows(command), "")


def _rows(command: App) -> Iterator[str]:
    """The rows of the options that a command does not share with all others, then of those in its file alone."""
    every = list(command.assemble_argument_collection(parse_docstring=True))
    shown = in_help(every)
    yield from ("| option | default | what it does |", "|---|---|---|")
    yield from (_row(one, " ".join(f"`{name}`" for name in _names(one))) for one in shown if one.name not in _SHARED)
    if takes_file(every):
        yield from ("", "| setting in the file | default | what it does |", "|---|---|---|")
        yield from (_row(one, f"`{key}`") for key, one in settings_of(every).items() if one not in shown)


def _row(one: Any, name: str) -> str:
    default = "required" if one.required else _default(one)
    chosen = ", ".join(one.get_choices() or ())
    return f"| {name} | {default} | {_cell(one.parameter.help or '')}{f' ({chosen})' if chosen else ''} |"


def _names(argument: Any) -> list[str]:
    """How it is typed: a positional argument by its name in capitals, a switch by its two names."""
    if argument.index is not None:
        return [argument.name.removeprefix("--").replace("-", "_").upper()]
    return [name for name in argument.names if not name.startswith("--empty-")]


def _default(argument: Any) -> str:
    field = argument.field_info
    return "" if field.default is field.empty else _cell(shown_default(field.default) or "")


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())
