"""Typed values in threads."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
from dataclasses import field, make_dataclass
from threading import Barrier, Thread

import msgspec

from regents_cosim.checks.typed_values import from_json, from_values

sys.setswitchinterval(1e-6)
together = Barrier(4)


def read(kind):
    together.wait()
    values = {"parts": {"a": {"x0": 1.0}}}
    found.append(from_values(values, kind) if len(sys.argv) > 1 else from_json(msgspec.json.encode(values), kind))


for _ in range(30):
    Part = make_dataclass("Part", [(f"x{i}", float | None, None) for i in range(20)])
    Whole = make_dataclass("Whole", [("parts", dict[str, Part], field(default_factory=dict))])
    found = []
    threads = [Thread(target=read, args=(Whole,)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [Whole({"a": Part(x0=1.0)})] * 4
"""


@pytest.mark.parametrize("words", [(), ("values",)])
def test_threads_that_first_read_a_class_at_once_all_get_it(words):
    """A process that msgspec ends by a segmentation fault has a negative exit code."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
