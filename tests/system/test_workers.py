"""Jobs in processes of their own: what comes back when they end, fail, or die."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

import psutil
import pytest
from params import slow

from regents_cosim.errors import NoWindowError, RegentsError, SumoError
from regents_cosim.system.workers import cores, executor_for, local_processes, result_of, run_each, run_isolated, submit

DIED = "the worker process died without a word"


def fail(kind):
    raise kind("SUMO refused: no such edge")


def die(how):
    {
        "segfault": lambda: os.kill(os.getpid(), signal.SIGSEGV),
        "abort": os.abort,
        "killed": lambda: os.kill(os.getpid(), signal.SIGKILL),
        "exit": lambda: os._exit(1),
    }[how]()


def work(job):
    """Jobs are (name, what to do): every kind of job in one function."""
    name, deed = job
    if deed in ("segfault", "abort", "killed", "exit"):
        die(deed)
    if deed == "fail":
        fail(SumoError)
    if deed == "slow":
        time.sleep(0.3)
    return name, os.getpid(), threading.get_ident()


def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def names(outcomes):
    return [outcome if isinstance(outcome, RegentsError) else outcome[0] for outcome in outcomes]


# --- one job ----------------------------------------------------------------------------------


def test_a_job_runs_in_another_process_that_is_gone_afterwards():
    pid = run_isolated(os.getpid)
    assert pid != os.getpid()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def cores_when_held_to_one():
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    return cores()


def test_a_process_that_may_use_one_core_knows_of_one():
    assert run_isolated(cores_when_held_to_one) == 1


@pytest.mark.parametrize("kind", [RegentsError, SumoError, NoWindowError])
def test_errors_arrive_as_they_were_raised(kind):
    with pytest.raises(kind) as error:
        run_isolated(fail, kind)
    assert type(error.value) is kind
    assert str(error.value) == "SUMO refused: no such edge"


def test_a_bug_is_not_taken_for_an_error_of_the_user():
    with pytest.raises(ZeroDivisionError):
        run_isolated(fail, ZeroDivisionError)
    with pytest.raises(ZeroDivisionError):
        list(run_each(fail, [ZeroDivisionError]))


@pytest.mark.parametrize("how", ["segfault", "abort", "killed", "exit"])
def test_a_death_is_said(how):
    with pytest.raises(RegentsError, match=DIED) as error:
        run_isolated(die, how)
    assert "\n" not in str(error.value)


# --- many jobs --------------------------------------------------------------------------------

JOBS = [("a", "slow"), ("b", "quick"), ("c", "segfault"), ("d", "fail"), ("e", "slow"), ("f", "quick"), ("g", "quick")]


def check_outcomes(outcomes):
    found = names(outcomes)
    assert [found[i] for i in (0, 1, 4, 5, 6)] == ["a", "b", "e", "f", "g"]
    assert DIED in str(found[2])
    assert type(found[3]) is SumoError
    assert str(found[3]) == "SUMO refused: no such edge"


def test_a_death_costs_its_job_only():
    check_outcomes(run_each(work, JOBS))


@pytest.mark.slow
def test_the_last_jobs_may_die_as_well():
    found = names(run_each(work, [(i, "exit" if i % 2 else "quick") for i in range(7)]))
    assert found[::2] == [0, 2, 4, 6]
    assert all(DIED in str(error) for error in found[1::2])


def test_processes_serve_many_jobs():
    pids = {pid for _, pid, _ in run_each(work, [(i, "quick") for i in range(8)])}
    assert len(pids) <= len(os.sched_getaffinity(0))
    assert os.getpid() not in pids


def test_a_process_is_started_only_where_a_job_has_to_wait():
    with local_processes(2) as pool:
        pids = {next(iter(run_each(work, [(i, "quick")], pool)))[1] for i in range(3)}
    assert len(pids) == 1


def test_jobs_are_taken_in_their_turn_and_results_are_not_kept():
    taken = []
    outcomes = run_each(bytes, (taken.append(i) or 4_000_000 for i in range(40)))
    next(outcomes)
    assert len(taken) <= len(os.sched_getaffinity(0)) + 1
    before = resident_mb()
    assert sum(len(outcome) for outcome in outcomes) == 39 * 4_000_000
    assert resident_mb() - before < 40.0  # of 160 MB


def test_no_jobs_no_processes():
    assert list(run_each(work, [])) == []


def test_one_who_stops_listening_leaves_no_process_behind():
    outcomes = run_each(work, [(i, "quick") for i in range(6)])
    _, pid, _ = next(outcomes)
    outcomes.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


@pytest.mark.slow
def test_a_death_costs_its_job_only_in_shared_processes_as_well():
    with local_processes(2) as pool:
        check_outcomes(run_each(work, JOBS, pool))
        assert pool.submit(abs, -1).result() == 1


@pytest.mark.slow
def test_a_pool_of_others_that_breaks_costs_no_other_result():
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        check_outcomes(run_each(work, JOBS, pool))
        with pytest.raises(BrokenExecutor):
            pool.submit(os.getpid)
        check_outcomes(run_each(work, JOBS, pool))  # broken from the start


# --- the caller's script ----------------------------------------------------------------------

SCRIPT = """
import sys, threading
from regents_cosim.system.workers import run_isolated, run_each
from regents_cosim.errors import RegentsError
from regents_cosim.cases.provenance import versions
print("begin")
assert run_isolated(versions) == versions()
assert list(run_each(abs, [-1, -2, -3])) == [1, 2, 3]
found = []
threads = [threading.Thread(target=lambda: found.append(run_isolated(abs, -1))) for _ in range(3)]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert found == [1, 1, 1], found
print("end", globals().get("__file__", "").rpartition("/")[2], getattr(__spec__, "name", None))
"""


@pytest.mark.parametrize(
    ("command", "end"),
    [
        (["script.py"], "end script.py None"),
        slow(["-m", "script"], "end script.py script"),
        slow(["-c", SCRIPT], "end  None"),
    ],
)
def test_a_script_needs_no_guard(tmp_path, command, end):
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run([sys.executable, *command], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    assert done.stdout.splitlines() == ["begin", end]


INTERRUPTED = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # the background jobs of a shell ignore it
from regents_cosim.system.workers import run_each
print("begin", flush=True)
outcomes = run_each(time.sleep, [0.0, 60.0])
next(outcomes)
print("waiting", flush=True)
next(outcomes)
"""


