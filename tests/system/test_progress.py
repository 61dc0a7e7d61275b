"""Who waits is told how far it is: on a terminal, in a notebook, and nowhere else."""

import io
import re
import subprocess
import sys
import threading
import time

import pytest
from on_a_terminal import on_a_terminal

from regents_cosim.system import progress
from regents_cosim.system.progress import SILENT, UncountedWork, progress_for
from regents_cosim.system.progress_bar import Bar, _Pace

COUNTING = """
import sys, time
from regents_cosim.system.progress import progress_for
for number in progress_for({progress}).each(range(3), "counting", 3, "number {{}}".format):
    print("data", number)
    time.sleep({pause})
"""


def counted(progress: object = True, pause: float = 0.0, **how: object) -> tuple[str, str]:
    """What a program prints on stdout, which is no terminal, and on a terminal's stderr."""
    return on_a_terminal([sys.executable, "-c", COUNTING.format(progress=progress, pause=pause)], **how)


def test_a_terminal_has_a_row_for_each_thing_and_stdout_none_of_it():
    data, said = counted()
    assert data == "data 0\ndata 1\ndata 2\n"
    assert [line for line in said.splitlines() if re.match("[0-9]/3 number", line)] == [
        "1/3 number 0", "2/3 number 1", "3/3 number 2",
    ]  # fmt: skip
    assert "counting" in said


def test_a_long_row_breaks_between_words():
    program = COUNTING.format(progress=True, pause=0).replace("number {}", 9 * "a row of many words " + "{}")
    _, said = on_a_terminal([sys.executable, "-c", program], 60)
    lines = said[said.index("1/3 a row") :].splitlines()
    assert max(map(len, lines)) <= 60
    assert 9 * "a row of many words " in " ".join(" ".join(lines).split())


def test_where_it_is_turned_off_nothing_is_said():
    assert counted(progress=False) == ("data 0\ndata 1\ndata 2\n", "")


def test_a_file_or_a_pipe_gets_nothing():
    done = subprocess.run(
        [sys.executable, "-c", COUNTING.format(progress=True, pause=0)], capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("data 0\ndata 1\ndata 2\n", "")


def test_one_that_tells_in_its_own_way_is_asked():
    assert progress_for(SILENT) is SILENT
    assert progress_for(False) is SILENT


def test_the_time_that_is_left_is_told_of_what_comes_after_the_first(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("regents_cosim.system.progress_bar.monotonic", lambda: now[0])
    pace = _Pace()
    assert pace.left_s(5) is None
    now[0] = 190.0  # programs were compiled
    pace.note()
    assert pace.left_s(5) is None
    now[0] = 200.0
    pace.note()
    assert pace.left_s(5) == pytest.approx(30.0)
    now[0] = 204.0
    assert pace.left_s(5) == pytest.approx(26.0)
    assert pace.left_s(None) is None


def test_what_a_thread_is_at_is_told_from_others_until_it_ends():
    doing, begun, go_on = UncountedWork(), threading.Event(), threading.Event()

    def work() -> None:
        doing.begin("outer")
        doing.begin("inner")
        doing.end()
        begun.set()
        go_on.wait(10.0)
        doing.end()

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait(10.0)
    time.sleep(0.01)
    assert doing.now(after_s=0.0) == "outer"
    assert doing.now(after_s=60.0) == ""
    go_on.set()
    thread.join()
    assert doing.now(after_s=0.0) == ""
    doing.end()  # of nothing


def test_what_lasts_where_no_bar_is_shown_is_told_once(monkeypatch):
    monkeypatch.setattr(progress, "_SHOWN_AFTER_S", 0.02)
    doing, told, heard = UncountedWork(), [], threading.Event()
    doing.tell_once(lambda what: (told.append(what), heard.set()))
    doing.begin("compiling")
    assert heard.wait(30.0)
    doing.end()
    doing.tell_once(told.append)
    doing.begin("more of it")
    time.sleep(0.3)
    assert told == ["compiling"]


def test_a_bar_within_a_bar_says_nothing(monkeypatch):
    page = io.StringIO()
    monkeypatch.setattr("sys.stderr", page)
    outer = Bar().each(range(2), "outer", 2, "outer {}".format)
    next(outer)
    list(Bar().each(range(2), "inner", 2, "inner {}".format))
    outer.close()
    list(Bar().each(range(1), "after", 1, "after {}".format))
    assert "outer 0" in page.getvalue()
    assert "inner" not in page.getvalue()
    assert "after 0" in page.getvalue()


class _Output:
    def __init__(self) -> None:
        self.shown: list[str] = []

    def update(self, data: dict[str, str], raw: bool) -> None:
        assert raw
        self.shown.append(data["text/plain"])


def test_a_notebook_has_the_same_as_text_in_one_output(monkeypatch):
    output = _Output()
    shell = type("ZMQInteractiveShell", (), {})()
    kernel = type(sys)("IPython")
    kernel.get_ipython = lambda: shell
    display = type(sys)("IPython.display")
    display.display = lambda data, raw, display_id: (output.update(data, raw), output)[1]
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr("regents_cosim.system.progress_bar._REFRESHED_S", 0.02)
    page = io.StringIO()
    monkeypatch.setattr("sys.stderr", page)
    for _ in progress_for(True).each(range(2), "counting", 2, "number {}".format):
        time.sleep(0.1)
    assert output.shown[-1].splitlines() == ["1/2 number 0", "2/2 number 1"]
    assert any("counting" in text and "1/2 number 0" in text for text in output.shown[:-1])
    assert page.getvalue() == ""
