"""`--verbose` and `--log-file`: the package's log messages on stderr and in a file."""

import contextlib
import logging
import os
import sys
from pathlib import Path
from time import perf_counter

from regents_cosim.cases.provenance import command, versions
from regents_cosim.cli.options import OutputOptions
from regents_cosim.errors import RegentsError
from regents_cosim.plain_text import printable
from regents_cosim.system.files.output_files import MARK, require_ours

_PACKAGE = logging.getLogger("regents_cosim")
_log = logging.getLogger(__name__)


class _OneLine(logging.Formatter):
    """Formats each record as one line, whatever names it contains."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record), limit=None)


class _File(logging.FileHandler):
    """Writes to a file; a failure to write is reported once, and does not stop the run."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self.begin_s = perf_counter()

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 (the name is logging's)
        from regents_cosim.cli.terminal import complain

        _PACKAGE.removeHandler(self)
        with contextlib.suppress(OSError):
            self.close()
        complain(f"cannot write {self.baseFilename} any more: the log ends here")


def begin_run_log(talk: OutputOptions) -> None:
    """Log to stderr and to a file, as the options say. Raises RegentsError for a file that cannot be written."""
    if not (talk.verbose or talk.log_file):
        return
    end_run_log()
    if talk.verbose:
        _tell(logging.StreamHandler(sys.stderr), "%(asctime)s %(message)s", "%H:%M:%S")
    if talk.log_file:
        _tell(_opened(talk.log_file), "%(asctime)s %(levelname)s %(name)s: %(message)s", "%Y-%m-%dT%H:%M:%S%z")
    _PACKAGE.setLevel(logging.INFO)
    _log.info("%s with %s", MARK, ", ".join(f"{name} {number}" for name, number in versions().items()))
    _log.info("%s", command())


def end_run_log(code: int | None = None, complaint: str = "") -> None:
    """Write to the file how the run ended; stderr already shows it."""
    ours = [handler for handler in _PACKAGE.handlers if isinstance(handler.formatter, _OneLine)]
    for handler in ours:
        if not isinstance(handler, _File):
            _PACKAGE.removeHandler(handler)
            continue
        if complaint:
            _log.error("%s", complaint)
        if code is not None:
            _log.info("exit code %d after %.1f s", code, perf_counter() - handler.begin_s)
        _PACKAGE.removeHandler(handler)
        handler.close()
    if ours:
        _PACKAGE.setLevel(logging.NOTSET)


def _tell(handler: logging.Handler, form: str, times: str) -> None:
    handler.setFormatter(_OneLine(form, times))
    _PACKAGE.addHandler(handler)


def _opened(path: Path) -> logging.Handler:
    if path.is_file():  # otherwise it is a device, or new
        require_ours(path.resolve())
    if path.is_symlink() and not path.exists():
        raise RegentsError(f"--log-file {path}: is a link to a file that is not there (choose another file)")
    try:
        if path.is_fifo():  # opening it would wait for ever without a reader
            os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))
        return _File(path)
    except OSError as error:
        raise RegentsError(f"--log-file {path}: {error.strerror} (choose another file)") from error