def test_an_interrupt_ends_workers_at_once_and_quietly(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED)
    started = subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert started.stdout is not None
    assert [started.stdout.readline() for _ in range(2)] == ["begin\n", "waiting\n"]
    time.sleep(0.5)
    os.killpg(started.pid, signal.SIGINT)
    _, said = started.communicate(timeout=10)
    assert "SpawnProcess" not in said
    assert said.strip().endswith("KeyboardInterrupt")
    assert said.count("Traceback") == 1  # the script's own


# --- executors by name ------------------------------------------------------------------------


def test_local_means_processes_of_our_own():
    with executor_for("local") as executor:
        assert executor is None


@pytest.mark.parametrize("name", ["", "remote", "dask:", "local:2"])
def test_unknown_executors(name):
    with pytest.raises(RegentsError, match="expected `local`, `dask` or `dask:ADDRESS`"), executor_for(name):
        pass


def test_dask_that_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(RegentsError, match=r"pip install '\.\[dask\]'"), executor_for("dask:tcp://h:1"):
        pass


def test_dask_without_what_makes_its_keys(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(RegentsError, match=r"pip install '\.\[dask\]'"), executor_for("dask"):
        pass


@pytest.mark.parametrize("address", [slow("tcp://127.0.0.1:1"), "nowhere://x"])
def test_a_scheduler_that_does_not_answer(address, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("regents_cosim.system.workers._ANSWERS_S", 1.0)
    with (
        pytest.raises(RegentsError, match=f"no Dask scheduler answers at {address}") as error,
        executor_for(f"dask:{address}"),
    ):
        pass
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_dask_cluster_does_the_same():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=":0", silence_logs=50) as cluster,
        executor_for(f"dask:{cluster.scheduler_address}") as executor,
    ):
        assert executor is not None
        with pytest.raises(SumoError, match="no such edge"):
            result_of(submit(executor, fail, SumoError))
        found = list(run_each(work, [(i, "quick") for i in range(6)], executor))
        assert names(found) == [0, 1, 2, 3, 4, 5]
        assert os.getpid() not in {pid for _, pid, _ in found}
        check_outcomes(run_each(work, JOBS, executor))


@pytest.mark.slow
def test_dask_keeps_nothing_of_jobs_that_are_done():
    pytest.importorskip("distributed")
    with executor_for("dask") as executor:
        held_mb = []
        for _ in run_each(len, (os.urandom(100_000) for _ in range(800)), executor):
            held_mb.append(psutil.Process().memory_info().rss / 1e6)
    assert held_mb[-1] - held_mb[300] < 40.0  # 100 where it keeps what jobs travel with twice
