"""Small files that ask for a product of counts: read in what their bytes take, or refused in one line."""

import json
import subprocess
import sys

import pytest
from params import slow
from places import ROOT

from benchmarks.endurance.fuzz import MOST_BYTES
from benchmarks.endurance.products import READERS

_COSTLY = (
    "sumo_net",
    "commonroad",
    "gpudrive",
    "scenarionet",
    "interaction_map",
    "table",
    "argoverse2_map",
    "argoverse2_motion",
)


@pytest.fixture(scope="module")
def outcomes():
    """What became of the files of readers, by reader; all that are cheap are asked in one process."""
    kept = {}

    def of(name):
        asked = (name,) if name in _COSTLY else tuple(one for one in READERS if one not in _COSTLY)
        if asked not in kept:
            command = [sys.executable, "-m", "benchmarks.endurance.read_products", *asked]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            kept[asked] = done, [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        done, found = kept[asked]
        assert done.returncode == 0, f"ended by {done.returncode} after {done.stdout[-300:]}; {done.stderr[-300:]}"
        return [one for one in found if one["reader"] == name]

    return of


@pytest.mark.slow
@pytest.mark.parametrize("name", [slow(name) if name in _COSTLY else name for name in READERS])
def test_a_product_of_counts_fills_no_memory_and_takes_no_hours(outcomes, name):
    found = outcomes(name)
    assert found
    for one in found:
        assert one["size"] < 2_000_000
        assert one["verdict"] in ("accepted", "refused"), one["how"]
        assert one["grown"] < MOST_BYTES
        assert "too large or too deeply nested" not in one["said"]  # which is what an end of the memory is called
