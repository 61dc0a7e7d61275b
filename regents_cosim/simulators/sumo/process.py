"""Starts and closes libsumo; no other module does. Call it in a worker process (`workers`), such as the one that
`in_sumo_process` keeps for the next job, since loading SUMO takes time.

SUMO prints messages about its input to the terminal; here they are captured, and given as the reason when it fails.
"""

import os
import re
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import IO, Any, NamedTuple, ParamSpec, TypeVar

from regents_cosim.errors import MissingDependencyError, RegentsError, SumoError
from regents_cosim.system.workers import LocalProcesses, local_processes, result_of, submit

# Shared libraries that the wheel links but does not contain, found with ldd for SUMO 1.28.0.
_DEBIAN_PACKAGES = "libgl1 libx11-6 libxext6 libxrender1 libatomic1 libexpat1"

TESTED_SUMO = ((1, 24), (1, 28))  # the oldest and the newest version that is tested

# SUMO's options for reporting vehicles that touch, while they drive on and none is removed.
CRASHES_STAY = {
    "time-to-teleport": "-1",
    "collision.action": "warn",
    "collision.mingap-factor": "0",
    "collision.check-junctions": "true",
    "no-step-log": "true",
    "no-warnings": "true",
}

_ONE_SIMULATION = threading.Lock()  # libsumo would silently replace the running one


def load_libsumo() -> ModuleType:
    """Import libsumo. Raises MissingDependencyError that names the Debian packages where it cannot load."""
    os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")  # without it, libsumo prints to stdout
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # libsumo 1.24 warns, and crashes where warnings are errors
            import libsumo
    except ImportError as error:
        raise MissingDependencyError(
            f"SUMO's library cannot be loaded ({error}). The wheel needs system libraries; "
            f"on Debian or Ubuntu: apt-get install {_DEBIAN_PACKAGES}"
        ) from error
    return libsumo


def untested_sumo() -> str | None:
    """A one-line message about a SUMO of an untested version; None where it is tested or there is none.

    SUMO is not imported. If `PYTHONPATH` names the tools of a SUMO that was installed without pip, that one counts.
    """
    found = find_spec("libsumo")
    if found is None or found.origin is None:
        return None
    try:
        installed = distribution("libsumo")
    except PackageNotFoundError:
        installed = None
    first, last = (".".join(map(str, version)) for version in TESTED_SUMO)
    tested = f"regents_cosim is tested with the packages libsumo {first} to {last}"
    if installed is None or Path(found.origin).parent != Path(str(installed.locate_file("libsumo"))):
        place = Path(found.origin).parent
        return f"libsumo comes from {place}, not from pip: {tested}; take SUMO's tools out of PYTHONPATH"
    version = tuple(int(number) for number in re.findall(r"\d+", installed.version)[:2])
    if TESTED_SUMO[0] <= version <= TESTED_SUMO[1]:
        return None
    return (
        f"SUMO {installed.version} is installed: {tested}; replays are verified all the same, other numbers may differ"
    )


def require_display() -> None:
    """Raise RegentsError where sumo-gui would find no display."""
    if not os.environ.get("DISPLAY"):
        raise RegentsError("sumo-gui needs a display, and DISPLAY is not set (leave out --gui, or use --record)")


def as_words(options: Mapping[str, str]) -> list[str]:
    """Options by their names as words of a command line."""
    return [word for name, value in options.items() for word in (f"--{name}", value)]


@contextmanager
def running_sumo(options: Sequence[str], gui: bool = False) -> Iterator[ModuleType]:
    """A started simulation, closed at the end. Raises SumoError with SUMO's own words.

    `options` are SUMO's command-line options. One simulation per process: a second one, in another thread, waits for
    the first to end.
    """
    if gui:
        require_display()
    with _ONE_SIMULATION, _output_kept() as output:
        libsumo = load_libsumo()
        try:
            libsumo.start(["sumo-gui" if gui else "sumo", *options])
            yield libsumo
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:  # FatalTraCIError is raised while it runs
            raise _refusal(output, error) from error
        finally:
            if not gui:  # closing sumo-gui may never return (seen once with 1.28.0); it ends with the process
                libsumo.close()


def more_traffic(sumo: Any) -> bool:
    """Whether a running simulation expects more road users; SUMO does not count what calibrators may bring."""
    return bool(sumo.simulation.getMinExpectedNumber() or sumo.calibrator.getIDList())


def written_by_sumo(options: Sequence[str]) -> bytes:
    """The XML that SUMO writes to `stdout` when it prints its options instead of running.

    `options` are command-line options, including `--save-configuration stdout` or `--save-template stdout`. Raises
    SumoError with SUMO's own words where it cannot read them or runs a simulation instead.
    """
    with _ONE_SIMULATION, _output_kept() as output:
        libsumo = load_libsumo()
        try:
            libsumo.simulation.load([*options])
        except libsumo.TraCIException as error:
            raise _refusal(output, error) from error
        output.seek(0)
        said = output.read()
        begin = said.rfind(b"<?xml")
        if begin < 0:
            raise SumoError("SUMO was asked for a simulation, and not for its version or its help")
        return said[begin:]


def _refusal(output: IO[bytes], error: Exception) -> SumoError:
    return SumoError(f"SUMO refused: {' '.join((_reason(output) or str(error)).split())}")


@contextmanager
def _output_kept() -> Iterator[IO[bytes]]:
    """Redirect this process's file descriptors 1 and 2 to a file while the block runs."""
    with tempfile.TemporaryFile() as output:
        sys.stdout.flush()
        sys.stderr.flush()
        saved = [os.dup(1), os.dup(2)]
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
        try:
            yield output
        finally:
            for target, source in enumerate(saved, start=1):
                os.dup2(source, target)
                os.close(source)


def _reason(output: IO[bytes]) -> str:
    """SUMO's error lines, else its last lines, as one line."""
    sys.stdout.flush()
    output.seek(0)
    lines = [line.strip() for line in output.read().decode(errors="replace").splitlines() if line.strip()]
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
    lines = [line for line in lines if not line.startswith(("Warning:", "Quitting"))]
    return " ".join(errors or lines[-2:])


# --- a process with SUMO, kept for the next job -------------------------------------------------------------

_P = ParamSpec("_P")
_R = TypeVar("_R")


class _AtHand(NamedTuple):
    """The process, and the surroundings that it was started with."""

    process: LocalProcesses
    surroundings: tuple[str, dict[str, str]]  # working directory and environment variables, which the process keeps


class _OfThread(threading.local):
    """State of one thread."""

    kept: _AtHand | None = None


_mine = _OfThread()


def in_sumo_process(function: Callable[_P, _R], /, *args: _P.args, **kwargs: _P.kwargs) -> _R:
    """Call `function` in the process. Raises what it raises, or WorkerError where the process dies."""
    surroundings = (os.getcwd(), dict(os.environ))
    if _mine.kept is not None and _mine.kept.surroundings != surroundings:
        end_sumo_process()
    if _mine.kept is None:
        _mine.kept = _AtHand(local_processes(1), surroundings)
    return result_of(submit(_mine.kept.process, function, *args, **kwargs))


def end_sumo_process() -> None:
    """End the process, even in the middle of a job; the next job starts another."""
    kept, _mine.kept = _mine.kept, None
    if kept is not None:
        kept.process.shutdown(wait=False)
