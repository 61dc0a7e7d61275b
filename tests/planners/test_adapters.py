"""Planners of other packages, in environments that have them: name the interpreter to run these tests.

python -m venv other && other/bin/pip install commonroad-reactive-planner msgspec shapely jaxtyping
REGENTS_REACTIVE_PLANNER=other/bin/python pytest -m slow tests/planners/test_adapters.py
"""

import os

import pytest

from regents_cosim import evaluate, record

PYTHON = os.environ.get("REGENTS_REACTIVE_PLANNER")
PLACE = "regents_cosim.planners.adapters.reactive_planner:ReactivePlanner"


@pytest.mark.slow
@pytest.mark.skipif(PYTHON is None, reason="REGENTS_REACTIVE_PLANNER names no interpreter")
@pytest.mark.parametrize("net", ["crossing", "signals", "merge"])
def test_the_reactive_planner_drives_ordinary_traffic_to_its_end(net):
    drives = evaluate(record(f"shipped:{net}", count=2, seed=3, progress=False), f"python:{PYTHON}:{PLACE}").drives
    assert [drive.error for drive in drives] == ["", ""]
    assert all(drive.completion > 0.9 for drive in drives)
