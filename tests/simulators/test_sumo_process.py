"""The only door to libsumo: what it says, what it swallows, what it leaves behind."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from places import NETS

from regents_cosim.errors import RegentsError, SumoError
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.system.workers import run_isolated

NET = str(NETS / "crossing" / "crossing.net.xml")
CONFIG = str(NETS / "crossing" / "crossing.sumocfg")


def steps(*options, count=3):
    """Time and vehicles after some steps."""
    with running_sumo(options) as sumo:
        for _ in range(count):
            sumo.simulationStep()
        return sumo.simulation.getTime(), len(sumo.vehicle.getIDList())


def interpreter(code, **environment):
    """A fresh Python, which is a worker process of its own."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment, timeout=60
    )


# --- running ----------------------------------------------------------------------------------


def start_again_and_again():
    return [steps("-c", CONFIG, count=50) for _ in range(3)]


def test_one_process_runs_many_simulations_one_after_another():
    runs = run_isolated(start_again_and_again)
    assert runs[0] == runs[1] == runs[2]
    assert runs[0][0] == pytest.approx(5.0)


def start_after_failures():
    for options in (["-c", "none.sumocfg"], ["--bogus"]):
        with pytest.raises(SumoError):
            steps(*options)
    with pytest.raises(ZeroDivisionError), running_sumo(["-n", NET]):
        _ = 1 / 0
    return steps("-n", NET)


@pytest.mark.slow
def test_a_failure_leaves_the_process_fit_for_the_next():
    assert run_isolated(start_after_failures) == run_isolated(steps, "-n", NET)


def start_in_threads():
    """Simulations of different length at the same time, each stepping slowly."""
    found = {}

    def work(count):
        with running_sumo(["-n", NET, "--step-length", "0.1"]) as sumo:
            for _ in range(count):
                sumo.simulationStep()
                time.sleep(0.01)
            found[count] = sumo.simulation.getTime()

    threads = [threading.Thread(target=work, args=(count,)) for count in (5, 10, 20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def test_threads_take_turns():
    assert run_isolated(start_in_threads) == {5: pytest.approx(0.5), 10: pytest.approx(1.0), 20: pytest.approx(2.0)}


# --- what SUMO says ---------------------------------------------------------------------------

REFUSALS = {
    ("--bogus", "1"): "SUMO refused: .*bogus",
    ("-n", "none.net.xml"): "SUMO refused: .*none.net.xml.*not accessible",
    ("-n", NET, "--step-length", "soon"): "SUMO refused: .*soon",
    ("-n", NET, "--step-length", "-1"): "SUMO refused: .*step-length",
    ("-n", CONFIG): "SUMO refused: ",
    (): "SUMO refused: ",
}


@pytest.mark.parametrize("options", REFUSALS, ids=lambda options: " ".join(map(os.path.basename, options)))
def test_a_refusal_is_one_line_of_sumos_own_words(options):
    with pytest.raises(SumoError, match=REFUSALS[options]) as error:
        run_isolated(steps, *options)
    said = str(error.value)
    assert "\n" not in said
    assert "Error:" not in said
    assert len(said) > len("SUMO refused: ") + 10


def misuse(what):
    with running_sumo(["-n", NET]) as sumo:
        sumo.simulationStep()
        what(sumo)


def ask_for_nobody(sumo):
    sumo.vehicle.getSpeed("nobody")


def test_a_refusal_while_it_runs_is_said_too():
    with pytest.raises(SumoError, match="SUMO refused: .*nobody"):
        run_isolated(misuse, ask_for_nobody)


def test_input_that_fails_while_it_runs_is_said(tmp_path):
    routes = tmp_path / "x.rou.xml"
    routes.write_text(
        '<routes><vehicle id="a" depart="0"><route edges="west_in"/></vehicle>'
        '<vehicle id="late" depart="300"><route edges="nowhere"/></vehicle></routes>'
    )
    with pytest.raises(SumoError, match="SUMO refused: .*nowhere"):
        run_isolated(steps, "-n", NET, "-r", str(routes), count=400)


# --- nothing leaks ----------------------------------------------------------------------------

TALKATIVE = f"""
import os, sys
from regents_cosim.simulators.sumo.process import running_sumo
print("before", flush=True)
with running_sumo(["-c", {CONFIG!r}, "--verbose", "--duration-log.statistics"]) as sumo:
    sumo.simulationStep()
    print("between")
    os.system("echo from below; echo from below >&2")
print("after")
print("after", file=sys.stderr)
"""


def test_nothing_of_sumo_reaches_the_terminal():
    done = interpreter(TALKATIVE)
    assert done.returncode == 0
    assert done.stdout.split() == ["before", "after"]
    assert done.stderr.split() == ["after"]


FAILING = f"""
from regents_cosim.errors import RegentsError, SumoError
from regents_cosim.simulators.sumo.process import running_sumo
try:
    with running_sumo(["-n", {NET!r}, "--nonsense"]):
        pass
except SumoError:
    print("refused")
"""


def test_nothing_reaches_the_terminal_when_it_refuses():
    done = interpreter(FAILING)
    assert (done.stdout, done.stderr) == ("refused\n", "")


def count_open_files():
    steps("-n", NET)
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        steps("-n", NET)
    return len(os.listdir("/proc/self/fd")) - before


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts files the Linux way")
def test_no_file_stays_open():
    assert run_isolated(count_open_files) == 0


# --- what is missing --------------------------------------------------------------------------

NO_LIBSUMO = """
import sys
sys.modules["libsumo"] = None
from regents_cosim.errors import MissingDependencyError
from regents_cosim.simulators.sumo.process import running_sumo
try:
    with running_sumo([]):
        pass
except MissingDependencyError as error:
    print(error)
"""


def test_a_library_that_cannot_be_loaded_names_the_debian_packages():
    done = interpreter(NO_LIBSUMO)
    assert done.stderr == ""
    (line,) = done.stdout.splitlines()
    assert line.startswith("SUMO's library cannot be loaded (")
    assert "apt-get install libgl1 libx11-6 libxext6 libxrender1 libatomic1 libexpat1" in line


def open_window():
    with running_sumo(["-n", NET], gui=True):
        pass


def test_a_window_needs_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    with pytest.raises(RegentsError, match="DISPLAY is not set"):
        run_isolated(open_window)


def another_sumo(folder, version):
    """A libsumo that pip did not install (no version), or one of another version, first on the path."""
    (folder / "libsumo").mkdir()
    (folder / "libsumo" / "__init__.py").write_text("raise ImportError('it is not to be imported')\n")
    if version:
        info = folder / f"libsumo-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: libsumo\nVersion: {version}\n")


@pytest.mark.parametrize(
    ("version", "said"),
    [(None, "not from pip"), ("1.20.0", "SUMO 1.20.0 is installed"), ("1.25.0", ""), ("2.0.0", "SUMO 2.0.0")],
)
def test_another_sumo_is_named_in_one_line(tmp_path, version, said):
    another_sumo(tmp_path, version)
    code = "from regents_cosim.simulators.sumo.process import untested_sumo; print(untested_sumo() or '')"
    done = interpreter(code, PYTHONPATH=os.pathsep.join([str(tmp_path), *sys.path]))
    assert said in done.stdout
    assert len(done.stdout.splitlines()) == 1
    assert bool(done.stdout.strip()) == bool(said)
