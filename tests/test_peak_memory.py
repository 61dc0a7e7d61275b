"""Memory is that of the process that asks, not of the one that started it."""

import subprocess
import sys
from pathlib import Path

import numpy as np

ASK = "from peak_memory import peak_bytes; print(peak_bytes())"


def peak_of_a_child():
    done = subprocess.run([sys.executable, "-c", ASK], cwd=Path(__file__).parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_a_child_does_not_inherit_its_parents_peak():
    held = np.ones(25_000_000)  # 200 MB
    assert peak_of_a_child() < held.nbytes / 2


def test_what_a_process_had_and_gave_back_counts():
    from peak_memory import peak_bytes

    before = peak_bytes()
    np.ones(before // 4)  # twice as many bytes
    assert peak_bytes() > 1.5 * before
