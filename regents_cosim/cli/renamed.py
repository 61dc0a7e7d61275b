"""Options with a new name. The old name still works in this release; one line on stderr tells the new one."""

from collections.abc import Callable, Sequence

RENAMED: dict[tuple[str, ...], dict[str, str]] = {
    ("attack",): {"--type": "--manoeuvre", "--against": "--also-crash"},
    ("evaluate",): {"--against": "--baseline"},
    ("suite", "coverage"): {"--against": "--older"},
    ("inspect",): {"--against-fcd": "--against"},
}


def with_new_names(words: Sequence[str], tell: Callable[[str], None]) -> list[str]:
    """The words of a command line with each old option name replaced; `tell` gets a line for each that is."""
    names = next((names for command, names in RENAMED.items() if tuple(words[: len(command)]) == command), {})
    return [_new(word, names, tell) for word in words]


def _new(word: str, names: dict[str, str], tell: Callable[[str], None]) -> str:
    option, equals, value = word.partition("=")
    if option not in names:
        return word
    tell(f"{option} is now called {names[option]}; the old name will go in the next release")
    return f"{names[option]}{equals}{value}"
