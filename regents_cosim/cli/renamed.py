"""Options, methods and axes that were renamed or are gone.

An old name still works in this release, and a line on stderr tells the new one. An option that is gone is refused with
what to do instead.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from regents_cosim.errors import RegentsError

RENAMED: dict[tuple[str, ...], dict[str, str]] = {
    ("attack",): {"--type": "--manoeuvre", "--law": "--adversary-may"},
    ("bench", "table1"): {"--law": "--adversary-may"},
    ("evaluate",): {"--against": "--baseline", "--fail": "--fail-on"},
    ("suite", "coverage"): {"--against": "--older"},
    ("replay",): {"--beside-original": "--beside-log"},
    ("inspect",): {"--against": "--compare-with", "--against-fcd": "--compare-with"},
}
_ONE_PLANNER = "attack each planner alone; `regents bench cross` measures whether its crashes crash others"
_METHOD = "name the method: king-code or regents-code"
GONE: dict[tuple[str, ...], dict[str, str]] = {
    ("attack",): {
        "--also-crash": _ONE_PLANNER,
        "--against": _ONE_PLANNER,
        "--universal": _ONE_PLANNER,
        "--as-published": _METHOD,
        "--optimiser": "name the method: random, cma-es or starts",
    },
    ("bench", "cross"): {"--universal": _ONE_PLANNER},
    ("bench", "table1"): {"--as-published": _METHOD},
}
_OPTIMISERS = {"random": "random", "cma-es": "cma-es", "starts": "none"}  # by method; of all others adam


def _is_of_method(value: Any, file: Mapping[str, Any]) -> bool:
    return value == _OPTIMISERS.get(file.get("method", ""), "adam")


# In files of settings, by name: whether a value asks for nothing, and what to do otherwise.
GONE_SETTINGS: dict[str, tuple[Callable[[Any, Mapping[str, Any]], bool], str]] = {
    "also_crash": (lambda value, _: not value, _ONE_PLANNER),
    "universal": (lambda value, _: value == "mean", _ONE_PLANNER),
    "as_published": (lambda value, _: value is False, _METHOD),
    "optimiser": (_is_of_method, "name the method: random, cma-es or starts"),
}
# Constants of Adam and of the papers that files had as settings, with the value that each has.
_CONSTANTS = {
    "beta1": 0.9,
    "beta2": 0.999,
    "behind_rad": 3 * math.pi / 4,
    "front_share": 0.5,
    "front_window_rad": math.pi / 8,
    "rear_share": 0.8,
    "rear_sector_rad": math.pi / 4,
    "static_m": 0.2,
}
GONE_SETTINGS |= {
    name: (lambda said, _, value=value: said == value, f"it is always {value:.4g}")
    for name, value in _CONSTANTS.items()
}
_SETTINGS = {"law": "adversary_may"}
_MAY = {"strict": "mistakes", "any": "anything"}
_LIVE_METHODS = {name: f"{name}-live" for name in ("focused", "regents", "king")}
_Tell = Callable[[str], None]


def with_new_names(words: Sequence[str], tell: _Tell) -> list[str]:
    """The command line with old names replaced; `tell` is called with a line for each of them.

    Raises RegentsError for an option that is gone.
    """
    for word in words:
        option = word.partition("=")[0]
        if option in (gone := _of_command(GONE, words)):
            raise RegentsError(f"{option} is gone: {gone[option]}")
    names = _of_command(RENAMED, words)
    renamed = [_option(word, names, tell) for word in words]
    former = _former_values(renamed)
    return [_values(word, after, former, tell) for after, word in zip(["", *renamed], renamed, strict=False)]


def with_new_setting(key: str, value: Any, tell: _Tell) -> tuple[str, Any]:
    """A setting of a file, by its new name and value."""
    new = _told(key, _SETTINGS, tell)
    return new, _told(value, _MAY, tell) if isinstance(value, str) and new in _SETTINGS.values() else value


def asks_for_nothing(key: str, file: Mapping[str, Any]) -> bool:
    """Whether a setting of a file is gone that asked for nothing. Raises RegentsError where it asked for more."""
    if key not in GONE_SETTINGS:
        return False
    is_nothing, instead = GONE_SETTINGS[key]
    if not is_nothing(file[key], file):
        raise RegentsError(f"setting {key} is gone: {instead}")
    return True


def _of_command(options: dict[tuple[str, ...], dict[str, str]], words: Sequence[str]) -> dict[str, str]:
    return next((names for command, names in options.items() if tuple(words[: len(command)]) == command), {})


def _option(word: str, names: dict[str, str], tell: _Tell) -> str:
    option, equals, value = word.partition("=")
    return f"{_told(option, names, tell)}{equals}{value}" if option in names else word


def _former_values(words: Sequence[str]) -> dict[str, dict[str, str]]:
    """The renamed values of each option of a command."""
    if words[:1] == ["live"]:
        return {"--method": _LIVE_METHODS}
    may = {"--adversary-may": _MAY}
    if not any(word.startswith("--axes") for word in words):
        return may
    from regents_cosim.runs.archive.axes import FORMER_NAMES

    return may | {"--axes": FORMER_NAMES}


def _values(word: str, after: str, former: dict[str, dict[str, str]], tell: _Tell) -> str:
    """The values of an option, given in the same word or the next one, with old names replaced."""
    option, equals, value = ("", "", word) if after in former else word.partition("=")
    names = former.get(after, former.get(option) if equals else None)
    if names is None:
        return word
    return f"{option}{equals}{','.join(_told(name.strip(), names, tell) for name in value.split(','))}"


def _told(name: str, names: dict[str, str], tell: _Tell) -> str:
    if name not in names:
        return name
    tell(f"{name} is now called {names[name]}; the old name will go in the next release")
    return names[name]
