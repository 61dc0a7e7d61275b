"""Code from outside: whatever it does to leave becomes an error, but for a real interrupt."""

import _thread
import os
import signal
import subprocess
import sys
import threading
import time
import weakref

import pytest

from regents_cosim.errors import InputError
from regents_cosim.planners.interface import Control
from regents_cosim.system import foreign_code as module
from regents_cosim.system.foreign_code import foreign_code, has_left_threads, said_by

FORKS = """
import os
from regents_cosim.system.foreign_code import foreign_code
with foreign_code(lambda error: AssertionError()):
    child = os.fork()
    if child == 0:
        os._exit(7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


class _AskedError(Exception):
    pass


def _failed(error):
    return _AskedError(type(error).__name__)


@pytest.mark.parametrize("kind", [SystemExit, KeyboardInterrupt, GeneratorExit, StopIteration, ValueError])
def test_whatever_it_raises_is_an_error(kind):
    with pytest.raises(_AskedError, match=kind.__name__), foreign_code(_failed):
        raise kind(0)


def test_our_own_errors_say_what_they_say():
    with pytest.raises(InputError, match="no file"), foreign_code(_failed):
        raise InputError("no file")


@pytest.mark.parametrize(("value", "hint"), [(Control(0.0, 0.0), " (did you mean accel?)"), (object(), "")])
def test_what_a_value_of_ours_lacks_is_said_with_what_it_has(value, hint):
    with pytest.raises(AttributeError) as raised:
        _ = value.acel
    assert said_by(raised.value) == f"AttributeError: {raised.value}{hint}"


def test_leaving_python_is_an_error_also_of_code_that_calls_such_code():
    with pytest.raises(_AskedError, match="_AskedError"), foreign_code(_failed), foreign_code(_failed):
        os._exit(0)


THREAD = """
import os, threading
from regents_cosim.system.foreign_code import foreign_code

def leave():
    go.wait()
    os._exit(7)

go = threading.Event()
thread = threading.Thread(target=leave)
if {before}:
    thread.start()
with foreign_code(lambda error: AssertionError()):
    if not {before}:
        thread.start()
    if {within}:
        go.set()
        thread.join()
go.set()
thread.join()
print("still here")
"""


@pytest.mark.parametrize("within", [True, False])
@pytest.mark.parametrize("before", [True, False])
def test_threads_that_it_starts_do_not_end_the_process_and_those_of_before_may(before, within):
    code = THREAD.format(before=before, within=within)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == ((7, "") if before else (0, "still here\n")), done.stderr


def test_a_thread_of_c_does_not_end_the_process_meanwhile():
    """Python knows no such thread, even once it has asked who it is; XLA's are of this kind."""
    raised = []

    def called_back():
        threading.current_thread()
        try:
            with foreign_code(_failed):
                pass
            os._exit(0)
        except SystemExit as error:
            raised.append(error)

    with foreign_code(_failed):
        _thread.start_new_thread(called_back, ())
        while not raised:
            time.sleep(0.001)


def test_a_process_that_it_forks_leaves_as_it_likes():
    done = subprocess.run([sys.executable, "-c", FORKS], capture_output=True, text=True)
    assert done.stdout == "7\n", done.stderr


def test_a_real_interrupt_goes_through():
    with pytest.raises(KeyboardInterrupt), foreign_code(_failed):
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_real_interrupt_goes_through_where_the_code_makes_something_else_of_it():
    def hides_it():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise ValueError from error

    with pytest.raises(KeyboardInterrupt), foreign_code(_failed):
        hides_it()


def test_threads_that_it_leaves_are_known_until_they_end(monkeypatch):
    monkeypatch.setattr(module, "_theirs", weakref.WeakSet())  # other tests may have left some
    go = threading.Event()
    with foreign_code(_failed):
        thread = threading.Thread(target=go.wait)
        thread.start()
    assert has_left_threads()
    go.set()
    thread.join()
    assert not has_left_threads()
