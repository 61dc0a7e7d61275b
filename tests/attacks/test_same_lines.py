"""Lines along which a vehicle would drive in the same way are driven along once."""

from dataclasses import replace

import numpy as np
import pytest

from regents_cosim.attacks.starts.drive_lines import LightOnLine, line_through

LINE = replace(
    line_through(np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 5.0]]), 13.9),
    stop_lines=(LightOnLine(40.0, np.array([True, False])),),
)


@pytest.mark.parametrize(
    "changed",
    [
        {"limit": 8.3},
        {"shows_m": 5.0},
        {"points": LINE.points + 0.1},
        {"points": LINE.points[:-1], "heading": LINE.heading[:-1]},
        {"stop_lines": ()},
        {"stop_lines": (LightOnLine(40.0, np.array([True, True])),)},
        {"stop_lines": (LightOnLine(41.0, np.array([True, False])),)},
        {"yields": True},
    ],
)
def test_lines_along_which_drives_differ_are_not_the_same(changed):
    assert LINE.key != replace(LINE, **changed).key


def test_a_line_drawn_again_is_the_same():
    again = replace(LINE, points=LINE.points - 1e-9, stop_lines=(LightOnLine(40.0, np.array([True, False])),))
    assert LINE.key == again.key
