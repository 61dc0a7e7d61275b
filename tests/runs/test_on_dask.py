"""The whole attack on Dask's workers: the same bytes as here, also where a worker dies."""

import os
import signal

import pytest
from test_attack_run import RUN, attack, ends, platoons, tree

from regents_cosim.errors import RegentsError
from regents_cosim.runs.attack_run import attack_left
from regents_cosim.runs.ledger import open_ledger
from regents_cosim.runs.windows import planned, windows_in
from regents_cosim.saving import SuiteWriter
from regents_cosim.system.progress import Silent
from regents_cosim.system.workers import executor_for

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as made:
        yield made


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    return platoons(tmp_path_factory.mktemp("cases") / "cases", 6)


def attack_there(cases, folder, cluster, progress):
    name = f"dask:{cluster.scheduler_address}"
    with open_ledger(folder, RUN.identity({}, 1)) as ledger, executor_for(name) as workers:
        windows = windows_in(cases)
        planned(ledger, windows)
        attack_left(ledger, windows, RUN, SuiteWriter(folder, 0), cluster=workers, progress=progress)
        ledger.finish()


def test_a_worker_that_is_killed_changes_nothing(cases, cluster, tmp_path):
    attack(cases, tmp_path / "here")
    killed = []

    class Kills(Silent):
        def each(self, items, what, total, row=None):
            for window in items:
                if not killed:
                    killed.append(next(iter(cluster.workers.values())).process.pid)
                    os.kill(killed[0], signal.SIGKILL)
                yield window

    attack_there(cases, tmp_path / "there", cluster, Kills())
    assert killed
    assert tree(tmp_path / "there") == tree(tmp_path / "here")


def test_the_command_verifies_and_draws_there(cases, tmp_path):
    words = ("attack", cases, "--method", "regents", "--planner", "idm")
    assert ends(*words, "-o", "here", cwd=tmp_path)
    assert ends(*words, "-o", "there", "--executor", "dask", cwd=tmp_path)
    assert list((tmp_path / "there").glob("*/still.png"))
    assert tree(tmp_path / "there") == tree(tmp_path / "here")


def test_workers_of_another_version_are_named(cluster, monkeypatch):
    monkeypatch.setattr("regents_cosim.system.workers.version", lambda package: "0.0.0")
    with (
        pytest.raises(RegentsError, match=r"tcp://\S+ has regents_cosim \S+, here 0\.0\.0, libsumo"),
        executor_for(f"dask:{cluster.scheduler_address}"),
    ):
        pass
