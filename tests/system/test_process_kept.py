"""A process is what it was before, whatever the module of a user has set while it was imported."""

import gc
import logging
import os
import signal
import sys
import threading
import warnings

import jax
import numpy as np
import pytest

from regents_cosim.errors import PlannerError
from regents_cosim.planners.under_test import PlannerUnderTest
from regents_cosim.system.process_kept import process_kept

PLANNER = """
class P:
    def reset(self, scene): pass
    def act(self, observation): pass
"""
STATEMENTS = [
    "sys.setrecursionlimit(150)",
    "signal.setitimer(signal.ITIMER_REAL, 1.0, 1.0)",
    "faulthandler.dump_traceback_later(1.0, exit=True)",
    "jax.config.update('jax_disable_jit', True)",
    "jax.config.update('jax_enable_x64', True)",
    "warnings.simplefilter('error')",
    "logging.disable()",
    "np.seterr(all='raise')",
    "gc.disable()",
    "sys.stdout = sys.stderr = None",
    "threading.setprofile(lambda *given: 1 / 0)",
    "sys.path.clear()",
    "os.chdir('/')",
]


def state():
    return (
        sys.getrecursionlimit(), signal.getitimer(signal.ITIMER_REAL), jax.config.values.copy(), warnings.filters[:],
        logging.root.manager.disable, np.geterr(), gc.isenabled(), sys.stdout, sys.stderr, threading.getprofile(),
        sys.path[:], os.getcwd(),
    )  # fmt: skip


@pytest.mark.parametrize("fails", ["", "raise ValueError"])
@pytest.mark.parametrize("statement", STATEMENTS)
def test_what_a_module_sets_ends_with_its_import(tmp_path, monkeypatch, statement, fails):
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    imports = "import faulthandler, gc, jax, logging, numpy as np, os, signal, sys, threading, warnings"
    (tmp_path / "sets.py").write_text(f"{imports}\n{statement}\n{fails}\n{PLANNER}")
    before = state()
    try:
        PlannerUnderTest.of(f"{tmp_path}/sets.py:P")
    except PlannerError:
        assert fails
    assert state() == before


def test_the_process_is_afterwards_what_it_was(tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    here, handler = os.stat("."), signal.getsignal(signal.SIGTERM)
    gone.rmdir()
    with process_kept():
        os.chdir("/")
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    assert os.path.samestat(os.stat("."), here)
    assert signal.getsignal(signal.SIGTERM) is handler
    monkeypatch.chdir(tmp_path)


def test_a_module_that_hides_one_of_python_is_forgotten(tmp_path, monkeypatch):
    """`this` stands for any that the process has not imported yet."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "this.py").write_text("MINE = True\n")
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib/antigravity.py").write_text("MINE = True\n")
    (tmp_path / "only_here.py").write_text("MINE = True\n")
    (tmp_path / "plans.py").write_text(
        f"import sys\nsys.path.insert(0, {str(tmp_path / 'lib')!r})\nimport this, antigravity, only_here\n"
        f"assert this.MINE and antigravity.MINE\n{PLANNER}"
    )
    PlannerUnderTest.of(f"{tmp_path}/plans.py:P")
    assert not {"this", "antigravity"} & sys.modules.keys()
    assert sys.modules.pop("only_here").MINE
    assert sys.path[-2:] == [str(tmp_path / "lib"), str(tmp_path)]
