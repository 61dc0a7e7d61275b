"""What `focused` takes as a user calls it: a whole process, nothing kept from before, then everything."""

import os
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import pytest

from regents_cosim.cli import run as regents

REGENTS = Path(sys.executable).with_name("regents")
WINDOWS = 8


@pytest.mark.parametrize("network", ["grid", "signals"])
def test_an_attack_on_recorded_windows(benchmark, tmp_path, network):
    sumo = f"sumo_nets/{network}/{network}.sumocfg"
    assert regents(["record", "-c", sumo, "--count", str(WINDOWS), "--seed", "100", "-o", str(tmp_path / "cases")]) == 0
    cold = benchmark.pedantic(_attacked, (tmp_path, "cold"), rounds=1)
    warm = _attacked(tmp_path, "warm")
    for kept, (wall, cpu) in (("nothing", cold), ("everything", warm)):
        print(f"\n{network}, {kept} kept: {wall / WINDOWS:.2f} s and {cpu / WINDOWS:.2f} CPU-seconds a window", end="")
    print(f"; {cold[1] / warm[1]:.1f} times the CPU time without kept programs")
    benchmark.extra_info |= {"cold_cpu_s": cold[1], "warm_cpu_s": warm[1]}


def _attacked(folder, name):
    """Wall and CPU seconds of one command, which finds programs that the one before it has kept."""
    command = "attack", str(folder / "cases"), "--adversaries", "one", "--no-pictures", "--quiet"
    before, begin = _cpu_s(), perf_counter()
    kept = os.environ | {"REGENTS_CACHE": str(folder / "kept")}
    subprocess.run([REGENTS, *command, "-o", str(folder / name)], env=kept, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - begin, _cpu_s() - before


def _cpu_s():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
