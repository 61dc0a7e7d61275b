"""A process that code in C ends by `exit` fails and says so; one that ends as Python ends is left alone."""

import subprocess
import sys

import pytest

CODE = """
import ctypes, os, sys, threading
from regents_cosim.system.c_exit import fail_at_exit_of_c
from regents_cosim.system.foreign_code import foreign_code

take_back = fail_at_exit_of_c(lambda: print("told", flush=True))
in_c = ctypes.CDLL(None).exit
holding_the_lock = ctypes.PyDLL(None).exit

def in_a_thread():
    thread = threading.Thread(target=in_c, args=(0,))
    thread.start()
    thread.join()

def as_foreign_code():
    with foreign_code(lambda error: AssertionError()):
        in_a_thread()

def in_a_fork():
    child = os.fork()
    if child == 0:
        in_c(3)
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))

def taken_back():
    take_back()
    in_c(3)

{}
"""


@pytest.mark.parametrize(
    ("way", "code", "said"),
    [
        ("in_c(0)", 70, "told\n"),
        ("holding_the_lock(0)", 70, "told\n"),
        ("in_a_thread()", 70, "told\n"),
        ("as_foreign_code()", 70, "told\n"),
        ("in_a_fork()", 3, ""),
        ("taken_back()", 3, ""),
        ("", 0, ""),
        ("sys.exit(5)", 5, ""),
        ("os._exit(6)", 6, ""),
    ],
)
def test_only_an_exit_of_c_fails(way, code, said):
    done = subprocess.run([sys.executable, "-c", CODE.format(way)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (code, said, "")
