"""The places that the documentation reports on, as its script makes them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from regents_cosim import record

pytestmark = pytest.mark.slow
SCRIPT = Path(__file__).parents[2] / "docs" / "made-places.sh"
PLACES = {"old_town", "lights", "left_hand", "left_hand_grid", "spider", "motorway"}


def test_the_script_makes_six_places_with_traffic(tmp_path):
    search = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(
        ["bash", str(SCRIPT), str(tmp_path)], check=True, capture_output=True, env={**os.environ, "PATH": search}
    )
    assert {found.stem for found in tmp_path.glob("*.sumocfg")} == PLACES
    (window,) = record(tmp_path / "left_hand.sumocfg", count=1)
    assert len(window.agents) > 1
