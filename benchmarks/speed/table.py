"""Measures the cost of searches and suites, as whole processes that users start; prints one table.

    make bench                                    # python benchmarks/speed/table.py
    python benchmarks/speed/table.py --rows grid       # those alone whose name has that word

Every row runs twice in new processes: first with what the rows above it have left of compiled programs, which is
nothing at first, then with its own. CPU time is that of a process and of all that it starts. It is told beside how
often a yardstick, which is measured in between, fits into it: one value of KING's cost in plain NumPy. That ratio is
what two machines, or two hours of a shared one, can be compared by; the seconds on the wall only on idle cores.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
REGENTS = str(Path(sys.executable).with_name("regents"))
ATTACK = (REGENTS, "attack", "--adversaries", "one", "--no-pictures", "--quiet", "-o", "suite")
SIGNALS = str(ROOT / "sumo_nets" / "signals" / "signals.sumocfg")
WINDOWS, FEW = 6, 2
TRAFFIC = {"grid": ("grid", WINDOWS), "signals": ("signals", WINDOWS), "few": ("grid", FEW)}  # folders of windows


@dataclass(frozen=True)
class Row:
    """A command, and for how many of what its time is told."""

    name: str
    command: tuple[str, ...]
    of: int = 1
    unit: str = "run"


@dataclass(frozen=True)
class Cost:
    """The time and memory of a process and its descendants."""

    wall_s: float
    cpu_s: float
    peak_mib: float  # of the greatest of them


def all_rows(traffic: Path, at_once: int) -> list[Row]:
    """The rows of the table; the windows of `TRAFFIC` are to lie in that folder."""
    aim_bev = "--planner", "aim-bev", "--replan-every", "25"
    suite = f"--regents-suite={ROOT / 'scenarios' / 'standard'}", "--regents-planner=idm"
    return [
        Row("`focused` on `idm`, grid", (*ATTACK, str(traffic / "grid")), WINDOWS, "window"),
        Row("`focused` on `idm`, signals", (*ATTACK, str(traffic / "signals")), WINDOWS, "window"),
        Row("`focused` on `aim-bev`, grid", (*ATTACK, str(traffic / "few"), *aim_bev), FEW, "window"),
        Row("8 windows of signals from `.sumocfg` to pictures, `regents`",
            (REGENTS, "attack", "-c", SIGNALS, "--count", "8", "--method", "regents", "--quiet", "-o", "suite")),
        Row("pytest of `scenarios/standard`", (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *suite)),
        Row(f"{at_once} scenarios at once", (sys.executable, str(HERE / "at_once.py"), str(at_once))),
    ]  # fmt: skip


def cost_of(command: Iterable[str], kept: Path) -> Cost:
    """Run a command in a new folder, compiled programs being kept in `kept`."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as said:
        # With the bytecode of the package, which pip leaves.
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        environment["REGENTS_CACHE"] = str(kept)
        begin = time.perf_counter()
        started = subprocess.Popen(list(command), cwd=folder, env=environment, stdout=said, stderr=said)
        _, status, used = os.wait4(started.pid, 0)
        started.returncode = os.waitstatus_to_exitcode(status)
        if started.returncode:
            said.seek(0)
            raise SystemExit(f"{' '.join(command)}: exit code {started.returncode}\n{said.read().decode()}")
        return Cost(time.perf_counter() - begin, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def yardstick_s() -> float:
    """CPU seconds of one value of KING's cost in plain NumPy, the least of five."""
    asked = [sys.executable, str(HERE / "yardstick.py")]
    return float(subprocess.run(asked, capture_output=True, text=True, check=True).stdout)


def record(traffic: Path, kept: Path) -> None:
    """The windows that are attacked, chosen by chance."""
    for name, (network, count) in TRAFFIC.items():
        sumo = str(ROOT / "sumo_nets" / network / f"{network}.sumocfg")
        cost_of(
            (REGENTS, "record", "-c", sumo, "--count", str(count), "--seed", "100", "-o", str(traffic / name)), kept
        )


def line(row: Row, first: Cost, again: Cost, unit_s: float) -> str:
    """Format a row of the table."""
    each = [f"{cost / row.of:.2f}" for cost in (first.cpu_s, again.cpu_s, again.wall_s)]
    each[1:1] = [f"{first.cpu_s / again.cpu_s:.1f}"]
    ratio = f"{again.cpu_s / row.of / unit_s:.0f}"
    first_cpu, of_first, cpu, wall = each
    return f"| {row.name} | {row.unit} | {first_cpu} | {of_first} | {cpu} | {ratio} | {wall} | {again.peak_mib:.0f} |"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default="", help="measure those alone whose name has this")
    parser.add_argument("--at-once", type=int, default=128, help="scenarios of the last row")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        traffic, kept = Path(folder, "traffic"), Path(folder, "kept")
        rows = [row for row in all_rows(traffic, asked.at_once) if asked.rows in row.name]
        if any(str(traffic) in word for row in rows for word in row.command):
            record(traffic, kept)
        print("| | of one | CPU s, first | first / again | CPU s, again | yardsticks | s, again | MiB at most |")
        print("|---|---|---|---|---|---|---|---|")
        for row in rows:
            first, unit_s = cost_of(row.command, kept), yardstick_s()
            print(line(row, first, cost_of(row.command, kept), unit_s), flush=True)
        print(f"\nA yardstick: {1e3 * yardstick_s():.0f} ms of CPU; {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
