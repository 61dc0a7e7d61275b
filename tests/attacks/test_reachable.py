"""No searched drive leaves the area that the candidate can reach."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from regents_cosim.attacks.starts.drive_lines import line_through
from regents_cosim.attacks.starts.reachable import Reachable
from regents_cosim.attacks.starts.speed_profiles import DRIVING, drive, profiles
from regents_cosim.verdicts.ordinary import CAR, CYCLIST, HEAVY

DT, STEPS = 0.1, 80
STRAIGHT = np.column_stack([np.linspace(0.0, 400.0, 801), np.zeros(801)])
BENT = np.column_stack([np.linspace(0.0, 400.0, 801), 10.0 * np.sin(np.linspace(0.0, 40.0, 801))])


@pytest.mark.slow
@pytest.mark.parametrize("points", [STRAIGHT, BENT], ids=["straight", "bent"])
@pytest.mark.parametrize("limits", [CAR, HEAVY, CYCLIST], ids=["car", "heavy", "cyclist"])
@given(speed=st.floats(0.0, 30.0), accel=st.floats(-6.0, 6.0), limit=st.sampled_from([3.0, 8.33, 13.89, 36.1, np.inf]))
def test_no_profile_gets_further_or_less_far(points, limits, speed, accel, limit):
    line = line_through(points, limit)
    wanted = profiles([line], speed, speed, limits, DRIVING)
    _, travelled = drive([line], (speed, accel), wanted, STEPS, DT, limits)
    least, most = Reachable(speed, accel, speed, limits, DT * np.arange(STEPS)).along(limit)
    assert (travelled <= most).all()
    assert (travelled >= least).all()
