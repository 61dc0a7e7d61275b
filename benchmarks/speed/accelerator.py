"""Scenario-iterations per second over batch sizes, of KING and of `focused`, with 32 agents: for a GPU, or a CPU.

    make bench-gpu                                       # python benchmarks/speed/accelerator.py
    python benchmarks/speed/accelerator.py --sizes 1,8 --iterations 5 --method focused

Each measurement is one program that searches so many scenarios side by side, as `attack --engine batched` does, on the
device that JAX finds. Nothing is hit, so all iterations are run, an update with its gradient each. Of `focused` it is
the descent: what comes before goes one search after the other on every device. A batch that does not fit says so. The
table and what it was measured on are printed, and written to a file to be pasted (`-o`).
"""

import argparse
import itertools
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import jax

sys.path.append(str(Path(__file__).parents[2] / "tests/support"))

from timing import STILL, dense_traffic, job

from regents_cosim.attacks.attack import engine_of
from regents_cosim.attacks.candidates import candidates_of
from regents_cosim.attacks.descent.batched_search import search_batched
from regents_cosim.attacks.engines import by_program
from regents_cosim.attacks.job import SearchJob
from regents_cosim.attacks.methods.presets import REGENTS_FOCUSED, AttackConfig
from regents_cosim.attacks.setup import AttackSetup
from regents_cosim.mirror.programs.compile_cache import keep_compiled_programs
from regents_cosim.planners.under_test import PlannerUnderTest

AGENTS, PLANNER = 32, "idm"
FEW, MANY = "1,8,32", "1,32,128,512,1024,2048,4096"
SCENES = 8  # that differ; larger batches hold them several times
FOCUSED = REGENTS_FOCUSED.but(learning_rate=STILL.steps.learning_rate, patience=0, starts=0, attempts=1, sampled=0)
OUTPUT = Path(__file__).parents[2] / ".benchmarks"


def king_job(seed: int) -> SearchJob:
    """A joint search: all agents but the ego are candidates."""
    return job(dense_traffic(AGENTS, seed=seed), PLANNER)[1]


def focused_job(seed: int) -> SearchJob:
    """A search for one candidate, under the law."""
    setup = AttackSetup(FOCUSED, PlannerUnderTest.of(PLANNER).loop, PLANNER, None)
    return candidates_of(setup, dense_traffic(AGENTS, seed=seed), by_program(setup))[0].job


METHODS: dict[str, tuple[AttackConfig, Callable[[int], SearchJob]]] = {
    "king": (STILL, king_job),
    "focused": (FOCUSED, focused_job),
}


def rates(method: str, sizes: list[int], iterations: int) -> Iterator[tuple[int, float, float] | tuple[int, str]]:
    """For each size the faster of two rates [scenario-iterations/s] and the time of the first call [s], or an error."""
    config, make = METHODS[method]
    jobs, loop = [make(seed) for seed in range(min(SCENES, max(sizes)))], PlannerUnderTest.of(PLANNER).loop
    for size in sizes:
        batch = list(itertools.islice(itertools.cycle(jobs), size))
        try:
            first_s, *again_s = [
                _seconds(lambda batch=batch: search_batched(batch, loop, config, len(batch), iterations))
                for _ in range(3)
            ]
        except jax.errors.JaxRuntimeError as error:
            yield size, str(error).splitlines()[0][:80]
            continue
        yield size, size * iterations / min(again_s), first_s


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    jax.block_until_ready(work())
    return time.perf_counter() - begin


def measured_on() -> str:
    """The device, and the versions that matter."""
    device = jax.devices()[0]
    return (
        f"{device.platform} ({device.device_kind}), {len(jax.devices())} devices, {os.cpu_count()} cores, "
        f"JAX {jax.__version__}, Python {platform.python_version()}; {AGENTS} agents, 80 steps, `{PLANNER}`"
    )


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", help=f"batches, by default {MANY}, on a CPU {FEW}")
    parser.add_argument("--iterations", type=int, default=200, help="updates of each search")
    parser.add_argument("--method", choices=METHODS, action="append", help="only this one; can be repeated")
    parser.add_argument("-o", "--output", type=Path, help="file of the table")
    asked = parser.parse_args()
    keep_compiled_programs()
    sizes = [int(size) for size in (asked.sizes or (FEW if engine_of("auto") == "threads" else MANY)).split(",")]
    output = asked.output or OUTPUT / f"accelerator-{jax.default_backend()}.md"
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text("")
    for text in _table(asked.method or list(METHODS), sizes, asked.iterations):
        print(text, flush=True)
        with output.open("a") as file:  # line by line: a long run that is ended leaves what it has measured
            file.write(text + "\n")
    print(f"written to {output}")


def _table(methods: list[str], sizes: list[int], iterations: int) -> Iterator[str]:
    yield f"{measured_on()}; {iterations} iterations\n"
    yield "| | batch | scenario-iterations per second | of one alone | first call, s |"
    yield "|---|---|---|---|---|"
    for method in methods:
        alone = None
        for size, *found in rates(method, sizes, iterations):
            if len(found) == 1:
                yield f"| {method} | {size} | {found[0]} | | |"
                continue
            rate, first_s = found
            alone = alone or rate
            yield f"| {method} | {size} | {rate:.0f} | {rate / alone:.1f} | {first_s:.1f} |"


if __name__ == "__main__":
    main()
