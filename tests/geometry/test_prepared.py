"""Areas of a map queried by several threads at once; each test has its own process, since GEOS may crash it."""

import subprocess
import sys

import pytest
from places import ROOT

ASK = """
import sys, threading
import numpy as np
import shapely
from regents_cosim.geometry.boxes import Boxes
from regents_cosim.maps.roadmap import Lane, RoadMap
from regents_cosim.verdicts.leaving_road import {asked}

turn = np.linspace(0.0, 2.0 * np.pi, 20_000)
far = 300.0 + 100.0 * np.sin(40.0 * turn)
star = shapely.Polygon(np.stack([far * np.cos(turn), far * np.sin(turn)], axis=-1))
lanes = (Lane("a", np.array([[-200.0, 0.0], [200.0, 0.0]]), 3.2, 14.0),)
steps = np.arange(80.0)
there = np.ones(80, bool)


def ask(road, together):
    together.wait()
    {ask}


for _ in range({times}):
    road = RoadMap(lanes, (), shapely.Polygon(star.exterior))
    together = threading.Barrier(4)
    threads = [threading.Thread(target=ask, args=(road, together)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
print("asked")
"""
PLACES = "road.contains(np.random.random((2000, 2)) * 600.0 - 300.0)"
SWEEPS = """for begin in np.random.random((5, 2)) * 400.0 - 200.0:
        box = Boxes(begin[0] + 1.4 * steps, begin[1] + 0.0 * steps, 0.0 * steps, 4.6, 1.8, 0.0 * steps)
        leaves_road(road, box, there, (box, there))"""


@pytest.mark.slow
@pytest.mark.parametrize(("ask", "times"), [(PLACES, 20), (SWEEPS, 12)], ids=["places", "sweeps"])
def test_threads_that_ask_a_map_at_once_do_not_crash(ask, times):
    script = ASK.format(ask=ask, times=times, asked="leaves_road")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout) == (0, "asked\n"), done.stderr
