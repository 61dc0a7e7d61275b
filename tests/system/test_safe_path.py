"""Whatever we start, no module of the working directory is imported: it may be a stranger's suite."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from params import slow
from scenes import scene
from shipped_cases import crash_on
from trapped_folder import trapped_folder

from regents_cosim.saving import SuiteWriter

BIN = Path(sys.executable).parent
HEAD = """
import os, sys
from pathlib import Path
from regents_cosim.system.workers import executor_for, local_processes, result_of, run_each, run_isolated, submit
"""
HOST = """
from regents_cosim.cases.files import load_case
from regents_cosim.planners.hosting.host_process import HostProcess
from regents_cosim.planners.interface import Scene
host = HostProcess(MINE)
host.reset([Scene.of(load_case(Path(CASE)), 6.0, 0.3)])
host.close()
"""
SPAWNS = {
    "a job": "assert run_isolated(os.getcwd) == os.getcwd()",
    "jobs in turn": "assert list(run_each(abs, [-1, -2, -3])) == [1, 2, 3]",
    "in a process that we started": "assert run_isolated(run_isolated, abs, -1) == 1",
    "an executor of others": """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
run_isolated(abs, -1)  # has started multiprocessing's tracker of resources, which this executor would start by itself
with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
    assert result_of(submit(pool, abs, -1)) == 1
""",
    "Dask": """
with executor_for("dask") as pool:
    assert result_of(submit(pool, run_isolated, abs, -1)) == 1
    assert Path(result_of(submit(pool, os.getcwd))) == Path.cwd()
""",
    "Dask's worker after it died": """
import signal
if __name__ == "__main__":  # Dask starts it again at a time of its own
    with executor_for("dask") as pool:
        assert list(run_each(abs, [-1], pool)) == [1]
        for worker in list(pool._client.cluster.workers.values()):
            os.kill(worker.process.pid, signal.SIGKILL)
        assert list(run_each(abs, [-1, -2], pool)) == [1, 2]
""",
    "the process of a planner": HOST,
    "a command that is a planner": "MINE = f'exec:{sys.executable} {EXEC}'" + HOST,
    "SUMO, step by step": """
from regents_cosim.cases.files import load_case
from regents_cosim.replays.sumo.replay import CaseToPlay
from regents_cosim.replays.sumo.session import SumoSession
session = SumoSession()
session.begin(CaseToPlay(load_case(Path(CASE))))
session.close()
""",
}


@pytest.fixture
def trap(tmp_path):
    """The folder that all is started in, which is a suite as well."""
    with trapped_folder(tmp_path / "trap") as folder:
        SuiteWriter(folder, 0).add(scene((0.0, 0.0, 10.0), (30.0, 0.0, 10.0)))
        yield folder


def started(command, folder, **more):
    done = subprocess.run(
        list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=120, env=os.environ | more
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("how", [slow(name) if "Dask" in name else name for name in SPAWNS])
def test_a_process_that_is_started_imports_nothing_of_the_working_directory(trap, tmp_path, how):
    (tmp_path / "mine.py").write_text("class P:\n    reset = act = lambda self, given: None\n")
    (tmp_path / "answers.py").write_text("for line in open(0):\n    print('{\"ok\": true}', flush=True)\n")
    script = tmp_path / "script.py"
    names = {"MINE": f"{tmp_path}/mine.py:P", "EXEC": tmp_path / "answers.py", "CASE": crash_on("crossing")}
    given = "".join(f"{name} = {str(value)!r}\n" for name, value in names.items())
    script.write_text(HEAD + given + SPAWNS[how])
    started([sys.executable, script], trap)


COMMANDS = {
    "record": ["record", "-c", "shipped:crossing", "--count", "1", "--horizon", "5", "-o", "OUT"],
    "evaluate": ["evaluate", "CASE", "--planner", "MINE"],
    "replay": ["replay", "CASE"],
}


@pytest.mark.slow
@pytest.mark.parametrize("words", list(COMMANDS.values()), ids=list(COMMANDS))
def test_a_command_imports_nothing_of_the_working_directory(trap, tmp_path, words):
    (tmp_path / "mine.py").write_text("from regents_cosim.planners.idm import IDM as P\n")
    meant = {"OUT": tmp_path / "out", "CASE": crash_on("crossing"), "MINE": f"{tmp_path}/mine.py:P"}
    started([BIN / "regents", *(meant.get(word, word) for word in words)], trap)


@pytest.mark.slow
def test_pytest_imports_nothing_of_the_working_directory_for_a_suite(trap, tmp_path):
    (tmp_path / "mine.py").write_text("from regents_cosim.planners.idm import IDM as P\n")
    words = [
        f"--regents-planner={tmp_path}/mine.py:P",
        "--regents-update",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:jaxtyping",
    ]
    said = started([BIN / "pytest", f"--regents-suite={trap}", "--regents-in=sumo", *words], trap)
    assert "1 passed" in said


def test_a_planner_of_the_working_directory_is_found_where_it_is_named(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "planner.py").write_text("class P:\n    reset = act = lambda self, given: None\n")
    (tmp_path / "script.py").write_text(
        HEAD + f"CASE = {str(crash_on('crossing'))!r}\nMINE = 'mine.planner:P'\n" + HOST
    )
    started([sys.executable, "-P", tmp_path / "script.py"], tmp_path)
