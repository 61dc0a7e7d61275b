"""The example `examples/route_planner.py`, which knows of the map only what `Scene.route` tells."""

from pathlib import Path

import pytest
from shipped_cases import shipped_windows

from regents_cosim.evaluation.drives.driving import drive_each

EXAMPLE = Path(__file__).parents[2] / "examples" / "route_planner.py"


@pytest.mark.slow
@pytest.mark.parametrize("network", ["signals", "multilane"])
def test_a_planner_of_few_lines_drives_by_the_route_alone(network):
    for drive in drive_each(shipped_windows(network)[-2:], f"{EXAMPLE}:Planner"):
        assert not drive.error
        assert drive.hits is None
        assert drive.completion > 0.7
        assert not drive.red_lights
        assert drive.off_road < 0.05
