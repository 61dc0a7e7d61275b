"""Every error a user can cause: what was found, what was expected, what to do next.

The command line prints the message on one line and exits with `exit_code`; no traceback.
"""

from pathlib import Path

from regents_cosim.plain_text import printable

# The exit codes of `regents`; 0 is a clean end, 130 one by Ctrl-C, 143 one by SIGTERM.
NEGATIVE_VERDICT = 1  # a crash that did not transfer, a regression, a suite that fails its check
WRONG_USAGE = 2
MISSING_DEPENDENCY = 3
PLANNER_FAILED = 4  # in at least one case; the others are done


class RegentsError(Exception):
    """Wrong usage or input. The message is one line of 500 printable characters at most, whatever it quotes."""

    exit_code = WRONG_USAGE

    def __init__(self, message: object = "") -> None:
        # Gymnasium's vector environments raise it again with itself as the message.
        super().__init__(printable(" ".join(str(message).split("\n"))))


class MissingDependencyError(RegentsError):
    """An optional package, or a library of the system, that is not installed."""

    exit_code = MISSING_DEPENDENCY


def install_hint(extra: str) -> str:
    """The command that brings what an extra of ours needs, from a checkout: nothing is released yet."""
    return f"pip install '.[{extra}]'"


class InputError(RegentsError):
    """A file that is missing, no regular file, damaged, or larger than what we read."""


class CaseError(RegentsError):
    """A case or suite on disk that cannot be read."""


class ScenarioError(RegentsError):
    """Values that do not form a valid Scenario."""


class SumoError(RegentsError):
    """SUMO could not be started, refused its input, or died."""


class WorkerError(RegentsError):
    """A process that worked for us died."""


class LogError(RegentsError):
    """A log of traffic that cannot be read."""


class NoWindowError(RegentsError):
    """The traffic holds no window that can be attacked."""


class PlannerError(RegentsError):
    """A planner that cannot be found or that failed."""


class DriveError(PlannerError):
    """A planner that failed in one scene, and its own traceback."""

    exit_code = PLANNER_FAILED

    def __init__(self, message: str, trace: str = "") -> None:
        super().__init__(message)
        self.trace = trace


def require(condition: bool, message: str, error: type[RegentsError] = ScenarioError) -> None:
    """Raise `error(message)` unless `condition` holds."""
    if not condition:
        raise error(message)


def require_file(path: Path, what: str) -> Path:
    """Return `path` if it is a readable file, otherwise raise with what was expected there."""
    try:
        is_there, is_file = path.exists(), path.is_file()
    except OSError as error:  # a name that is too long for the file system
        raise RegentsError(f"{what} cannot be looked up: {path} ({error.strerror or error})") from error
    if not is_there:
        raise RegentsError(f"{what} not found: {path} (expected an existing file; check the path)")
    if not is_file:
        raise RegentsError(f"{what} is not a file: {path}")
    return path
