"""The command line: options in, calls of the package, tables out. Nothing else lives here.

Heavy imports happen inside the commands, so that `--help` answers at once, and `main` sees to Ctrl-C before any other.
What follows `--` goes to SUMO. Exit codes stand in `errors`.
"""

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from regents_cosim.errors import WRONG_USAGE, RegentsError
from regents_cosim.interruption import end_at_once
from regents_cosim.plain_text import one_line

if TYPE_CHECKING:
    from cyclopts import CycloptsError

_FOR_SUMO = (["record"], ["attack"])


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Our words, and those after `--`, which are SUMO's."""
    words = list(arguments)
    at = words.index("--") if "--" in words else len(words)
    return words[:at], words[at + 1 :]


def run(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    from cyclopts import CycloptsError

    from regents_cosim.cli.application import app
    from regents_cosim.cli.run_log import end_run_log

    mine, for_sumo = _split(arguments)
    if for_sumo and mine[:1] not in _FOR_SUMO:
        return _complain("what follows -- goes to the SUMO that `record` and `attack` start: leave it out", WRONG_USAGE)
    words = [*mine, *(f"--sumo-option={word}" for word in for_sumo)]
    try:
        code = app(words, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _complain(f"{error} ({_where_to_look(error, mine)})", WRONG_USAGE)
    except RegentsError as error:
        return _complain(str(error), error.exit_code)
    except BrokenPipeError:  # whoever read the table has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:  # of a name that the file system does not take, say, wherever it is first used
        if error.filename is None:
            raise
        return _complain(f"{error.filename}: {error.strerror} (choose another file or folder)", WRONG_USAGE)
    code = code if isinstance(code, int) else 0
    end_run_log(code)
    return code


def _where_to_look(error: "CycloptsError", mine: Sequence[str]) -> str:
    from cyclopts import UnknownOptionError

    place = f"see `regents {' '.join(mine[:1])} --help`"
    mistaken = isinstance(error, UnknownOptionError) and mine[:1] in _FOR_SUMO
    return f"{place}; SUMO's own options go behind --, at the end" if mistaken else place


def main() -> None:
    """Entry point `regents`."""
    end_at_once()
    sys.exit(run(sys.argv[1:]))


def _complain(message: str, code: int) -> int:
    from regents_cosim.cli.run_log import end_run_log

    print(one_line(f"regents: {message}"), file=sys.stderr)
    end_run_log(code, message)
    return code
