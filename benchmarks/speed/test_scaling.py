"""How time and memory of the attack grow with agents, horizon and batch: a table, and a plot in `.benchmarks/`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

HERE = Path(__file__).parent
PLOT = HERE.parents[1] / ".benchmarks" / "scaling.png"
AXES = {
    "agents": [{"agents": n} for n in (8, 16, 32, 64)],
    "steps": [{"steps": n} for n in (40, 80, 160)],
    "batch": [{"batch": n} for n in (1, 8, 32, 128)],
}
# Peak memory is that of a process, so every point is one.
POINT = """
import json, sys
from peak_memory import peak_bytes
from timing import STILL, attack, dense_traffic, in_threads, job, seconds
agents, steps, batch = json.loads(sys.argv[1])
jobs = [job(dense_traffic(agents, steps, seed), "log_replay") for seed in range(batch)]
took = seconds(lambda: in_threads(2, lambda j: attack(*j), jobs), rounds=3)
print(json.dumps([1e3 * took / STILL.iterations / batch, peak_bytes() / 2**20]))
"""


def measured(agents: int = 32, steps: int = 80, batch: int = 8) -> tuple[float, float]:
    """Milliseconds per iteration and scenario, and peak memory [MiB]."""
    done = subprocess.run(
        [sys.executable, "-c", POINT, json.dumps([agents, steps, batch])],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": f"{HERE}:{HERE.parents[1] / 'tests/support'}", "PATH": "/usr/bin:/bin"},
    )
    return tuple(json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.slow
def test_scaling(benchmark):
    rows = {axis: [(next(iter(p.values())), *measured(**p)) for p in points] for axis, points in AXES.items()}
    benchmark.pedantic(measured, rounds=1)
    for axis, points in rows.items():
        print(f"\n{axis:>8}  ms per iteration and scenario  peak memory [MiB]")
        for value, took, peak in points:
            print(f"{value:>8}  {took:>29.3f}  {peak:>17.0f}")
    PLOT.parent.mkdir(exist_ok=True)
    plot(rows).savefig(PLOT)
    print(f"plot: {PLOT}")


def plot(rows: dict[str, list[tuple[int, float, float]]]) -> Figure:
    """Time above, memory below, a column for each axis."""
    figure = Figure(figsize=(11, 5), layout="constrained")
    panels = figure.subplots(2, len(rows), sharey="row")
    for column, (axis, points) in enumerate(rows.items()):
        values, took, peak = zip(*points, strict=True)
        for panel, measure in zip(panels[:, column], (took, peak), strict=True):
            panel.plot(values, measure, marker="o")
            panel.set_ylim(bottom=0)
            panel.set_xlabel(axis)
    panels[0, 0].set_ylabel("ms per iteration and scenario")
    panels[1, 0].set_ylabel("peak memory [MiB]")
    return figure
