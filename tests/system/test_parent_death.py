"""Children end with their parent, whatever ends it, and not before."""

import os
import signal
import subprocess
import sys
import time

import pytest

# The parent starts a child in a thread that ends, as pools do; the child is busy as asked.
PARENT = """
import ctypes, multiprocessing, os, sys, threading, time
from regents_cosim.system.processes import die_with_parent
from regents_cosim.system.workers import main_hidden

def child():
    die_with_parent()
    print(os.getpid(), flush=True)
    if sys.argv[1] == "in foreign code":  # which never lets another thread of Python run
        ctypes.PyDLL(None).sleep(60)
    time.sleep(60)

if __name__ == "__main__":
    process = multiprocessing.get_context("spawn").Process(target=child)
    thread = threading.Thread(target=process.start)
    thread.start()
    thread.join()
    if sys.argv[2] == "exits":
        sys.stdin.readline()
        os._exit(0)
    process.join()
"""


def is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="looks processes up in /proc")
@pytest.mark.parametrize("busy", ["asleep", "in foreign code"])
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, "exits"])
def test_a_child_ends_with_its_parent(tmp_path, busy, how):
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    parent = subprocess.Popen([sys.executable, script, busy, str(how)], text=True, **pipes)
    assert parent.stdin is not None
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    time.sleep(0.3)
    assert is_running(child)  # although the thread that started it is gone
    parent.stdin.close()  # it exits then, where it is to
    if how != "exits":
        parent.send_signal(how)
    parent.wait()
    deadline = time.monotonic() + 20.0
    while is_running(child) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not is_running(child)
    parent.stdout.close()
