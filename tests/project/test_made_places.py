"""Places that scripts of the documentation make: those it reports on, and those that AIM-BEV is taught on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from regents_cosim import record

pytestmark = pytest.mark.slow
DOCS = Path(__file__).parents[2] / "docs"
REPORTED = {"old_town", "lights", "left_hand", "left_hand_grid", "spider", "motorway"}


def made(script, folder):
    search = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": search}
    subprocess.run(["bash", str(DOCS / script), str(folder)], check=True, capture_output=True, env=environment)
    return {found.stem for found in folder.glob("*.sumocfg")}


def test_the_script_makes_six_places_with_traffic(tmp_path):
    assert made("made-places.sh", tmp_path) == REPORTED
    (window,) = record(tmp_path / "left_hand.sumocfg", count=1, tell=lambda _: None)
    assert len(window.agents) > 1


def test_what_is_taught_is_thirty_other_places_with_traffic_of_many_kinds(tmp_path):
    taught = made("taught-places.sh", tmp_path)
    assert len(taught) == 30
    assert not taught & REPORTED
    windows = record(tmp_path / "blocks_f.sumocfg", count=6, max_agents=200, tell=lambda _: None)
    assert len({agent.length for window in windows for agent in window.agents}) > 2
