"""Measures recording beside the bare simulation: both in one run, in fresh processes of the same kind."""

import os
import tempfile
import time
from pathlib import Path

import pytest

from regents_cosim.simulators.sumo.config import SumoInput, read_input
from regents_cosim.simulators.sumo.process import running_sumo
from regents_cosim.sources.sumo import STEP_S, SumoRecordingJob, record_slots, record_sumo, sumo_command
from regents_cosim.sources.windows import Windows
from regents_cosim.system.workers import run_isolated

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("REGENTS_DATA", ROOT.parent / "shared" / "data")) / "sumo"
COUNT = 25
ROUNDS = 3


def seconds_of_recording(job: SumoRecordingJob) -> tuple[float, float]:
    """Wall time in the worker, and up to when SUMO was run."""
    start = time.perf_counter()
    last = record_slots(job)[-1]
    return time.perf_counter() - start, last.begin_s + last.dt * last.x.shape[1]


def seconds_of_bare_run(job: SumoRecordingJob, until_s: float) -> float:
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, running_sumo(sumo_command(job, Path(folder))) as sumo:
        while sumo.simulation.getTime() < until_s - 0.5 * STEP_S:
            sumo.simulationStep()
    return time.perf_counter() - start


CONFIGS = {
    "signals": ROOT / "sumo_nets" / "signals" / "signals.sumocfg",
    "bologna_acosta": DATA / "bologna_acosta" / "run.sumocfg",
}


@pytest.mark.parametrize("name", CONFIGS)
def test_recording_beside_the_bare_run(benchmark, name: str) -> None:
    config = CONFIGS[name]
    if not config.is_file():
        pytest.skip(f"no {name} (set REGENTS_DATA to the folder of recordings)")
    source = SumoInput(config)
    job = SumoRecordingJob(read_input(source), Windows(count=COUNT))
    recording, bare = [], []
    for _ in range(ROUNDS):  # alternating, so that a slow moment of the machine meets both
        took, until_s = run_isolated(seconds_of_recording, job)
        recording.append(took)
        bare.append(run_isolated(seconds_of_bare_run, job, until_s))
    scenarios = benchmark.pedantic(record_sumo, args=(source, Windows(count=COUNT)), rounds=1)
    ratio = min(recording) / min(bare)
    benchmark.extra_info |= {"recording_s": min(recording), "bare_s": min(bare), "ratio": ratio}
    print(
        f"\n{name}: recording {min(recording):.2f} s, bare SUMO {min(bare):.2f} s, ratio {ratio:.2f} "
        f"(least of {ROUNDS}); all of record_sumo {benchmark.stats.stats.min:.2f} s for {len(scenarios)} scenarios"
    )
    assert len(scenarios) == COUNT
