"""Memory is that of the process that asks, not of the one that started it."""

import subprocess
import sys

import numpy as np
from places import SUPPORT

MB = 10**6


def peak_of_a_child(before="pass"):
    code = f"from peak_memory import peak_bytes; {before}; print(peak_bytes())"
    done = subprocess.run([sys.executable, "-c", code], cwd=SUPPORT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_a_child_does_not_inherit_its_parents_peak():
    held = np.ones(200 * MB // 8)
    assert peak_of_a_child() < held.nbytes / 2


def test_what_a_process_had_and_gave_back_counts():
    assert peak_of_a_child(f"held = b'1' * {100 * MB}; del held") > 100 * MB
