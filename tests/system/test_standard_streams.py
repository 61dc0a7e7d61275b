"""Stdout has results alone; a reader that is gone causes no traceback and no other exit code."""

import os
import subprocess
import sys

import pytest
from command import REGENTS

PROGRAM = """
import ctypes, sys
from regents_cosim.system.standard_streams import keep_stdout_for_results, results
keep_stdout_for_results()
print("printed")
ctypes.CDLL(None).write(1, b"written in C\\n", 13)
results().write("result\\n")
print("complaint", file=sys.stderr)
results().flush()
print("more", file=sys.stderr)
sys.exit(5)
"""
WORDS = [sys.executable, "-c", PROGRAM]


def test_what_is_printed_goes_to_stderr():
    done = subprocess.run(WORDS, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (5, "result\n")
    assert done.stderr.splitlines() == ["printed", "written in C", "complaint", "more"]


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_leads_nowhere(closed):
    done = subprocess.run(["sh", "-c", f'exec "$@" {closed}', "sh", *WORDS], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (5, "" if ">&-" in closed.split() else "result\n")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("both", [False, True])
def test_a_reader_that_has_gone_changes_no_exit_code(both):
    reader, pipe = os.pipe()
    os.close(reader)
    done = subprocess.run(WORDS, stdout=pipe, stderr=pipe if both else subprocess.PIPE, text=True)
    os.close(pipe)
    assert done.returncode == 5
    assert both or "Traceback" not in done.stderr


def test_letters_that_the_encoding_lacks_are_escaped():
    program = PROGRAM.replace('"result', '"r\u00e9sult').replace("complaint", "\u2026")
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=os.environ | {"PYTHONIOENCODING": "ascii"}
    )
    assert (done.returncode, done.stdout) == (5, "r\\xe9sult\n")
    assert "\\u2026" in done.stderr


@pytest.mark.parametrize("words", [("config", "attack"), ("--help",)])
def test_results_on_a_full_disk_are_wrong_usage(words):
    with open("/dev/full", "w") as full:
        done = subprocess.run([REGENTS, *words], stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (2, "regents: the output: No space left on device (make room for it)\n")


@pytest.mark.slow
def test_a_complaint_on_a_full_disk_is_lost():
    with open("/dev/full", "w") as full:
        assert subprocess.run([REGENTS, "status", "absent"], stderr=full).returncode == 2
