"""Renamed options and axes. An old name still works in this release, and a line on stderr tells the new one."""

from collections.abc import Callable, Sequence

RENAMED: dict[tuple[str, ...], dict[str, str]] = {
    ("attack",): {"--type": "--manoeuvre", "--against": "--also-crash"},
    ("evaluate",): {"--against": "--baseline"},
    ("suite", "coverage"): {"--against": "--older"},
    ("replay",): {"--beside-original": "--beside-log"},
    ("inspect",): {"--against": "--compare-with", "--against-fcd": "--compare-with"},
}
_Tell = Callable[[str], None]


def with_new_names(words: Sequence[str], tell: _Tell) -> list[str]:
    """The command line with old names replaced; `tell` is called with a line for each of them."""
    names = next((names for command, names in RENAMED.items() if tuple(words[: len(command)]) == command), {})
    renamed = [_option(word, names, tell) for word in words]
    return [_axes(word, after, tell) for after, word in zip(["", *renamed], renamed, strict=False)]


def _option(word: str, names: dict[str, str], tell: _Tell) -> str:
    option, equals, value = word.partition("=")
    return f"{_told(option, names, tell)}{equals}{value}" if option in names else word


def _axes(word: str, after: str, tell: _Tell) -> str:
    """The value of `--axes`, given in the same word or the next one, with old names replaced."""
    option, equals, value = ("", "", word) if after == "--axes" else word.partition("=")
    if after != "--axes" and (option, equals) != ("--axes", "="):
        return word
    from regents_cosim.runs.archive.axes import FORMER_NAMES

    return f"{option}{equals}{','.join(_told(name.strip(), FORMER_NAMES, tell) for name in value.split(','))}"


def _told(name: str, names: dict[str, str], tell: _Tell) -> str:
    if name not in names:
        return name
    tell(f"{name} is now called {names[name]}; the old name will go in the next release")
    return names[name]
