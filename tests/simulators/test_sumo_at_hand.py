"""One process of SUMO for one job after the other, and none that is left."""

import os
import signal
import threading
import time

import pytest

from regents_cosim.errors import SumoError, WorkerError
from regents_cosim.simulators.sumo.process import end_sumo_process, in_sumo_process


@pytest.fixture(autouse=True)
def ended():
    yield
    end_sumo_process()


def refuse():
    raise SumoError("no")


def told():
    return os.getcwd(), os.environ.get("TOLD"), os.getpid()


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_jobs_share_a_process_until_it_is_ended():
    first = in_sumo_process(os.getpid)
    with pytest.raises(SumoError, match="no"):
        in_sumo_process(refuse)
    assert in_sumo_process(os.getpid) == first != os.getpid()
    end_sumo_process()
    end_sumo_process()
    assert not is_alive(first)
    assert in_sumo_process(os.getpid) != first


def test_it_has_the_folder_and_the_environment_of_now(tmp_path, monkeypatch):
    first = in_sumo_process(os.getpid)
    monkeypatch.setenv("TOLD", "later")
    monkeypatch.chdir(tmp_path)
    assert in_sumo_process(told)[:2] == (str(tmp_path), "later")
    assert not is_alive(first)


def test_one_that_dies_costs_its_job_alone():
    with pytest.raises(WorkerError):
        in_sumo_process(os._exit, 1)
    assert in_sumo_process(abs, -1) == 1


def test_threads_do_not_wait_for_each_other():
    found = []
    other = threading.Thread(target=lambda: (found.append(in_sumo_process(os.getpid)), end_sumo_process()))
    mine = in_sumo_process(os.getpid)
    other.start()
    other.join()
    assert found != [mine]
    assert is_alive(mine)


def test_a_job_that_is_given_up_does_not_go_on():
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        in_sumo_process(time.sleep, 60.0)
    began = time.monotonic()
    end_sumo_process()
    assert time.monotonic() - began < 55.0  # it sleeps for 60
