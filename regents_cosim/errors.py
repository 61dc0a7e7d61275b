"""Every error that a user can cause; a message says what was found, what was expected and what to do next.

The command line prints the message on one line, without a traceback, and exits with `exit_code`.
"""

from pathlib import Path

from regents_cosim.plain_text import printable

# The exit codes of `regents`. Besides these, 0 is a clean end, 70 an end by C's `exit` (`system/c_exit.py`), 130 one by
# Ctrl-C, 143 one by SIGTERM.
NEGATIVE_VERDICT = 1  # a replay without the crash, a regression, a damaged suite
WRONG_USAGE = 2
MISSING_DEPENDENCY = 3
PLANNER_FAILED = 4  # the planner failed in at least one case; the other cases are done


class RegentsError(Exception):
    """Wrong usage or input; the message is one line of at most 500 printable characters."""

    exit_code = WRONG_USAGE

    def __init__(self, message: object = "") -> None:
        # Gymnasium's vector environments raise the error again and pass the error itself as the message.
        super().__init__(printable(" ".join(str(message).split("\n"))))


class MissingDependencyError(RegentsError):
    """An optional package or a system library is not installed."""

    exit_code = MISSING_DEPENDENCY


def install_hint(extra: str) -> str:
    """The command that installs an optional extra from a checkout, as no release exists yet."""
    return f"pip install '.[{extra}]' in the repository of regents_cosim"


class InputError(RegentsError):
    """A file is missing, is not a regular file, is damaged, or is larger than the limit."""


class CaseError(RegentsError):
    """A case or suite on disk cannot be read."""


class ScenarioError(RegentsError):
    """Values do not form a valid Scenario."""


class SumoError(RegentsError):
    """SUMO did not start, refused its input, or died."""


class WorkerError(RegentsError):
    """A worker process died."""


class LogError(RegentsError):
    """A log of traffic cannot be read."""


class NoWindowError(RegentsError):
    """The traffic holds no window that can be attacked."""


class PlannerError(RegentsError):
    """A planner cannot be found, or it failed."""


class DriveError(PlannerError):
    """A planner failed in one scene; `trace` is the planner's own traceback."""

    exit_code = PLANNER_FAILED

    def __init__(self, message: str, trace: str = "") -> None:
        super().__init__(message)
        self.trace = trace


def require(condition: bool, message: str, error: type[RegentsError] = ScenarioError) -> None:
    """Raise `error(message)` unless `condition` holds."""
    if not condition:
        raise error(message)


def require_file(path: Path, what: str) -> Path:
    """Return `path` if it is an existing file, otherwise raise RegentsError with `what` was expected there."""
    try:
        is_there, is_file = path.exists(), path.is_file()
    except OSError as error:  # a name that is too long for the file system
        raise RegentsError(f"{what} cannot be looked up: {path} ({error.strerror or error})") from error
    if not is_there:
        raise RegentsError(f"{what} not found: {path} (expected an existing file; check the path)")
    if not is_file:
        raise RegentsError(f"{what} is not a file: {path}")
    return path
