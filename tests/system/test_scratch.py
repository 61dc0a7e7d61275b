"""Temporary folders: private, gone afterwards, and gone after a kill when the next run asks for one."""

import os
import signal
import stat
import subprocess
import sys
import tempfile

from regents_cosim.system.files.atomic import scratch_folder

HOLD = """
import sys, time
from regents_cosim.system.files.atomic import scratch_folder
with scratch_folder() as folder:
    (folder / "net.xml").write_text("<net/>")
    print(folder, flush=True)
    time.sleep(60)
"""
ASK = "from regents_cosim.system.files.atomic import scratch_folder\nwith scratch_folder(): pass"


def holder(place):
    """A process that holds a folder in `place`, and the folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True, env=os.environ | {"TMPDIR": str(place)}
    )
    return process, process.stdout.readline().strip()


def ask(place):
    subprocess.run([sys.executable, "-c", ASK], check=True, env=os.environ | {"TMPDIR": str(place)})


def test_it_is_private_and_gone_afterwards():
    with scratch_folder() as folder:
        assert str(folder).startswith(tempfile.gettempdir())
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        (folder / "deep").mkdir()
    assert not folder.exists()


def test_it_is_where_temporary_files_are_now(tmp_path, monkeypatch):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / name))
        with scratch_folder() as folder:
            assert folder.parent == tmp_path / name


def test_the_next_run_removes_what_a_killed_one_left_and_nothing_of_one_that_lives(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    (dead, left), (living, held) = holder(tmp_path), holder(tmp_path)
    try:
        dead.send_signal(signal.SIGKILL)
        dead.wait()
        assert os.path.exists(left)
        ask(tmp_path)
        assert not os.path.exists(left)
        assert os.path.exists(held)
    finally:
        living.kill()
        living.wait()
        for process in (dead, living):
            process.stdout.close()
    ask(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
