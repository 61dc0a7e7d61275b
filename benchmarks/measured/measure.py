"""Measure what the documentation reports, and write its tables: `make results`.

    python benchmarks/measured/measure.py            # hours on one core
    python benchmarks/measured/measure.py --quick    # few windows: about half an hour
    python benchmarks/measured/measure.py --pages    # nothing is measured: the tables again, from docs/measured.json

Every step is a command that a reader can give. What a step gives is kept in `.benchmarks/measured/COMMIT`,
and the same call goes on from there after a stop. At the end `docs/measured.json` has all of it, and the pages take
their tables from that file. Leave the checkout as it is while this runs: new processes read the code from it.

`commonroad-idm-planner` needs an environment of its own (`docs/how-to/planner.md`): REGENTS_IDM_PLANNER names its
interpreter. Without it that planner keeps its row.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pages import MEASURED, write_pages

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
SEEDS = (52901, 52919, 52937, 52951)  # of no measurement before: runs of traffic
NETWORKS = ("crossing", "signals", "grid", "merge", "roundabout", "multilane")  # all tuned on, as those with persons
PLACES = ("old_town", "lights", "left_hand", "left_hand_grid", "spider", "motorway")  # held out: docs/made-places.sh
WITH_PERSONS = ("town", "street")
_OTHER, _ADAPTER = "commonroad-idm-planner", "regents_cosim.planners.adapters.idm:IdmPlanner"
_RANKED = ("careful", "aim-bev-hardened", "pdm-closed", _OTHER, "idm-yielding", "idm")
_LONG = "--horizon 16 --methods focused"
_EQUAL = "--methods focused --methods cma-es --methods starts"


@dataclass(frozen=True)
class Step:
    """A command, the file that it leaves its result in, and the command as a reader may give it."""

    name: str
    command: tuple[str, ...]
    shown: str
    result: str = ""  # in the folder of the run; the standard output if empty


def steps(folder: Path, quick: bool) -> list[Step]:
    """The measurements, the cheapest first."""
    count, few, more = (2, 1, 2) if quick else (12, 3, 4)
    fit = f"benchmarks reconstruction --count {count} --seed {SEEDS[0]} --json"
    table = partial(_table, folder, count)
    return [
        Step(
            "fit",
            (sys.executable, "-m", *fit.split(), "--quiet"),
            f"python -m {fit}",
        ),
        _bench("transfer", "bench transfer shipped:standard --json"),
        _ranking(),
        table("shipped", few, "idm", NETWORKS),
        table("shipped_by_chance", few, "idm", NETWORKS, "--prefer none"),
        table("made", more, "idm", PLACES),
        table("made_by_chance", few, "idm", PLACES, "--prefer none"),
        table("careful", 1, "careful", PLACES),
        table("persons", few, "idm", WITH_PERSONS, "--methods focused"),
        table("equal", 1, "idm", PLACES, f"--equal-protocol {_EQUAL}"),
        table("shipped_long", 1, "idm", NETWORKS, f"--prefer none {_LONG}"),
        table("made_long", 1, "idm", PLACES, f"--prefer none {_LONG}"),
        Step("performance", (sys.executable, str(ROOT / "benchmarks/speed/table.py")), "make bench"),
    ]


def _bench(name: str, words: str) -> Step:
    return Step(name, (str(BIN / "regents"), *words.split(), "--quiet"), f"regents {words}")


def _ranking() -> Step:
    python = os.environ.get("REGENTS_IDM_PLANNER", "")
    named = [f"python:INTERPRETER:{_ADAPTER}" if one == _OTHER else one for one in _RANKED]
    words = [f"--planner={one.replace('INTERPRETER', python)}" for one in named if python or one in _RANKED]
    step = _bench("planners", f"suite rank shipped:standard --json {' '.join(words)}")
    return replace(step, shown=f"regents suite rank shipped:standard --json --planner {' --planner '.join(named)}")


def _table(
    folder: Path,
    count: int,
    name: str,
    runs: int,
    planner: str,
    nets: tuple[str, ...],
    more: str = "",
) -> Step:
    asked = [
        f"--count {count} --adversaries one",
        *(f"--seed {one}" for one in SEEDS[:runs]),
        *([] if planner == "idm" else [f"--planners {planner}"]),
        more,
    ]
    where = [str(folder / f"places/{one}.sumocfg") if one in PLACES else one for one in nets]
    words = ["bench", "table1", *" ".join(asked).split()]
    for one in where:
        words += ["--nets", one]
    shown = " ".join(["regents", *words]).replace(f"{folder}/", "")
    return Step(
        name,
        (str(BIN / "regents"), *words, "-o", str(folder / name), "--quiet"),
        f"{shown} -o {name}/",
        f"{name}/table1.json",
    )


def run(step: Step, folder: Path) -> Any:
    """The result of a step: kept from before, or made now."""
    kept = folder / f"{step.name}.json"
    if not kept.is_file():
        print(f"measuring: {step.shown}", file=sys.stderr, flush=True)
        found = os.environ | {"PYTHONPATH": str(ROOT)}
        done = subprocess.run(step.command, cwd=folder, env=found, stdout=subprocess.PIPE, text=True, check=True)
        said = (folder / step.result).read_text() if step.result else done.stdout
        kept.with_suffix(".part").write_text(json.dumps(_KEPT.get(step.name, _scores)(said)))
        kept.with_suffix(".part").replace(kept)
    return json.loads(kept.read_text())


def _scores(said: str) -> Any:
    """The numbers of a table that the pages show, with those place by place."""
    table = json.loads(said)
    return {part: [{key: row[key] for key in _SHOWN} for row in table[part]] for part in ("scores", "by_source")}


_SHOWN = (
    "method", "planner", "source", "n", "windows", "telling", "telling_percent", "telling_interval", "flawless",
    "flawless_percent", "flawless_interval", "successes", "clean", "crashes", "preventions", "conducts",
    "verified_in_sumo", "mean_rollouts",
)  # fmt: skip


def _lines(said: str) -> Any:
    """A table that is printed as Markdown, row by row, without its two first lines."""
    rows = [line.strip("| \n").split(" | ") for line in said.splitlines() if line.startswith("|")]
    return {"rows": rows[2:], "note": said.strip().splitlines()[-1]}


def _transfer(said: str) -> Any:
    """The rows without the single replays."""
    return [{key: value for key, value in row.items() if key != "replays"} for row in json.loads(said)]


def ranked(said: str) -> Any:
    """The rows of the planners in their order; one that did not drive keeps its row."""
    before = json.loads(MEASURED.read_text())["results"].get("planners", {"rows": []})["rows"]
    now = [row | {"planner": _OTHER} if _ADAPTER in row["planner"] else row for row in json.loads(said)]
    rows = {row["planner"]: row for row in (*before, *now)}
    return {"commit": commit(), "rows": [rows[one] for one in _RANKED if one in rows]}


_KEPT: dict[str, Callable[[str], Any]] = {
    "fit": json.loads, "transfer": _transfer, "planners": ranked, "performance": _lines
}  # fmt: skip


def commit() -> str:
    """The commit that is measured; RuntimeError where files of the package differ from it."""
    git = ("git", "-C", str(ROOT))
    changed = subprocess.run(
        (*git, "status", "--porcelain", "--", "regents_cosim"), capture_output=True, text=True, check=True
    )
    if changed.stdout.strip():
        raise SystemExit(
            "regents_cosim/ has changes that are in no commit: commit them, so that the numbers have a name"
        )
    return subprocess.run((*git, "rev-parse", "HEAD"), capture_output=True, text=True, check=True).stdout.strip()[:12]


def machine() -> str:
    """Processor and number of cores."""
    names = [
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text().splitlines()
        if line.startswith("model name")
    ]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def measure(quick: bool) -> None:
    """All steps, and the file that the pages are made from."""
    name = commit()
    folder = ROOT / ".benchmarks/measured" / (f"{name}-quick" if quick else name)
    (folder / "places").mkdir(parents=True, exist_ok=True)
    if not (folder / "places/motorway.sumocfg").is_file():
        search = os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"}
        subprocess.run(["bash", str(ROOT / "docs/made-places.sh"), str(folder / "places")], check=True, env=search)
    wanted = steps(folder, quick)
    found = {
        "commit": name,
        "quick": quick,
        "seeds": SEEDS,
        "machine": machine(),
        "versions": {one: version(one) for one in ("libsumo", "highway-env", "jax")},
        "commands": {step.name: step.shown for step in wanted},
        "results": {step.name: run(step, folder) for step in wanted},
    }
    MEASURED.write_text(json.dumps(found, indent=1) + "\n")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer windows, about half an hour on one core")
    parser.add_argument(
        "--pages", action="store_true", help="measure nothing: write the tables from docs/measured.json"
    )
    asked = parser.parse_args()
    if not asked.pages:
        measure(asked.quick)
    write_pages()


if __name__ == "__main__":
    main()
