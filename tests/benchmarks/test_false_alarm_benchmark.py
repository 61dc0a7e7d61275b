"""What the foresight of the careful driver costs and brings."""

import numpy as np
from avoidable_scenes import braking_lead
from careful_scenes import cut_in
from scenes import TIME, moving, scene, straight_road

from benchmarks.false_alarms import foresight_rows, looking_ahead, needless_braking
from regents_cosim.norms.careful import CAREFUL
from regents_cosim.verdicts.judge import judge

AHEAD_S = (1.0, 2.0, 4.0)


def merely_crossing():
    """A car that would be hit within 4 s until it stops, out of the ego's way."""
    made = scene((0, 0, 10), (60, -60, 10), road=straight_road(1))
    speed = np.where(TIME < 3.0, 10.0, 0.0)
    return moving(made, 1, x=60.0, y=-60.0 + 10.0 * np.minimum(TIME, 3.0), yaw=np.pi / 2, speed=speed)


def test_braking_for_who_stops_in_time_is_needless():
    window = merely_crossing()
    found = needless_braking(window)
    assert found.times == 1
    assert 4.0 < found.hardest_m_s2 < CAREFUL.most_braking_m_s2  # it builds up until the danger is over
    assert 0.0 < found.lost_m_s <= 10.0
    with looking_ahead(1.0):
        assert needless_braking(window).times == 0


def test_more_foresight_alarms_and_prevents_no_less():
    crashes = [judge(made) for made in (cut_in(18.0, 1.0), braking_lead(35.4))]
    rows = foresight_rows([merely_crossing(), crashes[0]], crashes, AHEAD_S)
    assert [row.windows for row in rows] == [1, 1, 1]  # in the other one the ego collides
    assert [row.alarms for row in rows] == sorted(row.alarms for row in rows)
    assert [row.prevented for row in rows] == sorted(row.prevented for row in rows)
    assert (rows[-1].alarms, rows[-1].crashes) == (1, 2)
    assert rows[-1].prevented > rows[0].prevented
